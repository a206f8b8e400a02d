"""Fewer points for a recorded line: those that it needs to stay within a tolerance, in three dimensions."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import Array

_CLIMB_M, _STILL_M = 2.0, 3.0  # a take-off climbs more, and stays so near to where it began


def thinned(points_m: Array, tolerance_m: float, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the points (N, 3) a line within `tolerance_m` of all points needs (N,); those of `kept` stay.

    Between two points that stay, the point farthest from the straight line stays too, until none is too far.
    """
    stays = kept.copy()
    stays[[0, -1]] = True
    rows = np.flatnonzero(stays)
    waiting = list(itertools.pairwise(rows.tolist()))
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        away_m = _away_m(points_m[first + 1 : last], points_m[first], points_m[last])
        farthest = int(away_m.argmax())
        if away_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            stays[middle] = True
            waiting += [(first, middle), (middle, last)]
    return stays


def airborne(points_m: Array) -> tuple[int, int]:
    """The rows of the first and the last point of a track (N, 3) between its vertical take-off and landing.

    Without a take-off or a landing in the track it is 0, or N - 1.
    """
    return _top(points_m), len(points_m) - 1 - _top(points_m[::-1])


def _top(points_m: Array) -> int:
    """The row at which a vertical climb from the first point ends; 0 if there is none."""
    is_away = np.hypot(*(points_m[:, :2] - points_m[0, :2]).T) > _STILL_M
    rows = int(is_away.argmax()) if is_away.any() else len(points_m)
    climbed_m = points_m[:rows, 2] - points_m[0, 2]
    return int(climbed_m.argmax()) if climbed_m.max() >= _CLIMB_M else 0


def _away_m(points_m: Array, start_m: Array, end_m: Array) -> Array:
    """The distances of points (N, 3) from the straight line between two points, m."""
    along = end_m - start_m
    length2 = float(along @ along)
    share = np.clip((points_m - start_m) @ along / length2, 0.0, 1.0) if length2 else np.zeros(len(points_m))
    return np.asarray(np.linalg.norm(points_m - start_m - share[:, None] * along, axis=1))
