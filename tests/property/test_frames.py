"""Frames: round trips, rigidity, and rounding, anywhere a scenario may be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymap3d.vincenty import vdist

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
def test_another_origin_nearby_keeps_distances_but_for_the_height(origin: Origin, ned_m: np.ndarray) -> None:
    lat, lon, alt = ned_to_geodetic(ned_m, origin)
    other = Origin(float(lat[0]), float(lon[0]), float(alt[0]))
    seen = geodetic_to_ned(lat, lon, alt, other)
    assert np.allclose(seen[0], 0, atol=1e-6)
    assert np.allclose(seen[:, 2], ned_m[:, 2] - ned_m[0, 2], atol=1e-6)
    before, after = (np.linalg.norm((m[:, None] - m)[..., :2], axis=-1) for m in (ned_m, seen))
    # By the height of the other origin over the Earth's radius, and 3e-7 for its curvature within 10 km
    assert np.allclose(before, after, rtol=5000.0 / 6.3e6 + 1e-6, atol=1e-5)


@given(origins, st.sampled_from([5_000.0, 20_000.0]), st.floats(0, 360), st.floats(-400, 1500))
def test_heights_count_from_the_level_surface(
    origin: Origin, away_m: float, course_deg: float, height_m: float
) -> None:
    course_rad = np.radians(course_deg)
    shares = np.linspace(0.0, 1.0, 21)[:, None]
    flown = np.hstack([shares * away_m * [np.cos(course_rad), np.sin(course_rad)], np.full((21, 1), -height_m)])
    lat, lon, alt = ned_to_geodetic(flown, origin)
    assert np.allclose(alt, origin.alt_amsl_m + height_m, atol=1e-6)
    ground = ned_to_geodetic(flown * [1.0, 1.0, 0.0], origin)
    assert np.allclose(np.stack(ground[:2]), np.stack([lat, lon]), atol=1e-12, rtol=0)
    # The lengths of Vincenty's geodesics on the ellipsoid, of which the altitude of the origin makes longer ones
    metres = [float(np.ravel(vdist(origin.lat_deg, origin.lon_deg, *end)[0])[0]) for end in zip(lat, lon, strict=True)]
    level_m = np.array(metres) * (1.0 + origin.alt_amsl_m / 6_371_008.8)
    assert np.allclose(level_m, shares[:, 0] * away_m, rtol=2e-5, atol=1e-3)


def test_the_other_side_of_the_earth_is_far() -> None:
    # Preflight and scenarios refuse places that are far: the height alone would put them under the origin.
    for origin in (Origin(0.0, 0.0, 0.0), Origin(46.1, 9.2, 500.0), Origin(-85.0, -180.0, 9000.0)):
        lon_deg = origin.lon_deg + 180.0
        there = geodetic_to_ned(-origin.lat_deg, lon_deg, 0.0, origin)
        assert np.hypot(*there[:2]) == pytest.approx(20.0e6, rel=0.005)


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
    assert down == pytest.approx(0, abs=1e-6)


def test_single_points_and_batches_of_any_shape() -> None:
    origin = Origin(-33.9, 18.4, 20.0)
    batch = np.arange(24.0).reshape(2, 4, 3)
    lat, lon, alt = ned_to_geodetic(batch, origin)
    assert lat.shape == lon.shape == alt.shape == (2, 4)
    one = ned_to_geodetic(batch[1, 2], origin)
    assert [float(v) for v in one] == pytest.approx([lat[1, 2], lon[1, 2], alt[1, 2]], abs=1e-12)
    with pytest.raises(ValueError, match="3 components"):
        ned_to_geodetic(np.zeros((3, 2)), origin)
