"""A vehicle that follows a moving target: the final error in closed form."""

from __future__ import annotations

import pytest

from gcs.autopilots.waypoint_models.calibration import PX4
from gcs.autopilots.waypoint_models.navigator import NavigatorState
from gcs.autopilots.waypoint_models.tracking import Follower, Following, Loop

STILL = (0.0, 0.0, 0.0)
LOOP = Loop(1.0, 2.0, 0.5, 0.2, False)


def chase(following: Following, velocity: tuple[float, float, float], seconds: float = 60.0) -> tuple[Follower, float]:
    """Return the vehicle after `seconds` behind a target of constant velocity, and its lag along north, m."""
    follower = Follower(following, NavigatorState(0.0, STILL, STILL, STILL))
    step_s = 0.02
    for k in range(round(seconds / step_s)):
        t_s = k * step_s
        follower.step((velocity[0] * t_s, velocity[1] * t_s, velocity[2] * t_s), velocity, STILL, step_s)
    return follower, velocity[0] * seconds - follower.position[0]


def test_the_integral_compensates_drag():
    follower, behind_m = chase(Following(LOOP, LOOP, 0.15, 0.8), (5.0, 0.0, 0.0))
    assert follower.velocity[0] == pytest.approx(5.0, abs=1e-3)
    assert behind_m == pytest.approx(0.0, abs=0.01)


def test_without_an_integral_drag_causes_a_lag():
    loop = Loop(1.0, 2.0, 0.0, 0.0, False)
    _, behind_m = chase(Following(loop, loop, 0.15, 0.8), (5.0, 0.0, 0.0))
    assert behind_m == pytest.approx(0.8 * 5.0 / (2.0 * 1.0), rel=0.01)


def test_in_a_descent_an_unwinding_integral_causes_a_lag():
    sinking = (4.0, 0.0, 1.3)
    _, kept = chase(Following(LOOP, LOOP, 0.15, 1.0), sinking)
    _, unwound = chase(Following(LOOP, LOOP, 0.15, 1.0, unwinding=2.0), sinking)
    lift = 1.0 - 1.3 / 9.80665
    assert kept == pytest.approx(0.0, abs=0.02)
    assert unwound == pytest.approx(2.0 / 2.0 * (1.0 - lift) * 4.0 / lift, rel=0.02)
    _, level = chase(Following(LOOP, LOOP, 0.15, 1.0, unwinding=2.0), (4.0, 0.0, 0.0))
    assert level == pytest.approx(0.0, abs=0.02)


def test_it_continues_from_its_initial_motion():
    begins = NavigatorState(0.0, (1.0, 2.0, 3.0), (4.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    follower = Follower(PX4.following, begins)
    follower.step((1.0, 2.0, 3.0), (4.0, 0.0, 0.0), (0.5, 0.0, 0.0), 0.01)
    assert follower.velocity[0] == pytest.approx(4.0, abs=0.02)
    assert follower.acceleration[0] == pytest.approx(0.5, abs=0.5)
