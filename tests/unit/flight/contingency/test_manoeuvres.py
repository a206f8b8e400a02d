"""Courses off the plan: no faster and no harder than told, from where the vehicle is, and at rest in the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.flight.contingency.manoeuvres import (
    BRAKE_MPS2,
    SPREAD_MPS2,
    LegsReference,
    RejoinReference,
    ReturnReference,
    hold_reference,
    return_reference,
    spread_reference,
)
from gcs.flight.offboard.reference_trajectory import ReferenceTrajectory
from gcs.mission.failsafe.return_routes import ReturnRoutes
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import Plan

places = st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-50, -3)).map(np.array)
speeds = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-2, 2)).map(np.array)
STEP_S = 0.02
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


def consistent(course: LegsReference | ReturnReference, accel_mps2: float = BRAKE_MPS2) -> tuple[Array, Array, Array]:
    """Velocity is position's rate; nothing jumps; it ends at rest."""
    place, velocity, acceleration = sampled(course, course.begin_s, course.end_s + 1.0)
    np.testing.assert_allclose(np.diff(place, axis=0) / STEP_S, (velocity[1:] + velocity[:-1]) / 2, atol=0.02)
    assert np.abs(np.diff(velocity, axis=0)).max() <= accel_mps2 * STEP_S + 1e-6
    assert not velocity[-1].any()
    assert not acceleration[-1].any()
    return place, velocity, acceleration


@settings(deadline=None)
@given(places, speeds)
def test_holding_brakes_straight_on(place: Array, velocity: Array) -> None:
    course = hold_reference(place, velocity, 0.3, 5.0)
    path, rate, _ = consistent(course)
    np.testing.assert_allclose(path[0], place, atol=1e-9)
    np.testing.assert_allclose(rate[0], velocity, atol=1e-9)
    speed = float(np.linalg.norm(velocity))
    np.testing.assert_allclose(path[-1], place + velocity * speed / (2 * BRAKE_MPS2), atol=1e-6)


@settings(deadline=None)
@given(places, speeds)
def test_spreading_ends_above(place: Array, velocity: Array) -> None:
    path, _, _ = consistent(spread_reference(place, velocity, 0.0, 5.0, 2.0), BRAKE_MPS2 + SPREAD_MPS2)
    stop = consistent(hold_reference(place, velocity, 0.0, 5.0))[0][-1]
    np.testing.assert_allclose(path[-1], stop - [0.0, 0.0, 2.0], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(flown, speeds, flown, st.floats(5.0, 60.0))
def test_returning_climbs_crosses_and_sinks(
    open_routes: ReturnRoutes, place: Array, velocity: Array, over: Array, level_m: float
) -> None:
    home = np.array([over[0], over[1], -2.0])
    course = return_reference(place, velocity, 0.0, 5.0, open_routes, home, home[2] - level_m, SPEEDS, 1.0)
    assert course is not None
    path, rate, _ = consistent(course, 3.4)  # harder and sideways where it would leave the fence
    stop = hold_reference(place, velocity, 0.0, 5.0)
    moving = np.arange(5.0, course.end_s + 1.0, STEP_S)[: len(path)] > stop.end_s
    level = np.hypot(*(path[:, :2] - path[-1, :2]).T)
    crossing = moving & (np.hypot(rate[:, 0], rate[:, 1]) > 1e-6)
    assert (path[crossing, 2] <= home[2] - level_m + 1e-6).all()
    assert np.hypot(rate[crossing, 0], rate[crossing, 1]).max(initial=0.0) <= 5.0 + 1e-6
    assert rate[moving, 2].min() >= -2.0 - 1e-6
    assert rate[moving, 2].max() <= 1.0 + 1e-6
    np.testing.assert_allclose(path[-1], home - [0.0, 0.0, 1.0], atol=1e-6)
    assert level[-1] == 0.0


def test_rejoining_fades_what_is_off() -> None:
    base = hold_reference(np.array([10.0, 20.0, -5.0]), np.zeros(3), 0.5, 0.0)
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
