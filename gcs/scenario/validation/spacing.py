"""The pairs of places that are closer than a distance, among thousands of places."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from gcs.types import Array

# Positions with two decimals must not fail because of the last bit of their sums.
SLACK = 1e-9
# Neighbours per place: enough for all pairs of a small formation. In a large one, a distance mistyped by a factor of
# ten must not list every pair.
_NEIGHBOURS = 8


@dataclass(frozen=True)
class Pair:
    """Two rows of an array of places, the lower one first."""

    first: int
    second: int
    distance_m: float


def close_pairs(places_m: Array, least_m: float) -> list[Pair]:
    """The pairs of places (V, 3) closer than `least_m`, the closest first.

    Up to eight places: all pairs. More: at least one pair for each place that has any.
    """
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
    # Rounding errors must not decide the order of equal distances.
    return [Pair(*rows, d) for rows, d in sorted(found.items(), key=lambda item: (round(item[1], 6), item[0]))]


def nearest_pair(places_m: Array) -> Pair | None:
    """The two closest places (V, 3); None for fewer than two places."""
    if len(places_m) < 2:
        return None
    distance, other = KDTree(places_m).query(places_m, k=2)
    row = int(distance[:, 1].round(6).argmin())
    neighbour = next(int(b) for b in other[row] if b != row)  # two at one place may come in either order
    return Pair(min(row, neighbour), max(row, neighbour), float(distance[row, 1]))
