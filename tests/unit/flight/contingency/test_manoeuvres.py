"""Courses off the plan: no faster and no harder than told, from where the vehicle is, and at rest in the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.flight.contingency.manoeuvres import (
    SPREAD_MPS2,
    MotionReference,
    MotionStart,
    ReferenceTrajectory,
    RejoinReference,
    hold_reference,
    return_reference,
    spread_reference,
)
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_motion import ACCEL_MPS2
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

speeds = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-2, 2)).map(np.array)
STEP_S = 0.02
# Within the fence, and so far from it that a vehicle brakes straight on, whatever its speed.
middle = st.tuples(st.floats(160, 520), st.floats(-10, 10), st.floats(-50, -3)).map(np.array)
flown = st.tuples(st.floats(50, 550), st.floats(-40, 40), st.floats(-50, -3)).map(np.array)
SPEEDS = ReturnSpeeds(climb_mps=2.0, cruise_mps=5.0, sink_mps=1.0, wait_s=0.0)


@pytest.fixture(scope="module")
def open_routes(plan_of: Callable[[str], Plan]) -> ReturnRoutes:
    """The ways of a plan without no-fly zones: straight."""
    plan = plan_of("field/scenario.toml")
    return ReturnRoutes(replace(plan, scenario=plan.scenario.model_copy(update={"no_fly": ()})))


def sampled(course: ReferenceTrajectory, begin_s: float, end_s: float) -> tuple[Array, Array, Array]:
    """Positions, velocities, accelerations (N, 3) every 20 ms."""
    rows = [course.at(0, t) for t in np.arange(begin_s, end_s, STEP_S)]
    assert all(row is not None for row in rows)
    values = np.array(rows)
    return values[:, :3], values[:, 3:6], values[:, 6:9]


def consistent(course: MotionReference, accel_mps2: float = ACCEL_MPS2) -> tuple[Array, Array, Array]:
    """Velocity is position's rate; nothing jumps; it ends at rest."""
    place, velocity, acceleration = sampled(course, course.begin_s, course.end_s + 1.0)
    np.testing.assert_allclose(np.diff(place, axis=0) / STEP_S, (velocity[1:] + velocity[:-1]) / 2, atol=0.02)
    assert np.abs(np.diff(velocity, axis=0)).max() <= accel_mps2 * STEP_S + 1e-6
    assert not velocity[-1].any()
    assert not acceleration[-1].any()
    return place, velocity, acceleration


@pytest.fixture(scope="module")
def zoned_routes(plan_of: Callable[[str], Plan]) -> ReturnRoutes:
    """The ways of a plan with one no-fly zone, a circle of 20 m around (300, 0)."""
    plan = plan_of("field/scenario.toml")
    zone = NoFlyZone(north_m=300.0, east_m=0.0, radius_m=20.0)
    return ReturnRoutes(replace(plan, scenario=plan.scenario.model_copy(update={"no_fly": (zone,)})))


@settings(max_examples=40, deadline=None)
@given(middle, speeds)
def test_holding_brakes_straight_on(open_routes: ReturnRoutes, place: Array, velocity: Array) -> None:
    course = hold_reference(MotionStart(place, velocity, 0.3, 5.0), open_routes)
    path, rate, _ = consistent(course)
    np.testing.assert_allclose(path[0], place, atol=1e-9)
    np.testing.assert_allclose(rate[0], velocity, atol=1e-9)
    speed = float(np.linalg.norm(velocity))
    np.testing.assert_allclose(path[-1], place + velocity * speed / (2 * ACCEL_MPS2), atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(middle, speeds)
def test_spreading_ends_above(open_routes: ReturnRoutes, place: Array, velocity: Array) -> None:
    path, _, _ = consistent(
        spread_reference(MotionStart(place, velocity, 0.0, 5.0), open_routes, 2.0), ACCEL_MPS2 + SPREAD_MPS2
    )
    stop = consistent(hold_reference(MotionStart(place, velocity, 0.0, 5.0), open_routes))[0][-1]
    np.testing.assert_allclose(path[-1], stop - [0.0, 0.0, 2.0], atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, math.tau), st.floats(3.5, 8.0), st.floats(0.5, 0.9), st.floats(-0.9, 0.9))
def test_holding_and_spreading_stop_before_a_no_fly_zone(
    zoned_routes: ReturnRoutes, bearing_rad: float, speed_mps: float, share: float, aside: float
) -> None:
    """The zone begins where braking straight on at 1.5 m/s2 would still move: all brake sideways or harder."""
    out = np.array([math.cos(bearing_rad), math.sin(bearing_rad), 0.0])
    zone, brakes_m = np.array([300.0, 0.0, 0.0]), speed_mps**2 / (2 * ACCEL_MPS2)
    place = zone + (20.0 + max(share * brakes_m, brakes_m / 2 + 0.1)) * out - [0.0, 0.0, 12.0]
    across = np.array([-out[1], out[0], 0.0])
    velocity = -speed_mps * math.cos(aside) * out + speed_mps * math.sin(aside) * across
    for course in (
        hold_reference(MotionStart(place, velocity, 0.0, 5.0), zoned_routes),
        spread_reference(MotionStart(place, velocity, 0.0, 5.0), zoned_routes, 2.0),
    ):
        path, _, _ = consistent(course, 3.4 + SPREAD_MPS2)
        assert np.linalg.norm((path - zone)[:, :2], axis=1).min() >= 20.0 - 1e-6


@settings(max_examples=40, deadline=None)
@given(flown, speeds, flown, st.floats(5.0, 60.0))
def test_returning_climbs_crosses_and_sinks(
    open_routes: ReturnRoutes, place: Array, velocity: Array, over: Array, level_m: float
) -> None:
    home = np.array([over[0], over[1], -2.0])
    course = return_reference(MotionStart(place, velocity, 0.0, 5.0), open_routes, home, home[2] - level_m, SPEEDS, 1.0)
    assert course is not None
    path, rate, _ = consistent(course, 3.4)  # harder and sideways where it would leave the fence
    stop = hold_reference(MotionStart(place, velocity, 0.0, 5.0), open_routes)
    moving = np.arange(5.0, course.end_s + 1.0, STEP_S)[: len(path)] > stop.end_s
    level = np.hypot(*(path[:, :2] - path[-1, :2]).T)
    crossing = moving & (np.hypot(rate[:, 0], rate[:, 1]) > 1e-6)
    assert (path[crossing, 2] <= home[2] - level_m + 1e-6).all()
    assert np.hypot(rate[crossing, 0], rate[crossing, 1]).max(initial=0.0) <= 5.0 + 1e-6
    assert rate[moving, 2].min() >= -2.0 - 1e-6
    assert rate[moving, 2].max() <= 1.0 + 1e-6
    np.testing.assert_allclose(path[-1], home - [0.0, 0.0, 1.0], atol=1e-6)
    assert level[-1] == 0.0


def test_rejoining_fades_what_is_off(open_routes: ReturnRoutes) -> None:
    base = hold_reference(MotionStart(np.array([10.0, 20.0, -5.0]), np.zeros(3), 0.5, 0.0), open_routes)
    off, rate = np.array([3.0, -1.0, 0.5]), np.array([-1.0, 0.2, 0.0])
    course = RejoinReference(base, off, rate, 100.0, 8.0)
    place, velocity, acceleration = sampled(course, 100.0, 110.0)
    np.testing.assert_allclose(place[0], np.array([13.0, 19.0, -4.5]))
    np.testing.assert_allclose(velocity[0], rate)
    np.testing.assert_allclose(acceleration[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.diff(place, axis=0) / STEP_S, (velocity[1:] + velocity[:-1]) / 2, atol=1e-3)
    np.testing.assert_allclose(
        np.diff(velocity, axis=0) / STEP_S, (acceleration[1:] + acceleration[:-1]) / 2, atol=2e-2
    )
    assert course.at(0, 108.0) == base.at(0, 108.0)
    assert place[399] == pytest.approx([10.0, 20.0, -5.0], abs=1e-4)


@pytest.mark.parametrize(
    ("up_m", "takes_s", "top_mps"), [(2.0, 2.0 + 1.0 / 0.75, 1.0), (0.5, 2.0 * (0.5 / 0.75) ** 0.5, 0.375**0.5)]
)
def test_spreading_climbs_at_a_metre_a_second_at_most(
    open_routes: ReturnRoutes, up_m: float, takes_s: float, top_mps: float
) -> None:
    """From rest to rest at 0.75 m/s2: trapezoid for a long way, triangle for a short one."""
    course = spread_reference(MotionStart(np.array([300.0, 0.0, -9.0]), np.zeros(3), 0.0, 5.0), open_routes, up_m)
    assert course.end_s - course.begin_s == pytest.approx(takes_s)
    path, rate, push = sampled(course, 5.0, course.end_s)
    assert rate[:, 2].min() == pytest.approx(-top_mps, abs=0.02)
    assert np.abs(push[:, 2]).max() == pytest.approx(0.75)
    assert path[-1, 2] == pytest.approx(-9.0 - up_m, abs=0.01)


def test_a_delayed_motion_is_the_same_one_later(open_routes: ReturnRoutes) -> None:
    course = hold_reference(MotionStart(np.array([300.0, 0.0, -9.0]), np.array([3.0, 0.0, 0.0]), 0.3, 5.0), open_routes)
    before, ends_s = course.at(0, 6.0), course.end_s
    course.delay(3.0)
    assert (course.begin_s, course.end_s) == (8.0, ends_s + 3.0)
    assert course.at(0, 9.0) == before
    assert course.end_ned_m == pytest.approx([303.0, 0.0, -9.0]), "3 m/s at 1.5 m/s2"
    assert course.at(0, 0.0)[:3] == (300.0, 0.0, -9.0), "it waits to begin"
