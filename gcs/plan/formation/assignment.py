"""The assignment of vehicles to places: bottleneck (Eq. 14), and least sum of squares (CAPT), from distances."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gcs.types import Array

Places = NDArray[np.intp]

# Paths that differ by rounding are equally long: the last bit must not decide between symmetric answers.
_SAME = 1e-9


def bottleneck(distance_m: Array) -> Places | None:
    """Eq. 14: the place of each vehicle (V,) that makes the longest path as short as possible.

    Of all such answers the one with the least sum of squares. `distance_m` (V, V) is from vehicle (row) to place
    (column), infinite where a path is forbidden; None where every answer needs a forbidden path.
    """
    possible = np.unique(distance_m[np.isfinite(distance_m)])
    if len(distance_m) == 0 or len(possible) == 0:
        return None if len(distance_m) else np.empty(0, dtype=np.intp)
    # Every vehicle needs a place and every place a vehicle: no answer is shorter than this.
    floor_m = max(distance_m.min(axis=1).max(), distance_m.min(axis=0).max())
    low, high = int(np.searchsorted(possible, floor_m)), len(possible) - 1
    if low > high or not _matches(distance_m <= possible[high]):
        return None
    while low < high:
        middle = (low + high) // 2
        if _matches(distance_m <= possible[middle]):
            high = middle
        else:
            low = middle + 1
    return least_squares(np.where(distance_m <= possible[high] * (1.0 + _SAME), distance_m, np.inf))


def least_squares(distance_m: Array) -> Places | None:
    """The place of each vehicle (V,) with the least sum of squared paths (CAPT); None as for `bottleneck`.

    Two vehicles that would cross cost less with places exchanged. Where start and goal places are sqrt(2) times a
    distance apart, no two vehicles that fly straight in step come nearer than that distance.
    """
    try:
        _, places = linear_sum_assignment(distance_m**2)
    except ValueError:  # every answer needs a forbidden path
        return None
    return np.asarray(places, dtype=np.intp)


def _matches(allowed: NDArray[np.bool_]) -> bool:
    """Whether every vehicle can have a place of its own.

    Solved as an assignment with the fewest forbidden paths: for a thousand vehicles ten to a hundred times faster than
    SciPy's bipartite matching, which is slow where there is almost an answer.
    """
    forbidden = (~allowed).astype(float)
    return not forbidden[linear_sum_assignment(forbidden)].any()
