"""PX4's speed limits before waypoints, in closed form."""

from __future__ import annotations

import math

import pytest

from gcs.autopilots.waypoint_models.px4_speed import Approach, braking_speed, towards

APPROACH = Approach()  # 3 m/s2, 4 m/s3, half of it in turns, 2 m and 0.8 m, 3 and 1.5 m/s, 4 and 3 m/s2
HERE, GOAL = (0.0, 0.0, -20.0), (60.0, 0.0, -20.0)


def turned(degrees: float) -> tuple[float, float, float]:
    """A waypoint 60 m beyond the goal."""
    angle = math.radians(degrees)
    return 60.0 + 60.0 * math.cos(angle), 60.0 * math.sin(angle), -20.0


@pytest.mark.parametrize(("turn_deg", "speed_mps"), [(60.0, 2.3), (90.0, 1.7), (120.0, 1.3), (150.0, 0.9)])
def test_a_corner_is_passed_at_the_speed_of_its_circle(turn_deg, speed_mps):
    """The square root of acceleration times radius over the tangent of half the turn; two values were recorded."""
    near = (59.999, 0.0, -20.0)
    speed = APPROACH.level_speed(near, GOAL, turned(turn_deg), 5.0)
    assert speed == pytest.approx(math.sqrt(1.5 * 2.0 / math.tan(math.radians(turn_deg / 2))), rel=1e-3)
    assert speed == pytest.approx(speed_mps, abs=0.05)


def test_it_brakes_at_the_last_waypoint_and_not_on_a_straight_line():
    assert APPROACH.level_speed((59.0, 0.0, -20.0), GOAL, turned(0.0), 5.0) == 5.0
    assert APPROACH.level_speed((59.0, 0.0, -20.0), GOAL, GOAL, 5.0) == pytest.approx(braking_speed(1.0, 0.0, 3.0, 4.0))
    assert APPROACH.level_speed(HERE, GOAL, GOAL, 5.0) == 5.0


def test_braking_needs_distance():
    """v² + 4 a²/j v = end² + 2 a d."""
    speed = braking_speed(20.0, 2.0, 3.0, 4.0)
    assert speed**2 + 9.0 * speed == pytest.approx(4.0 + 120.0)
    assert braking_speed(0.0, 2.0, 3.0, 4.0) == 2.0


def test_an_altitude_error_reduces_the_speed_near_the_goal_only():
    far, near = ((x, 0.0, -20.6) for x in (0.0, 57.0))
    slow = APPROACH.climb_speed(near, GOAL, turned(0.0), down=True)
    assert math.hypot(*towards(far, GOAL, 5.0, slow)[:2]) == pytest.approx(5.0, rel=0.01)
    assert math.hypot(*towards(near, GOAL, 5.0, slow)[:2]) < 3.0


def test_velocity_points_at_the_aim_within_both_limits():
    n, e, d = towards((0.0, 0.0, 0.0), (30.0, 40.0, 10.0), 5.0, 1.5)
    assert math.hypot(n, e) == pytest.approx(5.0)
    assert d == pytest.approx(1.0)
    assert (n, e) == pytest.approx((3.0, 4.0))
    n, e, d = towards((0.0, 0.0, 0.0), (30.0, 40.0, 50.0), 5.0, 1.5)
    assert d == pytest.approx(1.5)
    assert math.hypot(n, e) == pytest.approx(1.5)
    assert towards(GOAL, GOAL, 5.0, 1.5) == (0.0, 0.0, 0.0)


def test_a_turning_target_aims_at_the_leg_ahead():
    aside = (30.0, 3.0, -20.0)
    assert APPROACH.turning(aside, (0.0, 3.0, 0.0), GOAL)
    assert not APPROACH.turning(aside, (5.0, 0.0, 0.0), GOAL)
    assert APPROACH.aim(aside, HERE, GOAL) == pytest.approx((34.0, 0.0, -20.0))
