"""Returns of the ground station as motions: brakes, corners and legs keep their limits and their way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.flight.contingency.manoeuvres import MotionReference
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_motion import ACCEL_MPS2, CORNER_M, routed_motion, stops
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

SPEEDS = ReturnSpeeds(climb_mps=2.0, cruise_mps=5.0, sink_mps=1.0, wait_s=0.0)
STEP_S = 0.02


@pytest.fixture(scope="module")
def routes_of(plan_of: Callable[[str], Plan]) -> Callable[..., ReturnRoutes]:
    plan = plan_of("field/scenario.toml")

    def routes(*zones: NoFlyZone) -> ReturnRoutes:
        return ReturnRoutes(replace(plan, scenario=plan.scenario.model_copy(update={"no_fly": zones})))

    return routes


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(st.floats(60.0, 600.0), st.floats(-60.0, 60.0)), min_size=2, max_size=7),
    st.floats(-40.0, -3.0),
    st.floats(0.0, 30.0),
)
@pytest.mark.slow
def test_ways_are_followed_within_limits(
    routes_of: Callable[..., ReturnRoutes], points: list[tuple[float, float]], down_m: float, climb_m: float
) -> None:
    way = np.array([*points, points[-1]])
    start = np.array([[*points[0], down_m]])
    stop = stops(start, np.zeros((1, 3)), np.zeros(1), routes_of())
    motion = routed_motion(stop, way[None], np.array([down_m - climb_m]), np.array([0.0]), SPEEDS)
    t_s = np.arange(0.0, motion.times_s[0, -1] + 1.0, STEP_S)
    course = MotionReference(motion, 0.0, 0.0)
    place, velocity, acceleration = np.split(np.array([course.at(0, float(t)) for t in t_s])[:, :9], 3, axis=1)
    np.testing.assert_allclose(motion.places_at(t_s[None])[0], place, atol=1e-9)  # what is verified is what is flown
    np.testing.assert_allclose(np.diff(place, axis=0) / STEP_S, (velocity[1:] + velocity[:-1]) / 2, atol=0.02)
    assert np.linalg.norm(acceleration, axis=1).max() <= ACCEL_MPS2 * (1 + 1e-6)
    level = np.linalg.norm(velocity[:, :2], axis=1)
    assert level.max() <= SPEEDS.cruise_mps + 1e-6
    np.testing.assert_allclose(place[level > 1e-6, 2], down_m - climb_m, atol=1e-6)
    assert np.linalg.norm(place[0] - start[0]) < 1e-9
    np.testing.assert_allclose(place[-1], [*points[-1], 0.0], atol=1e-6)
    assert not velocity[-1].any()
    if np.ptp(way, axis=0).any():
        off_m = shapely.distance(shapely.LineString(way), shapely.points(place[:, :2]))
        assert off_m.max() <= CORNER_M + 1e-6


def test_gentle_corners_are_flown_at_full_speed(routes_of: Callable[..., ReturnRoutes]) -> None:
    """A zone's round edge is no reason to stop: only begin and end are slower than a straight way as long."""
    zone = NoFlyZone(north_m=300.0, east_m=0.0, radius_m=60.0)
    routes = routes_of(zone)
    start, end = np.array([[550.0, 0.0, -20.0]]), np.array([50.0, 0.0])
    way = routes.way_ned_m(start[0], end)
    assert way is not None
    stop = stops(start, np.zeros((1, 3)), np.zeros(1), routes)
    slow = replace(SPEEDS, cruise_mps=3.0)
    motion = routed_motion(stop, way[None], np.array([-20.0]), np.array([-20.0]), slow)
    length_m = routes.length_m(start[0], end)
    assert length_m > 510.0
    assert motion.times_s[0, -1] == pytest.approx(length_m / 3.0 + 3.0 / ACCEL_MPS2, abs=0.2)


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 15.0), st.floats(-60.0, 60.0), st.floats(1.0, 5.0))
def test_braking_keeps_out_of_a_zone_ahead(
    routes_of: Callable[..., ReturnRoutes], gap_m: float, angle_deg: float, speed_mps: float
) -> None:
    """Towards an edge that a turn would have left alone: sideways or harder, whatever gets less deep."""
    wall = NoFlyZone(polygon_m=((300.0, -20.0), (300.0, 60.0), (320.0, 60.0), (320.0, -20.0)))
    routes = routes_of(wall)
    angle = np.deg2rad(angle_deg)
    start = np.array([[300.0 - gap_m, 10.0, -15.0]])
    velocity = speed_mps * np.array([[np.cos(angle), np.sin(angle), 0.0]])
    stop = stops(start, velocity, np.zeros(1), routes)
    run_m = speed_mps**2 / 2 * np.cos(angle)
    if gap_m > run_m / ACCEL_MPS2 + 0.01:
        np.testing.assert_allclose(stop.end_ned_m[0], start[0] + velocity[0] * speed_mps / (2 * ACCEL_MPS2), atol=1e-9)
    if gap_m > run_m / 3.0 + 0.01:
        track: Array = np.stack([start[0, :2], stop.half_ned_m[0, :2], stop.end_ned_m[0, :2]])
        assert not shapely.intersects(shapely.Polygon(wall.polygon_m).buffer(-1e-6), shapely.LineString(track))
    assert np.linalg.norm(stop.end_ned_m - start) <= speed_mps**2 / (2 * ACCEL_MPS2) * 1.5
