"""PX4's smoothing of one axis: within its limits, fast, and as long as that of the other axes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.waypoint_models.px4_speed import Axis, synchronize

ACCELERATION, JERK = 3.0, 4.0


def moving(speed: float, acceleration: float) -> Axis:
    axis = Axis(0.0)
    axis.speed, axis.acceleration = speed, acceleration
    return axis


@given(st.floats(-8.0, 8.0), st.floats(-ACCELERATION, ACCELERATION), st.floats(-8.0, 8.0))
def test_the_wanted_speed_is_reached_in_time_and_kept(speed, acceleration, wanted):
    axis = moving(speed, acceleration)
    axis.want(wanted, ACCELERATION, JERK)
    steps, left_s = 40, axis.duration_s
    for _ in range(steps):
        before = axis.acceleration
        axis.advance(left_s / steps)
        assert abs(axis.acceleration) <= ACCELERATION + 1e-9
        assert abs(axis.acceleration - before) <= JERK * left_s / steps + 1e-9
    assert axis.speed == pytest.approx(wanted, abs=1e-6)
    assert axis.acceleration == pytest.approx(0.0, abs=1e-6)
    axis.advance(1.0)
    assert axis.speed == pytest.approx(wanted, abs=1e-6)


def test_from_rest_it_takes_what_jerk_and_acceleration_need():
    axis = moving(0.0, 0.0)
    axis.want(6.0, ACCELERATION, JERK)
    assert axis.duration_s == pytest.approx(6.0 / ACCELERATION + ACCELERATION / JERK)
    axis.want(1.0, ACCELERATION, JERK)
    assert axis.duration_s == pytest.approx(2.0 * math.sqrt(1.0 / JERK))


@given(st.floats(-5.0, 5.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_axes_arrive_together(first, second, third):
    axes = (moving(0.0, 0.0), moving(1.0, 0.0), moving(0.0, 0.0))
    for axis, wanted in zip(axes, (first, second, third), strict=True):
        axis.want(wanted, ACCELERATION, JERK)
    longest_s = max(axis.duration_s for axis in axes)
    synchronize(axes)
    for axis, wanted in zip(axes, (first, second, third), strict=True):
        assert axis.duration_s == pytest.approx(longest_s, abs=1e-9) or axis.speed == wanted
        axis.advance(longest_s)
        assert axis.speed == pytest.approx(wanted, abs=1e-6)
        assert axis.acceleration == pytest.approx(0.0, abs=1e-6)
