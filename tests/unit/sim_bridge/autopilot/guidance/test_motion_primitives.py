"""Manoeuvres: smooth at their joints, within their limits, exact derivatives."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.autopilot.guidance.ideal_navigator import IdealLeg, fly_legs
from sim_bridge.autopilot.guidance.motion_primitives import (
    MotionLimits,
    Speeds,
    brake,
    descend,
    descend_towards,
    rise,
    transfer,
    travel,
)
from sim_bridge.autopilot.guidance.piece import TERMS, Piece, PieceBatch, hold

LIMITS = MotionLimits(4.0, 1.6, 1.0, 0.2, 0.85, 0.5, 0.07)
REST = hold(0.0, np.array([1.0, 2.0, -3.0, 0.5])).at(0.0)


def sampled(piece: Piece, n: int = 400) -> np.ndarray:
    """Flat outputs (n, DERIVATIVES, 4) over a piece."""
    return np.array([piece.at(t) for t in np.linspace(piece.start_s, piece.end_s, n)])


def moving(north_mps: float, down_mps: float, pull_mps2: float) -> np.ndarray:
    flat = REST.copy()
    flat[1, 0], flat[1, 2], flat[2, 1] = north_mps, down_mps, pull_mps2
    return flat


def test_derivatives_are_derivatives():
    random = np.random.default_rng(1)
    piece = Piece(5.0, 9.0, random.normal(size=(TERMS, 4)))
    h = 1e-4
    for t in (5.5, 7.0):
        slope = (piece.at(t + h) - piece.at(t - h)) / (2 * h)
        np.testing.assert_allclose(slope[:-1], piece.at(t)[1:], rtol=1e-5)


def test_batch_agrees_with_each_piece():
    random = np.random.default_rng(2)
    pieces = [Piece(float(i), 9.0, random.normal(size=(TERMS, 4))) for i in range(3)]
    batch = PieceBatch([REST_PIECE, *pieces[1:]])
    batch.put(0, pieces[0])
    reference = batch.reference(4.2)
    for row, piece in enumerate(pieces):
        flat = piece.at(4.2)
        np.testing.assert_allclose(reference[row], flat, rtol=1e-12)


REST_PIECE = hold(0.0, REST)


@given(st.floats(-200, 200), st.floats(-30, 30), st.floats(-3, 3))
def test_transfer_from_rest_keeps_to_the_limits(north_m, up_m, turn_rad):
    target = REST[0] + [north_m, 0.3 * north_m, -up_m, turn_rad]
    piece = transfer(10.0, REST, target, LIMITS)
    flat = sampled(piece)
    np.testing.assert_allclose(flat[-1, 0], target, atol=1e-6)
    np.testing.assert_allclose(flat[-1, 1:4], 0.0, atol=1e-6)
    horizontal = np.linalg.norm(flat[:, :, :2], axis=2).max(axis=0)
    slack = 1.001
    assert horizontal[1] <= LIMITS.horizontal_mps * slack
    assert horizontal[2] <= LIMITS.horizontal_mps2 * slack
    assert horizontal[3] <= LIMITS.horizontal_mps3 * slack
    assert horizontal[4] <= LIMITS.horizontal_mps4 * slack
    assert abs(flat[:, 1, 2]).max() <= LIMITS.vertical_mps * slack
    assert abs(flat[:, 2, 2]).max() <= LIMITS.vertical_mps2 * slack
    assert abs(flat[:, 1, 3]).max() <= LIMITS.yaw_radps * slack


@given(st.floats(-5, 5), st.floats(-1.5, 1.5), st.floats(-0.5, 0.5))
def test_braking_ends_at_rest_and_begins_where_it_was(north_mps, down_mps, pull_mps2):
    flat = moving(north_mps, down_mps, pull_mps2)
    piece = brake(3.0, flat, LIMITS)
    np.testing.assert_allclose(piece.at(3.0)[:4], flat[:4], atol=1e-9)
    np.testing.assert_allclose(piece.at(piece.end_s)[1:4], 0.0, atol=1e-9)
    if not pull_mps2:
        assert abs(sampled(piece)[:, 2, 2]).max() <= LIMITS.vertical_mps2 * 1.001


@pytest.mark.parametrize("height_m", [3.0, 12.0, 60.0])
def test_descent_is_smooth_and_slow_at_the_end(height_m):
    start = hold(0.0, np.array([0.0, 0.0, -height_m, 0.0])).at(0.0)
    pieces = descend(0.0, start, 1.5, ((-10.0, 0.5),), LIMITS)
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_allclose(before.at(before.end_s)[:3], after.at(after.start_s)[:3], atol=1e-9)
    last = pieces[-1]
    assert math.isinf(last.end_s)
    assert last.at(last.start_s)[1, 2] == pytest.approx(0.5)
    assert last.at(last.start_s)[0, 2] <= max(-10.0, -height_m + 5.0) + 1e-9
    for piece in pieces[:-1]:
        assert abs(sampled(piece)[:, 2, 2]).max() <= LIMITS.vertical_mps2 * 1.001


@pytest.mark.parametrize("down_m", [-30.0, -9.0, -4.0, -0.6])
def test_a_descent_in_three_speeds_is_smooth_and_as_fast_as_there_is_room_for(down_m):
    start = np.zeros((5, 4))
    start[0, 2] = down_m
    pieces = descend(0.0, start, 1.5, ((-5.0, 0.7), (-1.0, 0.3)), LIMITS)
    for before, after in itertools.pairwise(pieces):
        assert before.end_s == after.start_s
        np.testing.assert_allclose(before.at(before.end_s)[:2], after.at(after.start_s)[:2], atol=1e-9)
    t_s = np.arange(0.0, pieces[-1].start_s + 10.0, 0.05)
    flown = np.array([next(p for p in pieces if t < p.end_s).at(t)[:2, 2] for t in t_s])
    height_m, speed = -flown[:, 0], flown[:, 1]
    assert (speed >= -1e-12).all()
    assert (speed[height_m < 1.0] <= 0.3 + 1e-9).all()
    assert (speed[(height_m < 5.0)] <= 0.7 + 1e-9).all()
    assert speed[-1] == pytest.approx(0.3)
    if down_m < -20.0:
        assert speed.max() == pytest.approx(min(1.5, LIMITS.vertical_mps))


def legs_of(start: np.ndarray, places: list[np.ndarray], speeds: list[float]) -> list[IdealLeg]:
    lengths = np.linalg.norm(np.diff([start[:3], *places], axis=0), axis=1)
    return [IdealLeg(p, length / v) for p, length, v in zip(places, lengths, speeds, strict=True)]


def test_legs_pass_every_waypoint_on_time_and_smoothly():
    places = [np.array(p) for p in ([30.0, 0, -3], [60, 8, -4], [95, 8, -6], [120, 0, -3])]
    speeds = [3.0, 3.5, 4.0, 2.0]
    start = np.array([0.0, 0.0, -3.0, 0.7])
    pieces, passed = fly_legs(100.0, start, legs_of(start, places, speeds), LIMITS)
    lengths = np.linalg.norm(np.diff([start[:3], *places], axis=0), axis=1)
    np.testing.assert_allclose(passed, 100.0 + np.cumsum(lengths / speeds))
    for place, t_s in zip(places, passed, strict=True):
        piece = next(p for p in pieces if p.end_s >= t_s - 1e-6)
        assert np.linalg.norm(piece.at(t_s)[0, :3] - place) < 1.0  # the rounding of a corner
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_allclose(before.at(before.end_s)[:4], after.at(after.start_s)[:4], atol=1e-6)
    first, last = pieces[0].at(100.0), pieces[-1].at(passed[-1])
    np.testing.assert_allclose(first[:3], [start, np.zeros(4), np.zeros(4)], atol=1e-6)
    np.testing.assert_allclose(last[:3], [[*places[-1], 0.7], np.zeros(4), np.zeros(4)], atol=1e-6)
    motion = np.concatenate([sampled(p, 50) for p in pieces])
    # First and last leg start and stop within their own time, which makes them a little faster.
    assert np.hypot(motion[:, 2, 0], motion[:, 2, 1]).max() <= LIMITS.horizontal_mps2 * 1.3
    assert np.abs(motion[:, 2, 2]).max() <= LIMITS.vertical_mps2 * 1.3


def test_many_uneven_legs_do_not_swing():
    """A curve that shares derivatives over legs of 1 s and 80 s would overshoot by metres; this keeps to the path."""
    start = np.array([0.0, 0.0, -3.0, 0.0])
    lengths, speeds = [1.0, 2.0, 400.0, 3.0, 2.0, 350.0, 4.0, 1.0], [1.0, 2.0, 5.0, 5.0, 4.8, 5.2, 3.0, 1.0]
    legs = legs_of(start, [np.array([x, 0.0, -3.0]) for x in np.cumsum(lengths)], speeds)
    pieces, passed = fly_legs(0.0, start, legs, LIMITS)
    t_s = np.linspace(0.0, passed[-1], 2000)
    on_path = np.interp(t_s, [0.0, *passed], [0.0, *np.cumsum(lengths)])
    ends = np.array([p.end_s for p in pieces])
    flown = [pieces[min(np.searchsorted(ends, t), len(pieces) - 1)].at(t)[0, 0] for t in t_s]
    assert np.abs(np.array(flown) - on_path).max() < 2.0


def test_waypoints_on_the_spot_take_no_time():
    start = np.array([0.0, 0.0, -3.0, 0.0])
    pieces, passed = fly_legs(7.0, start, [IdealLeg(start[:3], 0.0)], LIMITS)
    assert pieces == []
    assert passed == [7.0]


@given(st.floats(0.1, 60.0), st.floats(0.3, 1.6))
def test_a_rise_is_smooth_and_no_faster_than_asked(height_m, climb_mps):
    pieces = rise(2.0, REST, REST[0, 2] - height_m, climb_mps, LIMITS)
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_allclose(before.at(before.end_s)[:3], after.at(after.start_s)[:3], atol=1e-6)
    assert max(-sampled(piece)[:, 1, 2].min() for piece in pieces) <= climb_mps * 1.001
    end = pieces[-1].at(pieces[-1].end_s)
    np.testing.assert_allclose(end[0], REST[0] - [0.0, 0.0, height_m, 0.0], atol=1e-6)
    np.testing.assert_allclose(end[1:3], 0.0, atol=1e-6)


def test_a_descent_on_the_way_takes_both_parts_over_exactly():
    way = transfer(0.0, REST, REST[0] + [3.0, 1.0, 0.0, 0.2], LIMITS)
    from_s = 0.6 * way.end_s
    down = descend(from_s, hold(from_s, way.at(from_s)).at(from_s), 1.2, ((0.0, 0.4),), LIMITS)
    pieces = descend_towards(way, down)
    assert pieces[0].start_s == from_s
    assert math.isinf(pieces[-1].end_s)
    for piece in pieces:
        for t_s in np.linspace(piece.start_s, min(piece.end_s, piece.start_s + 5.0), 7):
            flat = piece.at(t_s)
            sinking = next(p for p in reversed(down) if p.start_s <= t_s + 1e-9)
            np.testing.assert_allclose(flat[:3, 2], sinking.at(t_s)[:3, 2], atol=1e-6)
            np.testing.assert_allclose(flat[0, :2], way.at(min(t_s, way.end_s))[0, :2], atol=1e-6)


@given(
    st.floats(-300, 300), st.floats(-300, 300), st.floats(-40, 40), st.floats(-4, 4), st.floats(-4, 4), st.floats(-1, 1)
)
def test_travel_from_any_motion_is_smooth_ends_there_and_cruises_as_fast_as_asked(north, east, down, vn, ve, pull):
    flat = REST.copy()
    flat[1, :2], flat[2, 0] = (vn, ve), pull
    target = REST[0] + [north, east, down, 0.3]
    pieces = travel(3.0, flat, target, Speeds(2.5, 1.0, 0.8), LIMITS)
    np.testing.assert_allclose(pieces[0].at(3.0)[:3], flat[:3], atol=1e-6)
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_allclose(before.at(before.end_s)[:3], after.at(after.start_s)[:3], atol=1e-6)
    end = pieces[-1].at(pieces[-1].end_s)
    np.testing.assert_allclose(end[0], target, atol=2e-3)
    np.testing.assert_allclose(end[1:3], 0.0, atol=1e-5)
    if len(pieces) == 3:
        level, steep = np.linalg.norm(pieces[1].at(pieces[1].start_s)[1, :2]), pieces[1].at(pieces[1].start_s)[1, 2]
        assert max(level / 2.5, -steep / 1.0, steep / 0.8) == pytest.approx(1.0, rel=1e-6)
