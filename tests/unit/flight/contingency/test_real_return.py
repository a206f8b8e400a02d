"""Six real PX4s that were called home through a no-fly zone: the same return now leads round it."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.manoeuvres import MotionStart, return_reference
from gcs.flight.recording.tlog import load_tlog
from gcs.frames import geodetic_to_ned
from gcs.mission.returns.fence_areas import inclusion_corners, planned_places_m
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.values.si import local_origin
from gcs.types import Array
from tests.real_flights import Flight, unpacked

CALLED_UNIX_S, CALLED_S = 1795332673.842, 55.205  # `gcs attach --return`: on the wall, and in plan time
FENCED_UNIX_S = 1795332710.0  # by then all but one had told of the fence


def heard_at(flight: Flight, folder: Path, unix_s: float) -> tuple[Array, Array]:
    """Positions and velocities (V, 3) of all vehicles as they last told them."""
    origin = local_origin(flight.plan.scenario)
    told: dict[int, Array] = {}
    log = load_tlog(folder / "telemetry-073111.tlog")
    for frame, at_s in zip(log.frames, log.unix_s, strict=True):
        fields = frame.message.fields
        if at_s <= unix_s and frame.message.name == "GLOBAL_POSITION_INT":
            place = geodetic_to_ned(fields["lat"] / 1e7, fields["lon"] / 1e7, fields["alt"] / 1e3, origin)
            told[frame.message.sysid] = np.array([*place, *(fields[axis] / 100.0 for axis in ("vx", "vy", "vz"))])
    state = np.array([told[sysid] for sysid in flight.plan.sysids])
    return state[:, :3], state[:, 3:]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return Flight(unpacked("px4-1.17dev-return-into-fence", tmp_path_factory.mktemp("real")))


@pytest.mark.slow
def test_the_return_that_was_flown_into_the_fence_leads_round_it(flight: Flight) -> None:
    plan, zone = flight.plan, flight.plan.scenario.no_fly[0]
    places, velocities = heard_at(flight, flight.folder, CALLED_UNIX_S)
    returns, routes = plan_returns(plan, Autopilot.PX4), ReturnRoutes(plan)
    fence = shapely.Polygon(inclusion_corners(planned_places_m(plan)))
    courses, crossed = [], []
    for row, home in enumerate(plan.pads_ned_m):
        shares = np.linspace(0.0, 1.0, 200)[:, None]
        straight = places[row] + shares * (home - places[row])
        crossed.append(bool(outside_m(zone, np.zeros(1), straight[:, 0], straight[:, 1]).min() < -2.0))
        top_down_m = float(home[2]) - returns.altitudes_m[row]
        course = return_reference(
            MotionStart(places[row], velocities[row], 0.0, CALLED_S), routes, home, top_down_m, returns.speeds, 1.0
        )
        assert course is not None
        courses.append(course)
    assert crossed == [True, True, True, False, True, True]  # as it was flown: five met the fence, one landed
    t_s = np.arange(CALLED_S, max(course.end_s for course in courses), 0.1)
    flown = np.array([[course.at(0, float(t))[:3] for t in t_s] for course in courses])
    begun = outside_m(zone, np.zeros(1), places[:, 0], places[:, 1])[:, None]
    for other in plan.scenario.no_fly:
        outside = outside_m(other, np.zeros(1), flown[..., 0], flown[..., 1])
        assert (outside >= np.minimum(begun, 2.0) - 0.1).all()  # the nearest was 0.28 m outside, and drifted on
        assert (outside > 0.0).all()
    assert shapely.contains_properly(fence, shapely.points(flown[..., :2])).all()
    np.testing.assert_allclose(flown[:, -1], plan.pads_ned_m - [0.0, 0.0, 1.0], atol=0.05)
    least_m = min(
        float(np.linalg.norm(flown[a] - flown[b], axis=1).min()) for a, b in itertools.combinations(range(6), 2)
    )
    assert least_m >= plan.scenario.limits.separation_min_m


def test_the_vehicles_that_flew_straight_home_met_the_fence(flight: Flight) -> None:
    places, _ = heard_at(flight, flight.folder, FENCED_UNIX_S)
    zone = flight.plan.scenario.no_fly[0]
    near = outside_m(zone, np.zeros(1), places[:, 0], places[:, 1])
    assert (near < -2.0).tolist() == [True, True, True, False, True, True]
