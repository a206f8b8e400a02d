"""Who takes which place: the exact answer to Eq. 14, and the one whose straight ways keep apart best.

Knows: a table of distances. Does not know: what lies between a vehicle and its place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gcs.physics.quadrotor import Array

Places = NDArray[np.intp]

# Ways that differ by rounding alone are equally long; otherwise the last bit would decide among symmetric answers.
_SAME = 1e-9


def bottleneck(distance_m: Array) -> Places | None:
    """Eq. 14: the place of each vehicle (V,) such that the longest way is as short as can be.

    Of all such answers the one with the least sum of squares. `distance_m` (V, V) is from vehicle (row) to place
    (column), infinite where a way is forbidden; None where every answer would need a forbidden way.
    """
    possible = np.unique(distance_m[np.isfinite(distance_m)])
    if len(distance_m) == 0 or len(possible) == 0:
        return None if len(distance_m) else np.empty(0, dtype=np.intp)
    # Everyone has to go somewhere, and someone to every place: no answer is shorter than this.
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
    """The place of each vehicle (V,) such that the squares of all ways have the least sum (CAPT); None as above.

    Of two who would cross, exchanging places would be less: where start and goal places are sqrt(2) times a
    distance apart, no two who fly straight in step come nearer than that distance.
    """
    try:
        _, places = linear_sum_assignment(distance_m**2)
    except ValueError:  # a forbidden way in every answer
        return None
    return np.asarray(places, dtype=np.intp)


def _matches(allowed: NDArray[np.bool_]) -> bool:
    """Whether everyone can have a place of his own.

    As an assignment with as few forbidden ways as can be: for a thousand vehicles ten to a hundred times faster than
    SciPy's bipartite matching, which is slow where there is almost an answer.
    """
    forbidden = (~allowed).astype(float)
    return not forbidden[linear_sum_assignment(forbidden)].any()
