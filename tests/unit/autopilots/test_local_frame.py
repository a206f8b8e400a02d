"""Local frames of autopilots: metres of degrees on a sphere, as recorded beside what their receivers told."""

import numpy as np
import pytest

from gcs.autopilots.local_frame import local_frame
from gcs.autopilots.traits import Autopilot
from gcs.frames import LocalFrame, Origin, geodetic_to_ned

# What vehicles at rest told at the end of `missions/field`: GPS_GLOBAL_ORIGIN, and degE7 of GPS_RAW_INT beside x and y.
ARDUCOPTER = [
    ((-353632620, 1491652370, 584.32), (-353569740, 1491652373), (699.983, 0.018)),
    ((-353633400, 1491652920, 584.24), (-353570518, 1491652923), (700.005, 0.019)),
]
PX4 = [
    ((-353632626, 1491652399, 583.89), (-353569706, 1491652347), (699.998, -0.417)),
    ((-353632987, 1491652063, 583.89), (-353570053, 1491652030), (700.174, -0.379)),
    ((-353633390, 1491652381, 584.21), (-353570418, 1491652353), (700.232, -0.314)),
]


@pytest.mark.parametrize(
    ("autopilot", "told", "within_m"), [(Autopilot.ARDUPILOT, ARDUCOPTER, 0.03), (Autopilot.PX4, PX4, 0.5)]
)
def test_a_local_position_is_where_the_receiver_says(
    autopilot: Autopilot,
    told: list[tuple[tuple[int, int, float], tuple[int, int], tuple[float, float]]],
    within_m: float,
) -> None:
    off_m = []
    for (lat_degE7, lon_degE7, alt_m), (at_lat_degE7, at_lon_degE7), (x_m, y_m) in told:
        origin = Origin(lat_degE7 / 1e7, lon_degE7 / 1e7, alt_m)
        true_m = geodetic_to_ned(at_lat_degE7 / 1e7, at_lon_degE7 / 1e7, alt_m, origin)
        told_m = np.array([x_m, y_m, 0.0])
        assert np.linalg.norm(told_m - true_m) > 1.0  # without the frame
        off_m.append(local_frame(autopilot, origin, np.zeros(3)).common_ned_m(told_m) - true_m)
    assert np.linalg.norm(np.mean(off_m, axis=0)) < within_m


def test_a_frame_has_its_own_place_and_counts_back() -> None:
    frame = local_frame(Autopilot.PX4, Origin(60.0, 179.999, 100.0), np.array([3.0, 4.0, -5.0]))
    places = np.array([[1000.0, -2000.0, 30.0], [3.0, 4.0, -5.0]])
    assert frame.common_ned_m(frame.own_m(places)) == pytest.approx(places)
    assert frame.own_m(places[1]).tolist() == [0.0, 0.0, 0.0]
    assert frame.counts == pytest.approx([0.99803, 0.99635, 1.0], abs=1e-5) and frame.counts[2] == 1.0


def test_an_autopilot_without_a_row_counts_true_metres() -> None:
    assert local_frame(0, Origin(0.0, 0.0, 0.0), np.zeros(3)).counts.tolist() == LocalFrame().counts.tolist()
