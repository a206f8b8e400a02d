"""Motion primitives: smooth polynomials from one state of motion to a position, to a stop, up, and down to the ground.

They match position, velocity, acceleration and jerk at their ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from gcs.autopilots.waypoint_models.navigator import UNLIMITED, Ability
from gcs.physics.quadrotor import Quadrotor
from gcs.scenario.schema.scenario import LimitsTable
from gcs.scenario.values.si import ability_of, physical_limits
from gcs.types import Array
from sim_bridge.autopilot.guidance.piece import TERMS, Piece, hold

# Shares of the physical limits; the remainder is for feedback.
_THRUST_SHARE = 0.35
_TILT_SHARE = 0.3
_TORQUE_SHARE = 0.3
_SPEED_SHARE = 0.8
# Peak velocity, acceleration, jerk and snap of the rest-to-rest polynomial of degree 7 over unit time and distance.
_SEPTIC_PEAKS = (2.1875, 7.5132, 52.5, 840.0)
# Peaks of the first three derivatives of the smooth step of degree 5 that changes a velocity.
_STEP_PEAK, _STEP_PEAK2, _STEP_PEAK3 = 1.875, 5.7735, 60.0
_SHORTEST_S = 0.5
_ROUNDS, _SETTLED_M = 8, 1e-3  # iterations to find the point where cruise begins, and their tolerance


@dataclass(frozen=True)
class MotionLimits:
    """Peak values that a manoeuvre respects; `ability` is the most the vehicle can do, without these shares."""

    horizontal_mps: float
    vertical_mps: float
    horizontal_mps2: float
    vertical_mps2: float
    horizontal_mps3: float
    horizontal_mps4: float
    yaw_radps: float
    ability: Ability = UNLIMITED

    @classmethod
    def of(cls, vehicle: Quadrotor, limits: LimitsTable) -> MotionLimits:
        """Return the limits of one type of vehicle: shares of its physical limits."""
        g, most = vehicle.gravity_mps2, physical_limits(vehicle, limits)
        return cls(
            horizontal_mps=_SPEED_SHARE * min(limits.speed_ned_mps[:2]),
            vertical_mps=_SPEED_SHARE * limits.speed_ned_mps[2],
            horizontal_mps2=min(_TILT_SHARE * most.sideways_mps2, 2.5),
            vertical_mps2=min(max(_THRUST_SHARE * most.upwards_mps2, 0.05), 1.5),
            horizontal_mps3=0.5 * g * most.tilt_rate_radps,
            horizontal_mps4=_TORQUE_SHARE * g * most.tilt_accel_radps2,
            yaw_radps=_SPEED_SHARE * math.radians(limits.rates_degps[2]),
            ability=ability_of(vehicle, limits),
        )


def _conditions(n: int) -> Array:
    """Return the inverse of the matrix from coefficients to n derivatives at 0 and n derivatives at 1."""
    at_0 = np.diag([float(math.factorial(j)) for j in range(n)])
    at_1 = np.array([[float(math.perm(k, j)) for k in range(2 * n)] for j in range(n)])
    return np.asarray(np.linalg.inv(np.vstack([np.hstack([at_0, np.zeros((n, n))]), at_1])))


@lru_cache(maxsize=256)  # all pieces of a navigator have the same duration
def _inverse(n: int, duration_s: float) -> Array:
    """Return the same matrix for a polynomial over `duration_s`."""
    powers = duration_s ** np.arange(2 * n)
    return np.asarray(_CONDITIONS[n] * np.tile(powers[:n], 2) / powers[:, None])


_CONDITIONS = {n: _conditions(n) for n in (3, 4)}


def _polynomial(start: Array, end: Array, duration_s: float) -> Array:
    """Return the coefficients (2n, C) of the polynomial with `start` and `end` derivatives (n, C) over `duration_s`."""
    return np.asarray(_inverse(len(start), duration_s).dot(np.concatenate((start, end))))


def _shortest_s(distance: float, *peaks: float) -> float:
    """Return the shortest duration whose velocity, acceleration, ... over `distance` stay below `peaks`."""
    return max(
        math.pow(factor * distance / peak, 1.0 / order)
        for order, (factor, peak) in enumerate(zip(_SEPTIC_PEAKS, peaks, strict=False), start=1)
    )


@dataclass(frozen=True)
class Speeds:
    """The speeds to fly at, in m/s: over ground, up, down."""

    horizontal: float
    up: float
    down: float


def transfer(start_s: float, flat: Array, target: Array, limits: MotionLimits) -> Piece:
    """Return the piece from any motion `flat` (DERIVATIVES, 4) to rest at `target` (4,): north, east, down, yaw.

    From rest it respects `limits`; from a fast start it also takes the time to brake.
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
    return Piece(start_s, start_s + duration, _polynomial(flat[:4], end, duration))


def bridge(start_s: float, start: Array, end_s: float, end: Array) -> Piece:
    """Return the quintic from one motion to another, both (3 or more, 4), in position, velocity and acceleration."""
    c = np.zeros((TERMS, 4))
    c[:6] = _polynomial(start[:3], end[:3], end_s - start_s)
    return Piece(start_s, end_s, c)


def brake(start_s: float, flat: Array, limits: MotionLimits) -> Piece:
    """Return the piece from any motion to rest, wherever that is; yaw also comes to rest."""
    if not np.any(flat[1:3]):
        c = np.zeros((TERMS, 4))
        c[0] = flat[0]
        return Piece(start_s, start_s, c)
    duration = _braking_time(flat, limits)
    velocity = _polynomial(flat[1:4], np.zeros((3, 4)), duration)
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
    """Return the coefficients (TERMS, 4) of the position whose velocity has coefficients (n, 4)."""
    n = len(velocity)
    c = np.zeros((TERMS, 4))
    c[0] = position
    c[1 : n + 1] = velocity / np.arange(1, n + 1)[:, None]
    return c


def travel(start_s: float, flat: Array, target: Array, speeds_mps: Speeds, limits: MotionLimits) -> list[Piece]:
    """Return the pieces from any motion to rest at `target` (4,): straight at cruise speed, or one transfer if near."""
    step = target - flat[0]
    limits = replace(
        limits,
        horizontal_mps=min(limits.horizontal_mps, speeds_mps.horizontal),
        vertical_mps=min(limits.vertical_mps, speeds_mps.down if step[2] > 0.0 else speeds_mps.up),
    )
    turn_s = _shortest_s(abs(step[3]), limits.yaw_radps)
    leg = _cruise(flat, target, limits)
    if leg is None or leg.whole_s < turn_s:
        return [transfer(start_s, flat, target, limits)]
    end = np.zeros((4, 4))
    end[0] = target
    turn = Piece(start_s, start_s + leg.whole_s, _polynomial(flat[:4], end, leg.whole_s))
    rest, cruise = np.zeros((3, 4)), np.vstack([leg.velocity_mps, np.zeros((2, 4))])
    pieces: list[Piece] = []
    place = flat[0]
    parts = ((flat[1:4], cruise, leg.begin_s), (cruise, cruise, leg.cruise_s), (cruise, rest, leg.end_s))
    for before, after, lasts_s in parts:
        now_s = pieces[-1].end_s if pieces else start_s
        c = _integral(place, _polynomial(before, after, lasts_s))
        c[:, 3] = _shifted(turn, now_s)[:, 3]
        pieces.append(Piece(now_s, now_s + lasts_s, c))
        place = _end(pieces[-1])
    return pieces


@dataclass(frozen=True)
class _CruiseLeg:
    """A straight leg at constant velocity, after `begin_s` of acceleration and before `end_s` of braking."""

    velocity_mps: Array  # (4,)
    begin_s: float
    cruise_s: float
    end_s: float

    @property
    def whole_s(self) -> float:
        return self.begin_s + self.cruise_s + self.end_s


def _cruise(flat: Array, target: Array, limits: MotionLimits) -> _CruiseLeg | None:
    """Return the cruise leg from a motion to `target`; None if the distance is too short for it.

    The start of cruise depends on its direction, and the direction on the start: a few iterations solve this.
    """
    velocity = np.zeros(4)
    begin_s = cruise_s = end_s = 0.0
    for _ in range(_ROUNDS):
        left = target[:3] - _place_after(flat, velocity, begin_s)
        length_m = float(np.linalg.norm(left))
        if not length_m:
            return None
        along = left / length_m
        level, steep = math.hypot(along[0], along[1]), abs(float(along[2]))
        speed = min(_along(limits.horizontal_mps, level), _along(limits.vertical_mps, steep))
        velocity[:3] = speed * along
        end_s = _change_time(velocity, limits)
        begin_s = max(
            _change_time(velocity - flat[1], limits), _braking_time(flat, limits) if np.any(flat[1:3]) else 0.0
        )
        cruise_s = length_m / speed - 0.5 * end_s
    settled = np.linalg.norm(
        _place_after(flat, velocity, begin_s) + velocity[:3] * (cruise_s + 0.5 * end_s) - target[:3]
    )
    return _CruiseLeg(velocity, begin_s, cruise_s, end_s) if cruise_s > 0.0 and settled < _SETTLED_M else None


def _place_after(flat: Array, velocity: Array, duration_s: float) -> Array:
    """Return the position (3,) at the end of the quintic change of a motion into a constant velocity (4,)."""
    if duration_s <= 0.0:
        return np.asarray(flat[0, :3])
    after = np.vstack([velocity, np.zeros((2, 4))])
    c = _integral(flat[0], _polynomial(flat[1:4], after, duration_s))
    return np.asarray((duration_s ** np.arange(TERMS) @ c)[:3])


def _change_time(change: Array, limits: MotionLimits) -> float:
    """Return the duration of a smooth change of velocity (4,) within the limits."""
    level, steep = math.hypot(change[0], change[1]), abs(change[2])
    return float(
        max(
            _STEP_PEAK * level / limits.horizontal_mps2,
            math.sqrt(_STEP_PEAK2 * level / limits.horizontal_mps3),
            math.cbrt(_STEP_PEAK3 * level / limits.horizontal_mps4),
            _STEP_PEAK * steep / limits.vertical_mps2,
        )
    )


def _along(limit: float, share: float) -> float:
    return limit / share if share > 0.0 else math.inf


def rise(start_s: float, flat: Array, down_m: float, climb_mps: float, limits: MotionLimits) -> list[Piece]:
    """Return the pieces straight up to rest at `down_m`, no faster than `climb_mps`."""
    target = flat[0].copy()
    target[2] = down_m
    return travel(start_s, flat, target, Speeds(math.inf, climb_mps, math.inf), limits)


def braking_m(speed_mps: float, most_mps2: float) -> float:
    """Return how far above its goal ArduPilot brakes from this speed: gain 1/s where that is gentler than the limit."""
    return speed_mps if speed_mps <= most_mps2 else speed_mps**2 / (2.0 * most_mps2) + most_mps2 / 2.0


def descend(
    start_s: float, flat: Array, fast_mps: float, slower: Sequence[tuple[float, float]], limits: MotionLimits
) -> list[Piece]:
    """Return the pieces straight down from rest: at `fast_mps`, then below each of `slower` (down, m) at its m/s.

    A speed without enough height for it is left out.
    The last piece never ends: only ground contact ends the descent.
    """
    speeds = [min(fast_mps, limits.vertical_mps), *(mps for _, mps in slower)]
    pieces: list[Piece] = []
    now_s, place, speed = start_s, flat[0], 0.0
    for (until_m, after), mps in zip(slower, speeds, strict=False):
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


def descend_towards(level: Piece, down: Sequence[Piece]) -> list[Piece]:
    """Return a descent straight `down`, combined with the remainder of a `level` piece; then straight down."""
    stand = hold(level.end_s, level.at(level.end_s))
    ends = {level.end_s, *(piece.start_s for piece in down), *(piece.end_s for piece in down)}
    pieces, ahead = [], list(down)
    for start_s, end_s in pairwise(sorted(edge for edge in ends if edge >= down[0].start_s)):
        while ahead[0].end_s <= start_s:
            del ahead[0]
        c = _shifted(level if start_s < level.end_s else stand, start_s)
        c[:, 2] = _shifted(ahead[0], start_s)[:, 2]
        pieces.append(Piece(start_s, end_s, c))
    return pieces


def _shifted(piece: Piece, start_s: float) -> Array:
    """Return the coefficients (TERMS, 4) of the same polynomial in the time since `start_s`."""
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
    velocity = _polynomial(start, end, duration_s)
    return Piece(start_s, start_s + duration_s, _integral(place, velocity))


def _sink(start_s: float, place: Array, speed_mps: float, duration_s: float) -> Piece:
    c = np.zeros((TERMS, 4))
    c[0] = place
    c[1, 2] = speed_mps
    return Piece(start_s, start_s + duration_s, c)


def _end(piece: Piece) -> Array:
    return np.asarray(piece.at(piece.end_s)[0])
