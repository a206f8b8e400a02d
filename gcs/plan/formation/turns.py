"""Lanes in time: vehicles whose straight paths come too near fly one after another, in as few turns as are found.

A turn is a set of vehicles that fly in step while all others stand, at their old places or at their new ones.
"""

import numpy as np
from numpy.typing import NDArray

from gcs.plan.formation.separation import near_point, pairs_nearer_than
from gcs.types import Array

Flags = NDArray[np.bool_]


def find_turns(start_ned_m: Array, end_ned_m: Array, separation_m: float) -> list[Array] | None:
    """The places (V, 3) before the first turn and after each; None where the search finds no order.

    Start (V, 3) and end (V, 3) keep the separation.
    """
    count = len(start_ned_m)
    together = np.ones((count, count), dtype=bool)
    first, second = pairs_nearer_than(start_ned_m, end_ned_m, separation_m).T
    together[first, second] = together[second, first] = False
    paths = start_ned_m[:, None], end_ned_m[:, None]
    past_start = near_point(*paths, start_ned_m[None]) >= separation_m  # row flies past a column that has not flown
    past_end = near_point(*paths, end_ned_m[None]) >= separation_m
    before = past_start & past_end.T  # row may have its turn before the column's
    np.fill_diagonal(before, val=True)
    stops, left = [start_ned_m], np.linalg.norm(end_ned_m - start_ned_m, axis=1) > 0.0
    standing = ~left
    if (left[:, None] & standing & ~past_start).any():
        return None
    while left.any():
        turn = _turn(left, together, before)
        if not turn.any():
            return None
        stops.append(np.where(turn[:, None], end_ned_m, stops[-1]))
        left &= ~turn
    return stops


def _turn(left: Flags, together: Flags, before: Flags) -> Flags:
    """Which of the vehicles left (V,) fly next, all in step; the others of them can follow."""
    turn = left.copy()
    while turn.any():
        stays = turn & (left & ~turn & ~before).any(axis=1)
        if not stays.any():
            crossed = (turn[:, None] & turn & ~together).sum(axis=1)
            if not crossed.any():
                break
            # Who waits, makes those wait that cannot fly before it: most crossings for fewest of these.
            waits = (turn[:, None] & ~before).sum(axis=0)
            stays = np.arange(len(turn)) == np.argmax(np.where(crossed > 0, crossed - waits, -np.inf))
        turn &= ~stays
    return turn
