"""The ideal navigator: flies timed legs on time, with rounded corners that the vehicle can fly.

No autopilot flies legs like this (theirs miss the schedule by seconds); it is what the author of a mission intends.

Velocity is constant on a leg. It changes to that of the next leg along a smooth step centred on the time of the
waypoint. Steps may overlap: velocity is the sum of all steps so far. A rounded corner costs no time, and passes its
waypoint at a distance of 5/32 of the change of velocity times the half width of the step.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from gcs.types import Array
from sim_bridge.autopilot.guidance.motion_primitives import MotionLimits
from sim_bridge.autopilot.guidance.piece import TERMS, Piece

_SAME_S = 1e-6
# s(r) = 1/2 + (15 r - 10 r^3 + 3 r^5) / 16 rises from 0 at r = -1 to 1 at r = 1; twice differentiable everywhere.
_STEP = np.polynomial.Polynomial([0.5, 15 / 16, 0.0, -10 / 16, 0.0, 3 / 16])
_STEP_SLOPES = [_STEP.deriv(k) if k else _STEP for k in range(TERMS - 1)]
_PEAKS = (15 / 16, 1.4434, 7.5)  # of its first three derivatives


@dataclass(frozen=True)
class IdealLeg:
    """A straight line to a waypoint in common local NED, and its duration. A pause is a leg without length."""

    to_ned_m: Array  # (3,)
    duration_s: float


def fly_legs(
    start_s: float, start: Array, legs: list[IdealLeg], limits: MotionLimits
) -> tuple[list[Piece], list[float]]:
    """Return the pieces from rest at `start` (4,) through all waypoints to rest, and the time at each waypoint.

    `start` is north, east, down and yaw. Yaw is constant.
    """
    points, times, passed = [start[:3]], [start_s], []
    for leg in legs:
        if leg.duration_s > _SAME_S:
            times.append(times[-1] + leg.duration_s)
            points.append(leg.to_ned_m)
        passed.append(times[-1])
    if len(points) == 1:
        return [], passed
    steps = _Steps.between(np.array(times), np.array(points), limits)
    pieces, position = [], start[:3]
    for begin, end in itertools.pairwise(steps.breaks_s()):
        coefficients = np.zeros((TERMS, 4))
        coefficients[0] = *position, start[3]
        coefficients[1:, :3] = steps.velocity_terms(0.5 * (begin + end), begin)
        pieces.append(Piece(begin, end, coefficients))
        position = pieces[-1].at(end)[0, :3]
    return pieces, passed


@dataclass(frozen=True)
class _Steps:
    """Velocity as a sum of smooth steps."""

    centre_s: Array  # (C,)
    half_s: Array  # (C,)
    change_mps: Array  # (C, 3)

    @classmethod
    def between(cls, times_s: Array, points_ned_m: Array, limits: MotionLimits) -> _Steps:
        """Return one step per waypoint. The first begins at the start, the last ends at the end: both are at rest."""
        lengths_s, displacements = np.diff(times_s), np.diff(points_ned_m, axis=0)
        centre = times_s.copy()
        speeds = displacements / lengths_s[:, None]
        rest = np.zeros((1, 3))
        half = np.array([_half_width_s(c, limits) for c in np.diff(np.concatenate([rest, speeds, rest]), axis=0)])
        half[0], half[-1] = min(half[0], 0.4 * lengths_s[0]), min(half[-1], 0.4 * lengths_s[-1])
        half[1:-1] = np.minimum(half[1:-1], np.minimum(times_s[1:-1] - times_s[0], times_s[-1] - times_s[1:-1]))
        # Moving these two inwards shortens the time at speed on the first and last leg: both are flown faster.
        centre[0] += half[0]
        centre[-1] -= half[-1]
        speeds = displacements / np.diff(centre)[:, None]
        return cls(centre, half, np.diff(np.concatenate([rest, speeds, rest]), axis=0))

    def breaks_s(self) -> list[float]:
        """The times where one polynomial ends and the next begins; times closer than 1 µs are merged."""
        edges = np.sort(np.concatenate([self.centre_s - self.half_s, self.centre_s + self.half_s]))
        first = np.concatenate([[True], np.diff(edges) > _SAME_S])
        return [*edges[first][:-1].tolist(), float(edges[-1])]

    def velocity_terms(self, inside_s: float, at_s: float) -> Array:
        """Return the Taylor terms of position about `at_s`, (TERMS - 1, 3), from the first power on.

        They are those of the piece that contains `inside_s`.
        """
        r_inside = (inside_s - self.centre_s) / self.half_s
        over, within = r_inside >= 1.0, np.abs(r_inside) < 1.0
        r = (at_s - self.centre_s[within]) / self.half_s[within]
        terms = np.zeros((TERMS - 1, 3))
        terms[0] = self.change_mps[over].sum(axis=0)
        for k, slope in enumerate(_STEP_SLOPES):
            weight = slope(r) / self.half_s[within] ** k / math.factorial(k + 1)
            terms[k] += weight @ self.change_mps[within]
        return terms


def _half_width_s(change_mps: Array, limits: MotionLimits) -> float:
    """Return half the shortest duration of this change of velocity within the limits."""
    level, climb = float(np.hypot(change_mps[0], change_mps[1])), abs(float(change_mps[2]))
    bounds = (limits.horizontal_mps2, limits.horizontal_mps3, limits.horizontal_mps4)
    widths = [
        (peak * level / limit) ** (1.0 / k) for k, (peak, limit) in enumerate(zip(_PEAKS, bounds, strict=True), 1)
    ]
    return float(max(*widths, _PEAKS[0] * climb / limits.vertical_mps2, 0.1))
