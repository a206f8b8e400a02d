"""Smooth ways from one state of motion to another: to a point, to a stop, up, and down to the ground.

Knows: polynomials that meet position, velocity, acceleration and jerk at their ends. Does not know: who asks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.quadrotor import Array
from sim_bridge.guidance.limits import MotionLimits
from sim_bridge.guidance.piece import TERMS, Piece, hold

# Peaks of the rest-to-rest polynomial of degree 7 over unit time and distance: velocity to snap.
_SEPTIC_PEAKS = (2.1875, 7.5132, 52.5, 840.0)
# Peaks of the smooth step of degree 5 that changes a velocity: its first and second derivative.
_STEP_PEAK, _STEP_PEAK2 = 1.875, 5.7735
_SHORTEST_S = 0.5


def _conditions(n: int) -> Array:
    """Matrix from coefficients to n derivatives at 0 and n at 1, inverted."""
    at_0 = np.diag([float(math.factorial(j)) for j in range(n)])
    at_1 = np.array([[float(math.perm(k, j)) for k in range(2 * n)] for j in range(n)])
    return np.asarray(np.linalg.inv(np.vstack([np.hstack([at_0, np.zeros((n, n))]), at_1])))


_SEPTIC = _conditions(4)
_QUINTIC = _conditions(3)


def _polynomial(inverse: Array, start: Array, end: Array, duration_s: float) -> Array:
    """Coefficients (2n, C) of the polynomial with `start` and `end` derivatives (n, C) over `duration_s`."""
    n = len(start)
    scale = duration_s ** np.arange(n)[:, None]
    unit = inverse @ np.vstack([start * scale, end * scale])
    return np.asarray(unit / duration_s ** np.arange(2 * n)[:, None])


def _shortest_s(distance: float, *peaks: float) -> float:
    """Shortest duration whose velocity, acceleration, ... over `distance` stay below `peaks`."""
    return max(
        math.pow(factor * distance / peak, 1.0 / order)
        for order, (factor, peak) in enumerate(zip(_SEPTIC_PEAKS, peaks, strict=False), start=1)
    )


def transfer(start_s: float, flat: Array, target: Array, limits: MotionLimits) -> Piece:
    """From any motion `flat` (DERIVATIVES, 4) to rest at `target` (4,): north, east, down, yaw.

    From rest it keeps to `limits`; from a fast start it takes the time to brake as well.
    """
    step = target - flat[0]
    duration = max(
        _SHORTEST_S,
        _shortest_s(
            math.hypot(step[0], step[1]),
            limits.horizontal_mps,
            limits.horizontal_mps2,
            limits.horizontal_mps3,
            limits.horizontal_mps4,
        ),
        _shortest_s(abs(step[2]), limits.vertical_mps, limits.vertical_mps2),
        _shortest_s(abs(step[3]), limits.yaw_radps),
    )
    if np.any(flat[1:3]):
        duration += _braking_time(flat, limits)
    end = np.zeros((4, 4))
    end[0] = target
    return Piece(start_s, start_s + duration, _polynomial(_SEPTIC, flat[:4], end, duration))


def bridge(start_s: float, start: Array, end_s: float, end: Array) -> Piece:
    """From one motion to another, both (3 or more, 4): the quintic through position, velocity and acceleration."""
    c = np.zeros((TERMS, 4))
    c[:6] = _polynomial(_QUINTIC, start[:3], end[:3], end_s - start_s)
    return Piece(start_s, end_s, c)


def brake(start_s: float, flat: Array, limits: MotionLimits) -> Piece:
    """From any motion to rest, wherever that is reached; yaw comes to rest too."""
    if not np.any(flat[1:3]):
        c = np.zeros((TERMS, 4))
        c[0] = flat[0]
        return Piece(start_s, start_s, c)
    duration = _braking_time(flat, limits)
    velocity = _polynomial(_QUINTIC, flat[1:4], np.zeros((3, 4)), duration)
    return Piece(start_s, start_s + duration, _integral(flat[0], velocity))


def _braking_time(flat: Array, limits: MotionLimits) -> float:
    speed, climb = math.hypot(flat[1, 0], flat[1, 1]), abs(flat[1, 2])
    pull = math.hypot(flat[2, 0], flat[2, 1])
    return float(
        max(
            _SHORTEST_S,
            _STEP_PEAK * speed / limits.horizontal_mps2,
            math.sqrt(_STEP_PEAK2 * speed / limits.horizontal_mps3),
            4.0 * pull / limits.horizontal_mps3,
            _STEP_PEAK * climb / limits.vertical_mps2,
        )
    )


def _integral(position: Array, velocity: Array) -> Array:
    """Coefficients (TERMS, 4) of the position whose derivative has coefficients (n, 4)."""
    n = len(velocity)
    c = np.zeros((TERMS, 4))
    c[0] = position
    c[1 : n + 1] = velocity / np.arange(1, n + 1)[:, None]
    return c


def rise(start_s: float, flat: Array, down_m: float, climb_mps: float, limits: MotionLimits) -> list[Piece]:
    """From rest straight up to rest at `down_m`, no faster than `climb_mps` for the most part."""
    target = flat[0].copy()
    target[2] = down_m
    speed = min(climb_mps, limits.vertical_mps)
    cruise_m = flat[0, 2] - down_m - 2.0 * _change_m(0.0, speed, limits)
    at_once = transfer(start_s, flat, target, limits)
    if cruise_m <= 0.0 or np.any(flat[1:3]):
        slowest_s = _SEPTIC_PEAKS[0] * abs(flat[0, 2] - down_m) / speed
        if at_once.end_s - start_s >= slowest_s or np.any(flat[1:3]):
            return [at_once]
        end = np.zeros((4, 4))
        end[0] = target
        return [Piece(start_s, start_s + slowest_s, _polynomial(_SEPTIC, flat[:4], end, slowest_s))]
    quicken = _change_descent(start_s, flat[0], (0.0, -speed), limits)
    cruise = _sink(quicken.end_s, _end(quicken), -speed, cruise_m / speed)
    return [quicken, cruise, _change_descent(cruise.end_s, _end(cruise), (-speed, 0.0), limits)]


@dataclass(frozen=True)
class Descent:
    """How to come down: at `fast_mps`, then from each of `slower` (down, m; m/s) on at its speed."""

    fast_mps: float
    slower: tuple[tuple[float, float], ...]


def descend(start_s: float, flat: Array, way: Descent, limits: MotionLimits) -> list[Piece]:
    """Straight down from rest until somebody stops it; a speed that there is no room for is left out.

    The last piece never ends: only contact tells a vehicle where the ground is.
    """
    speeds = [min(way.fast_mps, limits.vertical_mps), *(mps for _, mps in way.slower)]
    pieces: list[Piece] = []
    now_s, place, speed = start_s, flat[0], 0.0
    for (until_m, after), mps in zip(way.slower, speeds, strict=False):
        room_m = until_m - place[2] - _change_m(speed, mps, limits) - _change_m(mps, after, limits)
        if mps <= after or room_m <= 0.0:
            continue
        if speed != mps:
            pieces.append(_change_descent(now_s, place, (speed, mps), limits))
            now_s, place = pieces[-1].end_s, _end(pieces[-1])
        pieces.append(_sink(now_s, place, mps, room_m / mps))
        pieces.append(_change_descent(pieces[-1].end_s, _end(pieces[-1]), (mps, after), limits))
        now_s, place, speed = pieces[-1].end_s, _end(pieces[-1]), after
    if speed != speeds[-1]:
        pieces.append(_change_descent(now_s, place, (speed, speeds[-1]), limits))
    pieces.append(_sink(pieces[-1].end_s, _end(pieces[-1]), speeds[-1], math.inf))
    return pieces


def descend_towards(way: Piece, down: Sequence[Piece]) -> list[Piece]:
    """A descent straight `down` and, at the same time, what is left of a level `way`; then straight down."""
    stand = hold(way.end_s, way.at(way.end_s))
    ends = {way.end_s, *(piece.start_s for piece in down), *(piece.end_s for piece in down)}
    pieces, ahead = [], list(down)
    for start_s, end_s in pairwise(sorted(edge for edge in ends if edge >= down[0].start_s)):
        while ahead[0].end_s <= start_s:
            del ahead[0]
        c = _shifted(way if start_s < way.end_s else stand, start_s)
        c[:, 2] = _shifted(ahead[0], start_s)[:, 2]
        pieces.append(Piece(start_s, end_s, c))
    return pieces


def _shifted(piece: Piece, start_s: float) -> Array:
    """Coefficients (TERMS, 4) of the same polynomial in the time since `start_s`."""
    late_s = start_s - piece.start_s
    shift = [[math.comb(k, j) * late_s ** (k - j) if k >= j else 0.0 for k in range(TERMS)] for j in range(TERMS)]
    return np.asarray(np.array(shift) @ piece.coefficients)


def _change_s(before_mps: float, after_mps: float, limits: MotionLimits) -> float:
    return _STEP_PEAK * abs(after_mps - before_mps) / limits.vertical_mps2


def _change_m(before_mps: float, after_mps: float, limits: MotionLimits) -> float:
    return 0.5 * abs(before_mps + after_mps) * _change_s(before_mps, after_mps, limits)


def _change_descent(start_s: float, place: Array, down_mps: tuple[float, float], limits: MotionLimits) -> Piece:
    duration_s = _change_s(*down_mps, limits)
    start, end = np.zeros((3, 4)), np.zeros((3, 4))
    start[0, 2], end[0, 2] = down_mps
    velocity = _polynomial(_QUINTIC, start, end, duration_s)
    return Piece(start_s, start_s + duration_s, _integral(place, velocity))


def _sink(start_s: float, place: Array, speed_mps: float, duration_s: float) -> Piece:
    c = np.zeros((TERMS, 4))
    c[0] = place
    c[1, 2] = speed_mps
    return Piece(start_s, start_s + duration_s, c)


def _end(piece: Piece) -> Array:
    return np.asarray(piece.at(piece.end_s)[0])
