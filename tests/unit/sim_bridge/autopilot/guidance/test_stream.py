"""Streams: setpoints wait for their time, what lies between is smooth, what comes after is ArduPilot's habit."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.autopilot.guidance.stream import JUST_IN_TIME_S, SetpointFollower, StampedSetpoint

W = 0.7  # rad/s of a circle of 2 m
PERIOD_S = 0.04


def on_circle(t_s: float) -> np.ndarray:
    """Position to acceleration on the circle, rounded to what float32 carries 1500 m from the origin."""
    s, c = np.sin(W * t_s), np.cos(W * t_s)
    flat = np.zeros((3, 4))
    flat[0, :2] = 1500 + 2 * s, 1500 + 2 * c
    flat[1, :2] = 2 * W * c, -2 * W * s
    flat[2, :2] = -2 * W * W * s, -2 * W * W * c
    return flat.astype(np.float32).astype(np.float64)


def follower(n: int) -> SetpointFollower:
    it = SetpointFollower()
    for k in range(n):
        it.add(StampedSetpoint(k * PERIOD_S, on_circle(k * PERIOD_S)))
    return it


def test_between_setpoints_it_is_the_curve_with_jerk_and_snap():
    stream = follower(30)
    for k in range(1, 20):
        stream.advance(k * PERIOD_S)
        piece = stream.piece(3.0)
        assert piece.start_s == pytest.approx(k * PERIOD_S)
        assert piece.end_s == pytest.approx((k + 1) * PERIOD_S)
        t = piece.start_s + 0.5 * PERIOD_S
        s, c = np.sin(W * t), np.cos(W * t)
        got = piece.at(t)
        np.testing.assert_allclose(got[0, :2], [1500 + 2 * s, 1500 + 2 * c], atol=2e-4)
        np.testing.assert_allclose(got[1, :2], [2 * W * c, -2 * W * s], atol=1e-5)
        np.testing.assert_allclose(got[2, :2], [-2 * W**2 * s, -2 * W**2 * c], atol=1e-5)
        np.testing.assert_allclose(got[3, :2], [-2 * W**3 * c, 2 * W**3 * s], atol=1e-3)
        np.testing.assert_allclose(got[4, :2], [2 * W**4 * s, 2 * W**4 * c], atol=0.05)


def test_order_of_arrival_does_not_matter():
    ordered, shuffled = follower(10), SetpointFollower()
    for k in (3, 1, 0, 2, 5, 4, 9, 8, 6, 7):
        shuffled.add(StampedSetpoint(k * PERIOD_S, on_circle(k * PERIOD_S)))
    for stream in (ordered, shuffled):
        stream.advance(0.2)
    np.testing.assert_array_equal(ordered.piece(3.0).coefficients, shuffled.piece(3.0).coefficients)


def test_without_a_next_one_velocity_and_acceleration_are_held():
    stream = follower(3)
    stream.advance(1.0)
    piece = stream.piece(3.0)
    last = on_circle(2 * PERIOD_S)
    assert piece.end_s == pytest.approx(2 * PERIOD_S + 3.0)
    at_end = piece.at(piece.end_s)
    np.testing.assert_allclose(at_end[1], last[1] + 3.0 * last[2])
    np.testing.assert_allclose(at_end[2], last[2])


def test_it_awaits_more_only_when_it_would_have_to_guess():
    stream = follower(3)
    stream.advance(0.0)
    assert stream.awaits_more_after_s(PERIOD_S) is None
    stream.advance(2 * PERIOD_S)
    assert stream.awaits_more_after_s(2 * PERIOD_S) == 2 * PERIOD_S
    stream.add(StampedSetpoint(3 * PERIOD_S, on_circle(3 * PERIOD_S)))
    assert stream.awaits_more_after_s(2 * PERIOD_S) is None


def test_a_stream_sent_just_in_time_is_awaited_after_a_margin():
    """Else time is as fast as the ground station takes it to be, and that is ever slower."""
    stream = SetpointFollower()
    stream.add(StampedSetpoint(1.0, on_circle(1.0), arrived_s=0.98))
    stream.advance(1.0)
    assert stream.awaits_more_after_s(1.0 + 0.9 * JUST_IN_TIME_S) is None
    assert stream.awaits_more_after_s(1.0 + JUST_IN_TIME_S) == 1.0
    stream.add(StampedSetpoint(1.2, on_circle(1.2), arrived_s=1.0))
    for t_s in (1.2, 1.3, 3.1):
        stream.add(StampedSetpoint(t_s, on_circle(t_s), arrived_s=t_s))
        stream.advance(t_s)
        assert stream.awaits_more_after_s(t_s) == t_s, "one came early: the ground station sends ahead"
    stream.add(StampedSetpoint(3.3, on_circle(3.3), arrived_s=3.3))
    stream.advance(3.3)
    assert stream.awaits_more_after_s(3.3) is None


def test_unstamped_streams_are_never_awaited():
    stream = SetpointFollower()
    stream.add(StampedSetpoint(1.0, on_circle(1.0), stamped=False))
    stream.advance(1.0)
    assert stream.awaits_more_after_s(2.0) is None


def test_what_is_older_than_the_one_in_force_is_dropped():
    stream = follower(5)
    stream.advance(0.16)
    before = stream.piece(3.0).coefficients
    stream.add(StampedSetpoint(0.08, np.zeros((3, 4))))
    stream.advance(0.16)
    np.testing.assert_array_equal(stream.piece(3.0).coefficients, before)


def test_yaw_turns_the_short_way():
    stream = SetpointFollower()
    for t_s, yaw in ((0.0, 3.1), (0.1, -3.1)):
        flat = np.zeros((3, 4))
        flat[0, 3] = yaw
        stream.add(StampedSetpoint(t_s, flat))
    stream.advance(0.0)
    piece = stream.piece(3.0)
    assert piece.at(0.1)[0, 3] == pytest.approx(2 * np.pi - 3.1)
