"""The legs of a vehicle as its autopilot gets them, and the times at which they are due.

A leg profile has the end points of a vehicle's legs, and the times at which shares of each leg are due.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.autopilots.waypoint_models.navigator import NavigatorOrders
from gcs.autopilots.waypoint_models.predict import NEAR_M, Prediction
from gcs.mission.machine_independent import ORDER_GRID, on_grid
from gcs.types import Array

SHARES = (1.0 / 3.0, 2.0 / 3.0, 1.0)  # of a leg, at which lateness is measured
_STILL_M = 0.01


@dataclass(frozen=True)
class LegProfile:
    """Legs between points (N + 1, 3), from rest at time 0.

    `due_s` (N, len(SHARES)) are the times at which these shares of each leg are due, `holds_s` (N,) the holds at leg
    ends. The end of a leg with a hold is due when the autopilot's delay begins. Speeds are between `slowest_mps` and
    `fastest_mps` (N,). `airborne_s` is the time flown before time 0.
    """

    points_ned_m: Array
    due_s: Array
    holds_s: Array
    slowest_mps: float
    fastest_mps: Array
    airborne_s: float = math.inf

    @property
    def lengths_m(self) -> Array:
        """Lengths of the legs (N,)."""
        return np.asarray(np.linalg.norm(np.diff(self.points_ned_m, axis=0), axis=1))

    @property
    def planned_mps(self) -> Array:
        """Speeds (N,) that keep the due times if each is reached at once."""
        left_s = np.concatenate([[0.0], (self.due_s[:, -1] + self.holds_s)[:-1]])
        speeds = self.lengths_m / np.maximum(self.due_s[:, -1] - left_s, 1e-3)
        return np.asarray(np.clip(speeds, self.slowest_mps, self.fastest_mps))

    def orders(self, speeds_mps: Array) -> NavigatorOrders:
        """The orders to fly these legs at speeds (N,)."""
        return NavigatorOrders.through(
            self.points_ned_m, speeds_mps.tolist(), self.holds_s.tolist(), airborne_s=self.airborne_s
        )

    def passed_s(self, flown: Prediction) -> Array:
        """The times (N, len(SHARES)) at which a flight passed the shares of each leg, between its steps."""
        chords = np.diff(self.points_ned_m, axis=0)
        times = np.empty((len(chords), len(SHARES)))
        begin = 0
        for leg, chord in enumerate(chords):
            end = max(int(np.searchsorted(flown.t_s, flown.passed_s[leg] - 1e-9)), begin + 1)
            end = min(end, len(flown.t_s) - 1)
            rows = slice(begin, end + 1)
            along = (flown.position_ned_m[rows] - self.points_ned_m[leg]) @ chord / (chord @ chord)
            times[leg] = np.interp(SHARES, np.maximum.accumulate(along), flown.t_s[rows])
            times[leg, -1] = self._nearest_s(flown, leg, end)
            left_s = flown.completed_s[leg] if self.holds_s[leg] > 0.0 else flown.t_s[end]
            begin = min(int(np.searchsorted(flown.t_s, left_s - 1e-9)), len(flown.t_s) - 2)
        return times

    def _nearest_s(self, flown: Prediction, leg: int, row: int) -> float:
        """The time of passing the end of a leg, refined within one step of `row`."""
        t_s = float(flown.t_s[row])
        if leg + 1 == len(self.holds_s):
            return t_s
        if self.holds_s[leg] > 0.0:
            return float(flown.completed_s[leg] - self.holds_s[leg])
        away, velocity = self.points_ned_m[leg + 1] - flown.position_ned_m[row], flown.velocity_ned_mps[row]
        step_s = float(flown.t_s[1] - flown.t_s[0])
        beside_s = float(away @ velocity) / max(float(velocity @ velocity), 1e-6)
        return t_s + min(max(beside_s, -step_s), step_s)


@dataclass(frozen=True)
class NavigatorLimits:
    """What a vehicle and its autopilot allow on a leg.

    No component of a speed exceeds `speed_ned_mps` (3,), and no speed `fastest_mps`. The autopilot's delay at a
    waypoint begins `delay_begins_m` from it, or with 0 once the vehicle rests there.
    """

    speed_ned_mps: Array
    slowest_mps: float
    fastest_mps: float
    delay_begins_m: float = 0.0


def leg_profile(
    t_s: Array, position_ned_m: Array, waypoints: list[int], limits: NavigatorLimits, airborne_s: float
) -> tuple[LegProfile, list[int]]:
    """The profile through samples (M, 3) at t_s (M,), and for each leg its number among pairs of `waypoints`.

    If the samples rest from one waypoint to the next, there is a hold instead of a leg, which ends when the samples
    leave. `airborne_s` is the time flown before the first sample. Points and due times are on `ORDER_GRID`.
    """
    ends_ned_m = on_grid(position_ned_m[waypoints], ORDER_GRID)
    legs: list[int] = []
    points = [ends_ned_m[0]]
    due: list[Array] = []
    holds: list[float] = []
    fastest: list[float] = []
    waited_s = 0.0
    for number, (i, j) in enumerate(pairwise(waypoints)):
        chord = ends_ned_m[number + 1] - points[-1]
        length = float(np.linalg.norm(chord))
        if length < _STILL_M and j != waypoints[-1]:
            if holds:
                if holds[-1] == 0.0:
                    begins_s = _near_s(t_s[: i + 1], position_ned_m[: i + 1], limits.delay_begins_m)
                    holds[-1] = float(t_s[i]) - begins_s
                    due[-1] = np.minimum(due[-1], begins_s - t_s[waypoints[0]] - waited_s)
                holds[-1] += float(t_s[j] - t_s[i])
            else:
                waited_s += float(t_s[j] - t_s[i])
            continue
        legs.append(number)
        moved = position_ned_m[i : j + 1] - points[-1]
        along = np.maximum.accumulate(moved @ chord) / max(length * length, 1e-12)
        due.append(np.interp(SHARES, along, t_s[i : j + 1]) - t_s[waypoints[0]] - waited_s)
        due[-1][-1] = t_s[j] - t_s[waypoints[0]] - waited_s
        holds.append(0.0)
        fastest.append(float(np.min(limits.speed_ned_mps / np.maximum(np.abs(chord) / max(length, _STILL_M), 1e-9))))
        points.append(ends_ned_m[number + 1])
        if j == waypoints[-1]:
            near = np.linalg.norm(position_ned_m[i : j + 1] - position_ned_m[j], axis=1) <= NEAR_M
            due[-1][-1] = min(due[-1][-1], t_s[i + int(np.argmax(near))] - t_s[waypoints[0]] - waited_s)
            due[-1] = np.minimum(due[-1], due[-1][-1])
    return (
        LegProfile(
            np.array(points),
            on_grid(np.array(due), ORDER_GRID),
            np.array(holds),
            limits.slowest_mps,
            np.clip(fastest, limits.slowest_mps, limits.fastest_mps),
            airborne_s + waited_s,
        ),
        legs,
    )


def _near_s(t_s: Array, position_ned_m: Array, near_m: float) -> float:
    """The time from which the samples stay within this distance of the last one."""
    far = np.flatnonzero(np.linalg.norm(position_ned_m - position_ned_m[-1], axis=1) > max(near_m, 1e-9))
    return float(t_s[far[-1] + 1]) if near_m > 0.0 and len(far) else float(t_s[-1])
