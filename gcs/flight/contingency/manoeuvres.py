"""Reference trajectories of contingencies: hold, climb, return, rejoin; in plan time and the common local NED frame.

Their acceleration is bounded, and all of them end at rest.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.flight.offboard.reference_trajectory import ReferenceTrajectory, Values
from gcs.mission.failsafe.return_routes import ReturnRoutes
from gcs.mission.failsafe.routed.routed_motion import ACCEL_MPS2, PiecewiseMotion, routed_motion, stops
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.physics.quadrotor import Array

BRAKE_MPS2 = ACCEL_MPS2
SPREAD_MPS, SPREAD_MPS2 = 1.0, 0.75  # while it brakes


@dataclass(frozen=True)
class ReferenceLeg:
    """A straight leg from `start` by `travel` (3,) in `duration_s`: from rest to rest, or braking to rest."""

    start: Array
    travel: Array
    duration_s: float
    rise_s: float  # of speed, and its fall
    braking: bool = False

    def at(self, t_s: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, (3,) each, `t_s` after the start."""
        length = float(np.linalg.norm(self.travel))
        if length == 0.0 or self.duration_s == 0.0:
            return self.start, np.zeros(3), np.zeros(3)
        along = self.travel / length
        t_s = min(max(t_s, 0.0), self.duration_s)
        left_s = self.duration_s - t_s
        if self.braking:
            a = 2.0 * length / self.duration_s**2
            passed, speed, push = length - a * left_s**2 / 2, a * left_s, -a
        else:
            top = length / (self.duration_s - self.rise_s)
            a = top / self.rise_s
            if t_s < self.rise_s:
                passed, speed, push = a * t_s**2 / 2, a * t_s, a
            elif left_s < self.rise_s:
                passed, speed, push = length - a * left_s**2 / 2, a * left_s, -a
            else:
                passed, speed, push = top * (t_s - self.rise_s / 2), top, 0.0
        return self.start + passed * along, speed * along, push * along


def leg(start: Array, end: Array, speed_mps: float, accel_mps2: float = BRAKE_MPS2) -> ReferenceLeg:
    """Return a leg from rest to rest at `speed_mps` or less."""
    travel = np.asarray(end) - start
    length = float(np.linalg.norm(travel))
    top = min(speed_mps, math.sqrt(length * accel_mps2))
    return ReferenceLeg(start, travel, length / top + top / accel_mps2 if top else 0.0, top / accel_mps2)


def braking(position: Array, velocity: Array, accel_mps2: float = BRAKE_MPS2) -> ReferenceLeg:
    """Return a leg that brakes straight on to a stop."""
    speed = float(np.linalg.norm(velocity))
    return ReferenceLeg(position, velocity * speed / (2.0 * accel_mps2), speed / accel_mps2, 0.0, braking=True)


class LegsReference:
    """Legs one after the other from plan time `begin_s` on, then rest; a leg `beside` is added to them."""

    def __init__(
        self, legs: Sequence[ReferenceLeg], begin_s: float, yaw_ned_rad: float, beside: ReferenceLeg | None = None
    ) -> None:
        self.begin_s = begin_s
        durations_s = [sum(one.duration_s for one in legs), beside.duration_s if beside is not None else 0.0]
        self.end_s = begin_s + max(durations_s)
        self._legs_end_s = begin_s + durations_s[0]
        self._legs = tuple(legs)
        self._beside = beside
        self._yaw_ned_rad = yaw_ned_rad

    def at(self, k: int, t_s: float) -> Values:
        """Return the setpoint of the legs at plan time `t_s`."""
        del k
        passed_s = t_s - self.begin_s
        for one in self._legs[:-1]:
            if passed_s < one.duration_s:
                break
            passed_s -= one.duration_s
        else:
            one = self._legs[-1]
        position, velocity, acceleration = one.at(passed_s)
        if t_s >= self._legs_end_s or t_s < self.begin_s:  # rest has no acceleration
            velocity, acceleration = (velocity, np.zeros(3)) if t_s < self.begin_s else (np.zeros(3), np.zeros(3))
        if self._beside is not None and t_s > self.begin_s:
            moved, rate, push = self._beside.at(t_s - self.begin_s)
            still = t_s >= self.begin_s + self._beside.duration_s
            position, velocity = position + moved, velocity if still else velocity + rate
            acceleration = acceleration if still else acceleration + push
        return (*position.tolist(), *velocity.tolist(), *acceleration.tolist(), self._yaw_ned_rad)


def hold_reference(position: Array, velocity: Array, yaw_ned_rad: float, begin_s: float) -> LegsReference:
    """Return a reference that brakes and holds."""
    return LegsReference([braking(position, velocity)], begin_s, yaw_ned_rad)


def spread_reference(
    position: Array, velocity: Array, yaw_ned_rad: float, begin_s: float, up_m: float
) -> LegsReference:
    """Return a reference that brakes, climbs by `up_m` meanwhile, and holds."""
    climb = leg(np.zeros(3), np.array([0.0, 0.0, -up_m]), SPREAD_MPS, SPREAD_MPS2)
    return LegsReference([braking(position, velocity)], begin_s, yaw_ned_rad, beside=climb)


class ReturnReference:
    """A return that begins at plan time `begin_s`, as it was verified."""

    def __init__(self, motion: PiecewiseMotion, begin_s: float, yaw_ned_rad: float) -> None:
        self.begin_s = begin_s
        self.end_s = begin_s + float(motion.times_s[0, -1])
        self._times_s: list[float] = motion.times_s[0].tolist()
        self._places, self._velocities = motion.places[0], motion.velocities[0]
        self._yaw_ned_rad = yaw_ned_rad

    def at(self, k: int, t_s: float) -> Values:
        """Return the setpoint of the return at plan time `t_s`."""
        del k
        passed_s = t_s - self.begin_s
        piece = bisect_right(self._times_s, passed_s)
        if piece == 0 or piece == len(self._times_s):  # waits to begin, or rests
            knot = 0 if piece == 0 else -1
            return (*self._places[knot].tolist(), *self._velocities[knot].tolist(), 0.0, 0.0, 0.0, self._yaw_ned_rad)
        begin_s, end_s = self._times_s[piece - 1], self._times_s[piece]
        start = self._velocities[piece - 1]
        push = (self._velocities[piece] - start) / (end_s - begin_s)
        left_s = passed_s - begin_s
        position = self._places[piece - 1] + start * left_s + push * left_s**2 / 2
        return (*position.tolist(), *(start + push * left_s).tolist(), *push.tolist(), self._yaw_ned_rad)


def return_reference(
    position: Array,
    velocity: Array,
    yaw_ned_rad: float,
    begin_s: float,
    routes: ReturnRoutes,
    end_ned_m: Array,
    top_down_m: float,
    speeds: ReturnSpeeds,
    end_above_m: float,
) -> ReturnReference | None:
    """Return a reference as returns are verified: brake, climb to `top_down_m`, follow the way to the end, descend.

    The way leads round no-fly zones and keeps inside the fence; None without a way. A higher vehicle keeps its
    altitude. It ends `end_above_m` above `end_ned_m`.
    """
    stop = stops(position[None], velocity[None], np.array([begin_s]), routes)
    here = stop.end_ned_m[0]
    way = routes.way_ned_m(here, end_ned_m, begin_s)
    if way is None:
        return None
    top = np.array([min(top_down_m, float(here[2]))])
    low = np.array([float(end_ned_m[2]) - end_above_m])
    return ReturnReference(routed_motion(stop, way[None], top, low, speeds), begin_s, yaw_ned_rad)


class RejoinReference:
    """Another reference plus the vehicle's deviation from it, which fades in `fade_s`, its velocity too."""

    def __init__(self, base: ReferenceTrajectory, off_m: Array, off_mps: Array, begin_s: float, fade_s: float) -> None:
        self.base = base
        self._begin_s = begin_s
        self._fade_s = fade_s
        # A quintic from (deviation, its rate, 0) to rest at zero, in s = t / fade.
        p, v = np.asarray(off_m), np.asarray(off_mps) * fade_s
        self._c = np.array([-6 * p - 3 * v, 15 * p + 8 * v, -10 * p - 6 * v, 0 * p, v, p])

    def at(self, k: int, t_s: float) -> Values | None:
        """Return the other reference's setpoint plus the deviation that is left."""
        values = self.base.at(k, t_s)
        s = (t_s - self._begin_s) / self._fade_s
        if values is None or s >= 1.0:
            return values
        s = max(s, 0.0)
        off = [
            np.polyval(np.polynomial.polynomial.polyder(self._c[::-1], n)[::-1], s) / self._fade_s**n for n in (0, 1, 2)
        ]
        moved = np.array(values[:9]) + np.concatenate(off)
        return (*moved.tolist(), values[9])
