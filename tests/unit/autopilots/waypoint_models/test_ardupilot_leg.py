"""Motion along a leg of ArduCopter, and the effect of a change of speed at different times."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.waypoint_models.ardupilot_leg import LegMotion, limit_along
from gcs.autopilots.waypoint_models.scurve import RampLimits

LIMITS = RampLimits(2.5, 1.0, 5.236)


def leg(length_m: float, top_mps: float, elapsed_s: float = 0.0) -> LegMotion:
    motion = LegMotion(length_m, top_mps, LIMITS)
    motion.advance(elapsed_s)
    return motion


def check(motion: LegMotion) -> None:
    """From now on the motion is smooth and ends at rest at the end of the leg."""
    t_s = np.linspace(motion.elapsed_s, motion.duration_s, 800)
    states = np.array([motion.at(t) for t in t_s.tolist()])
    step_s = t_s[1] - t_s[0]
    assert np.all(np.diff(states[:, 0]) >= -1e-9)
    np.testing.assert_allclose(states[-1], [motion.length_m, 0.0, 0.0], atol=1e-6)
    tolerance = 0.01 + step_s * LIMITS.mps3
    np.testing.assert_allclose(np.diff(states[:, 0]) / step_s, states[1:, 1], atol=step_s * LIMITS.mps2 + 1e-6)
    np.testing.assert_allclose(np.diff(states[:, 1]) / step_s, states[1:, 2], atol=tolerance)


def test_short_legs_are_slow():
    """Half the leg is for acceleration. If the peak is not held, the speed is proportional to length^(2/3)."""
    tops = [leg(length, 20.0).at(leg(length, 20.0).duration_s / 2)[1] for length in (25.0, 50.0)]
    assert tops[0] == pytest.approx(0.59 * 25.0 ** (2 / 3), abs=0.15)
    assert tops[1] == pytest.approx(tops[0] * 2 ** (2 / 3), rel=0.03)


def test_a_speed_that_comes_before_the_start_counts_from_the_start():
    motion = leg(100.0, 3.0)
    motion.set_top(6.0)
    assert motion.duration_s == pytest.approx(leg(100.0, 6.0).duration_s)


def test_a_change_while_cruising_is_made():
    motion = leg(200.0, 8.0, 12.0)
    before = motion.at(12.0)
    motion.set_top(3.0)
    assert motion.at(12.0) == pytest.approx(before)
    assert motion.at(30.0)[1] == pytest.approx(3.0)
    check(motion)


def test_a_slow_down_waits_until_the_start_is_over():
    motion = leg(200.0, 8.0, 1.0)
    before_s = motion.started_s
    motion.set_top(3.0)
    assert motion.at(3.0)[1] > 3.0
    assert motion.started_s <= before_s
    assert motion.at(motion.duration_s / 2)[1] == pytest.approx(3.0)
    check(motion)


def test_a_slow_down_on_a_leg_that_never_cruises_is_not_made():
    motion, untouched = leg(30.0, 8.0, 1.5), leg(30.0, 8.0, 1.5)
    motion.set_top(3.0)
    assert motion.duration_s == pytest.approx(untouched.duration_s)
    assert motion.top_mps == 3.0


def test_a_start_that_holds_its_acceleration_is_cut_short():
    """8 to 3 m/s on 60 m: recorded, still 7 m/s halfway."""
    motion = leg(60.0, 8.0, 2.0)
    motion.set_top(3.0)
    assert 6.5 < motion.at(motion.duration_s / 2)[1] < 7.9
    check(motion)


def test_nothing_changes_once_the_leg_ends():
    motion = leg(60.0, 5.0)
    motion.advance(motion.stopping_s + 0.1)
    duration_s = motion.duration_s
    motion.set_top(2.0)
    assert motion.duration_s == duration_s


@given(
    st.floats(5.0, 200.0),
    st.lists(st.tuples(st.floats(0.05, 0.9), st.floats(0.5, 9.0)), min_size=1, max_size=3),
    st.floats(0.5, 9.0),
)
def test_the_motion_after_every_change_is_smooth_to_the_end(length_m, changes, first_mps):
    motion = leg(length_m, first_mps)
    for share, top in changes:
        motion.advance(share * motion.remaining_s)
        before = motion.at(motion.elapsed_s)
        motion.set_top(top)
        assert motion.at(motion.elapsed_s) == pytest.approx(before, abs=1e-6)
        check(motion)


def test_limits_along_a_slope():
    climb = (0.8, 0.0, -0.6)
    assert limit_along(climb, 8.0, 3.0, 1.5) == pytest.approx(5.0)
    assert limit_along((0.8, 0.0, 0.6), 8.0, 3.0, 1.5) == pytest.approx(2.5)
    assert limit_along((1.0, 0.0, 0.0), 8.0, 3.0, 1.5) == 8.0
    assert limit_along((0.0, 0.0, -1.0), 8.0, 3.0, 1.5) == 3.0
    assert limit_along((0.0, 0.0, 0.0), 8.0, 3.0, 1.5) == 8.0
    assert math.isinf(limit_along((1.0, 0.0, 0.0), math.inf, 3.0, 1.5))
