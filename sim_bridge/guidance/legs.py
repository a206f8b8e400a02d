"""The ideal navigator: timed legs flown exactly on time.

Knows: a curve through waypoints whose times follow from leg lengths and asked speeds. Does not know: MAVLink,
home, what comes before and after. No autopilot flies legs like this (theirs miss the schedule by seconds); it is
the behaviour that the mission's author has in mind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from gcs.quadrotor import Array
from sim_bridge.guidance.piece import TERMS, Piece

_SHORTEST_LEG_M = 1e-3


@dataclass(frozen=True)
class Leg:
    """Straight line to a waypoint in common local NED, and the mean speed asked for."""

    to_ned_m: Array  # (3,)
    speed_mps: float


def fly_legs(start_s: float, start: Array, legs: list[Leg]) -> tuple[list[Piece], list[float]]:
    """Pieces from rest at `start` (4,) (north, east, down, yaw) through all waypoints to rest at the last.

    Returns the pieces and the instant each waypoint is passed. The curve is a quintic spline in time, hence
    smooth up to its fourth derivative; a single leg is the rest-to-rest polynomial of degree 5. Yaw stays.
    """
    points, times, passed = [start[:3]], [start_s], []
    for leg in legs:
        length = float(np.linalg.norm(leg.to_ned_m - points[-1]))
        if length > _SHORTEST_LEG_M:
            times.append(times[-1] + length / leg.speed_mps)
            points.append(leg.to_ned_m)
        passed.append(times[-1])
    if len(points) == 1:
        return [], passed
    rest = [(1, np.zeros(3)), (2, np.zeros(3))]
    spline = make_interp_spline(np.array(times), np.array(points), k=5, bc_type=(rest, rest))
    begin_s = np.array(times[:-1])
    coefficients = np.zeros((len(begin_s), TERMS, 4))
    for k in range(6):
        coefficients[:, k, :3] = spline(begin_s, nu=k) / math.factorial(k)
    coefficients[:, 0, 3] = start[3]
    pieces = [Piece(t, end, c) for t, end, c in zip(times[:-1], times[1:], coefficients, strict=True)]
    return pieces, passed
