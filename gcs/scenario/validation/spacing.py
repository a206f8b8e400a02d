"""Who is too near to whom, among thousands.

Knows: places and a distance to keep. Does not know: what the places are of, or why they should be apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from gcs.physics.quadrotor import Array

# Positions written with two decimals should not fail for the last bit of their sums.
SLACK = 1e-9
# Neighbours looked at around every place: enough to know all pairs of a small formation, and little for a large one,
# where a distance mistyped by a factor of ten would make every pair one.
_NEIGHBOURS = 8


@dataclass(frozen=True)
class Pair:
    """Two rows of an array of places, the lower one first."""

    first: int
    second: int
    distance_m: float


def close_pairs(places_m: Array, least_m: float) -> list[Pair]:
    """Pairs of places (V, 3) nearer than `least_m`, the nearest first: all of up to eight places, and of more at
    least one for every place that has any."""
    count = len(places_m)
    if count < 2:
        return []
    k = min(count, _NEIGHBOURS)
    distance, other = KDTree(places_m).query(places_m, k=k, distance_upper_bound=least_m - SLACK)
    row = np.repeat(np.arange(count), k).reshape(count, k)
    real = np.isfinite(distance) & (other != row)
    found = {
        (min(a, b), max(a, b)): d
        for a, b, d in zip(row[real].tolist(), other[real].tolist(), distance[real].tolist(), strict=True)
    }
    # Of equal distances, rounding would put any pair first.
    return [Pair(*rows, d) for rows, d in sorted(found.items(), key=lambda item: (round(item[1], 6), item[0]))]


def nearest_pair(places_m: Array) -> Pair | None:
    """The two places (V, 3) nearest to each other; None where there are not two."""
    if len(places_m) < 2:
        return None
    distance, other = KDTree(places_m).query(places_m, k=2)
    row = int(distance[:, 1].round(6).argmin())
    neighbour = next(int(b) for b in other[row] if b != row)  # of two in one place, either may come first
    return Pair(min(row, neighbour), max(row, neighbour), float(distance[row, 1]))
