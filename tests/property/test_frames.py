"""Frames: round trips, rigidity, and rounding, anywhere a scenario may be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.frames import Origin, from_degE7, geodetic_to_ned, ned_to_geodetic, to_degE7

origins = st.builds(
    Origin,
    lat_deg=st.floats(-85, 85),
    lon_deg=st.floats(-180, 180),
    alt_amsl_m=st.floats(-500, 9000),
)
points = st.lists(st.tuples(*[st.floats(-5000, 5000)] * 3), min_size=2, max_size=8).map(np.array)


@given(origins, points)
def test_there_and_back(origin: Origin, ned_m: np.ndarray) -> None:
    lat, lon, alt = ned_to_geodetic(ned_m, origin)
    assert np.allclose(geodetic_to_ned(lat, lon, alt, origin), ned_m, atol=1e-6)


@given(origins, points)
def test_another_origin_nearby_is_a_rigid_motion(origin: Origin, ned_m: np.ndarray) -> None:
    lat, lon, alt = ned_to_geodetic(ned_m, origin)
    other = Origin(float(lat[0]), float(lon[0]), float(alt[0]))
    seen = geodetic_to_ned(lat, lon, alt, other)
    assert np.allclose(seen[0], 0, atol=1e-6)
    before = np.linalg.norm(ned_m[:, None] - ned_m, axis=-1)
    after = np.linalg.norm(seen[:, None] - seen, axis=-1)
    assert np.allclose(before, after, atol=1e-5)


@given(origins, st.floats(1, 5000))
def test_north_raises_latitude_east_raises_longitude_down_lowers(origin: Origin, step_m: float) -> None:
    lat, lon, alt = ned_to_geodetic(np.eye(3) * step_m, origin)
    assert lat[0] > origin.lat_deg
    assert (lon[1] - origin.lon_deg + 180) % 360 - 180 > 0
    assert alt[2] == pytest.approx(origin.alt_amsl_m - step_m, abs=1e-6)


@given(st.floats(-180, 180))
def test_degE7_is_off_by_half_a_unit_at_most(angle_deg: float) -> None:
    assert abs(from_degE7(to_degE7(angle_deg)) - angle_deg) <= 0.5e-7 * (1 + 1e-6)


@given(st.integers(-1_800_000_000, 1_800_000_000))
def test_degE7_survives_degrees(angle_degE7: int) -> None:
    assert to_degE7(from_degE7(angle_degE7)) == angle_degE7


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"), [(47.397742, 8.545594), (-35.363262, 149.165237), (-22.9, -43.2), (40.7, -74.0)]
)
def test_one_minute_of_arc_northward_in_every_quarter_of_the_globe(lat_deg: float, lon_deg: float) -> None:
    # Radius of curvature in the meridian, a (1 - e^2) / (1 - e^2 sin^2 lat)^1.5, times one minute of arc.
    e2 = 6.69437999014e-3
    meridian_m = 6378137.0 * (1 - e2) / (1 - e2 * np.sin(np.radians(lat_deg)) ** 2) ** 1.5
    north, east, down = geodetic_to_ned(lat_deg + 1 / 60, lon_deg, 0.0, Origin(lat_deg, lon_deg, 0.0))
    arc_m = np.radians(1 / 60) * meridian_m
    assert north == pytest.approx(arc_m, rel=1e-5)
    assert east == pytest.approx(0, abs=1e-6)
    assert down == pytest.approx(arc_m**2 / (2 * meridian_m), rel=1e-3)


def test_single_points_and_batches_of_any_shape() -> None:
    origin = Origin(-33.9, 18.4, 20.0)
    batch = np.arange(24.0).reshape(2, 4, 3)
    lat, lon, alt = ned_to_geodetic(batch, origin)
    assert lat.shape == lon.shape == alt.shape == (2, 4)
    one = ned_to_geodetic(batch[1, 2], origin)
    assert [float(v) for v in one] == pytest.approx([lat[1, 2], lon[1, 2], alt[1, 2]], abs=1e-12)
    with pytest.raises(ValueError, match="3 components"):
        ned_to_geodetic(np.zeros((3, 2)), origin)
