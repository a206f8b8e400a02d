"""The order of vehicles in the stagger of return (RTL) altitudes: the one with the largest least distance.

All orders of up to 8 vehicles are compared, and exchanges of two in fleets of up to 12. Many orders are equally good,
for example because pads limit the least distance, and then the last bits of a plan would choose among them. Least
distances are therefore compared in whole steps of `GAP_STEP_M`, and those of `ENOUGH` separations or more are equal.
Of equally good orders the first one counts: the vehicles' own order is the first, the reversed one the last.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from gcs.mission.failsafe.rtl_motion import Returning, pair_distances
from gcs.physics.quadrotor import Array

SEARCHED_MAX = 12  # vehicles
GAP_STEP_M = 0.05
ENOUGH = 2.0
_ALL_ORDERS = 8  # vehicles
_STEPS_BEGIN = 0.382  # of a step: pads and formations have round distances, and steps shall not begin there


def stagger_order(cases: list[Returning], altitudes_m: Array, separation_m: float) -> NDArray[np.intp]:
    """Place of each vehicle in the stagger (V,).

    `altitudes_m` (L, V) are the altitudes that each vehicle would have at each place.
    """
    vehicles = len(cases[0].from_ned_m)
    if vehicles == 1 or vehicles > SEARCHED_MAX:
        return np.zeros(vehicles, dtype=np.intp)
    pairs = list(itertools.combinations(range(vehicles), 2))
    gaps_m = np.full((vehicles, vehicles, vehicles, vehicles), np.inf)  # by pair, then by their places in the stagger
    for case in cases:
        motions = [case.motion(row, altitudes_m[:, row, None]) for row in range(vehicles)]
        for i, j in pairs:
            (times_i, places_i), (times_j, places_j) = motions[i], motions[j]
            distance = pair_distances((times_i[:, None], places_i[:, None]), (times_j[None], places_j[None]))
            gaps_m[i, j] = np.minimum(gaps_m[i, j], distance.min(axis=-1))
    steps = np.floor(np.minimum(gaps_m, ENOUGH * separation_m) / GAP_STEP_M + _STEPS_BEGIN)
    first, second = np.array(pairs).T

    def worth(orders: NDArray[np.intp]) -> Array:
        """The least distance (O,) of orders (O, V), in whole steps."""
        return np.asarray(steps[first, second, orders[:, first], orders[:, second]].min(axis=1))

    if vehicles <= _ALL_ORDERS:
        orders = np.array(list(itertools.permutations(range(vehicles))))
        best: NDArray[np.intp] = orders[np.argmax(worth(orders))]
        return best
    order = np.arange(vehicles)
    while True:
        swapped = np.repeat(order[None], len(pairs), axis=0)
        rows = np.arange(len(pairs))
        swapped[rows, first], swapped[rows, second] = order[second], order[first]
        found = worth(swapped)
        if found.max() <= worth(order[None])[0]:
            return order
        order = swapped[np.argmax(found)]
