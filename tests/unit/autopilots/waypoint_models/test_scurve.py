"""One change of speed: consistent derivatives, within its limits, and as fast as they allow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.waypoint_models.scurve import Ramp, RampLimits, constant_speed, ramp_up

LIMITS = RampLimits(2.5, 1.0, 5.2)
SPEEDS = st.floats(0.0, 8.0)
ROOMS = st.floats(0.5, 200.0)


def sampled(ramp: Ramp, n: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """Instants (n,) and distance, speed, acceleration (n, 3)."""
    t_s = np.linspace(0.0, ramp.duration_s, n)
    return t_s, np.array([ramp.at(t) for t in t_s.tolist()])


@given(SPEEDS, SPEEDS, ROOMS)
def test_a_ramp_keeps_its_limits_and_joins_its_ends(start, wanted, room):
    ramp = ramp_up(start, wanted, room, LIMITS)
    assert ramp.end_mps <= max(wanted, start) + 1e-9
    assert ramp.duration_s == 0.0 or ramp.distance_m <= room + 1e-9
    if ramp.duration_s == 0.0:
        return
    t_s, states = sampled(ramp)
    np.testing.assert_allclose(states[0], [0.0, start, 0.0], atol=1e-9)
    np.testing.assert_allclose(states[-1], [ramp.distance_m, ramp.end_mps, 0.0], atol=1e-9)
    step_s = t_s[1] - t_s[0]
    speed, acceleration = (np.diff(states[:, k]) / step_s for k in (0, 1))
    tolerance = 1e-6 + LIMITS.mps4 * step_s**2
    assert np.abs(speed - 0.5 * (states[1:, 1] + states[:-1, 1])).max() < tolerance
    assert np.abs(acceleration - 0.5 * (states[1:, 2] + states[:-1, 2])).max() < tolerance
    jerk = np.diff(states[:, 2]) / step_s
    assert states[:, 2].max() <= LIMITS.mps2 + 1e-9
    assert np.abs(jerk).max() <= LIMITS.mps3 * 1.001 + 1e-9
    assert start > 0.0 or np.abs(np.diff(jerk)).max() / step_s <= LIMITS.mps4 * 1.01 + 1e-6


@given(SPEEDS, SPEEDS)
def test_a_slow_down_mirrors_the_ramp_up(start, wanted):
    ramp = ramp_up(start, wanted, 500.0, LIMITS)
    back = ramp.reversed()
    assert back.distance_m == pytest.approx(ramp.distance_m)
    for share in (0.1, 0.35, 0.5, 0.9):
        t_s = share * ramp.duration_s
        distance, speed, acceleration = ramp.at(t_s)
        there = (ramp.distance_m - distance, speed, -acceleration)
        assert back.at(ramp.duration_s - t_s) == pytest.approx(there, abs=1e-9)


def test_with_enough_distance_it_reaches_the_wanted_speed():
    ramp = ramp_up(0.0, 20.0, 1e4, LIMITS)
    rise_s = LIMITS.mps2 / LIMITS.mps3 + LIMITS.ease_s  # to the peak along a trapezoid of eased jerk
    assert ramp.end_mps == pytest.approx(20.0)
    assert ramp.rise_s == pytest.approx(rise_s)
    assert ramp.duration_s == pytest.approx(20.0 / LIMITS.mps2 + rise_s)


def test_a_short_ramp_from_rest_eases_for_a_shorter_time():
    """A ramp that only eases has the distance 8 snap ease_s^4 / pi."""
    room = 0.01
    ramp = ramp_up(0.0, 5.0, room, LIMITS)
    ease_s = (room * math.pi / (8.0 * LIMITS.mps4)) ** 0.25
    assert ramp.ease_s == pytest.approx(ease_s, rel=1e-6)
    assert ramp.flat_s == 0.0
    assert ramp.distance_m == pytest.approx(room)


def test_in_motion_the_ease_is_complete_or_the_speed_does_not_change():
    small = ramp_up(4.0, 4.01, 100.0, LIMITS)
    assert small.ease_s == LIMITS.ease_s
    assert small.end_mps == pytest.approx(4.01)
    assert ramp_up(4.0, 5.0, 4.0 * 4.0 * LIMITS.ease_s, LIMITS) == constant_speed(4.0)


def test_no_change_takes_no_time():
    assert constant_speed(3.0).at(0.0) == (0.0, 3.0, 0.0)
    assert ramp_up(5.0, 3.0, 100.0, LIMITS).duration_s == 0.0
