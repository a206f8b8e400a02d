"""Exact least distances between vehicles: of a rigid shape, and of vehicles that fly straight in step.

In step: at every instant every vehicle has flown the same share of its path, under any time scaling. The least distance
then depends on start and end alone.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gcs.scenario.validation.spacing import nearest_pair
from gcs.types import Array

_CHUNK = 128  # rows of the table of pairs at a time: a thousand vehicles in a few megabytes
_NO_PAIR = (np.inf, 0, 0)


def least_distance(start_ned_m: Array, end_ned_m: Array) -> tuple[float, int, int]:
    """Least distance, in m, between any two vehicles from start (V, 3) to end (V, 3), and their rows i < j.

    Infinite for a single vehicle.
    """
    best: tuple[float, int, int] = _NO_PAIR
    for first, squared in _blocks(start_ned_m, end_ned_m):
        row, column = np.unravel_index(int(squared.argmin()), squared.shape)
        if squared[row, column] < best[0]:
            best = (float(squared[row, column]), first + int(row), int(column))
    return float(np.sqrt(best[0])), best[1], best[2]


def pairs_nearer_than(start_ned_m: Array, end_ned_m: Array, distance_m: float) -> NDArray[np.intp]:
    """Rows (M, 2), i < j, of all pairs that come nearer than `distance_m` between start and end."""
    found = [np.empty((0, 2), dtype=np.intp)]
    for first, squared in _blocks(start_ned_m, end_ned_m):
        rows, columns = np.nonzero(squared < distance_m**2)
        found.append(np.column_stack([rows + first, columns]))
    return np.concatenate(found)


def least_gap(offsets_ned_m: Array) -> tuple[float, int, int]:
    """Least distance, in m, between any two vehicles of a rigid shape (V, 3), and their rows i < j."""
    pair = nearest_pair(offsets_ned_m)
    return _NO_PAIR if pair is None else (pair.distance_m, pair.first, pair.second)


def near_point(start_ned_m: Array, end_ned_m: Array, point_ned_m: Array) -> Array:
    """Least distance (...,), m, of straight paths from start (..., 3) to end (..., 3) to a fixed point."""
    return np.asarray(np.sqrt(_least_squared(start_ned_m - point_ned_m, end_ned_m - point_ned_m)))


def _least_squared(before: Array, after: Array) -> Array:
    """Least |before + s (after - before)|^2 over s in [0, 1], along the last axis."""
    change = after - before
    length = np.einsum("...i,...i->...", change, change)
    toward = -np.einsum("...i,...i->...", before, change)
    share = np.clip(np.divide(toward, length, out=np.zeros_like(length), where=length > 0.0), 0.0, 1.0)
    nearest = before + share[..., None] * change
    return np.asarray(np.einsum("...i,...i->...", nearest, nearest))


def _blocks(start: Array, end: Array) -> Iterator[tuple[int, Array]]:
    """The table of squared least distances in blocks of rows: the first row, and (rows, V); pairs i < j only."""
    count = len(start)
    for first in range(0, count - 1, _CHUNK):
        rows = slice(first, min(first + _CHUNK, count - 1))
        squared = _least_squared(start[None, :] - start[rows, None], end[None, :] - end[rows, None])
        squared[np.arange(count) <= np.arange(rows.start, rows.stop)[:, None]] = np.inf
        yield first, squared
