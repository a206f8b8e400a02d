"""Altitude lanes: vehicles whose straight paths come too near cross above the formation, each at its own height.

Up, across, down: only vehicles in conflict are lifted; the others fly straight below them while they cross. The leader
never moves within the formation, so no vehicle below it can be lifted.
"""

from collections import defaultdict
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

import numpy as np

from gcs.plan.formation.separation import pairs_nearer_than
from gcs.types import Array

# Lanes are this much further apart than required, so that rounding decides nothing.
_ROOM = 1.01

_Graph = dict[int, set[int]]


@dataclass(frozen=True)
class Lanes:
    """Offsets of all vehicles after the climb and before the descent."""

    risen_ned_m: Array  # (V, 3)
    crossed_ned_m: Array  # (V, 3)
    count: int


@dataclass(frozen=True)
class Deadlock:
    """Rows of two vehicles for which there are no lanes."""

    first: int
    second: int


def find_lanes(start_ned_m: Array, end_ned_m: Array, leader: int, separation_m: float) -> Lanes | Deadlock:
    """Lanes for vehicles that move from start (V, 3) to end (V, 3), or why there are none; both keep the separation."""
    above = _above(start_ned_m, end_ned_m, separation_m)
    conflicts = _graph(pairs_nearer_than(start_ned_m, end_ned_m, separation_m).tolist())
    lifted = _lifted(conflicts, above, leader)
    if isinstance(lifted, Deadlock):
        return lifted
    rows = np.array(sorted(lifted), dtype=np.intp)
    flat = np.array([1.0, 1.0, 0.0])
    crossing = pairs_nearer_than(start_ned_m[rows] * flat, end_ned_m[rows] * flat, separation_m)
    lane = _lanes(lifted, above, _graph(rows[crossing].tolist()))
    if isinstance(lane, Deadlock):
        return lane
    top_down_m = min(start_ned_m[:, 2].min(), end_ned_m[:, 2].min())
    risen, crossed = start_ned_m.copy(), end_ned_m.copy()
    for row, number in lane.items():
        risen[row, 2] = crossed[row, 2] = top_down_m - number * _ROOM * separation_m
    return Lanes(risen, crossed, max(lane.values(), default=0))


def _above(start: Array, end: Array, separation_m: float) -> _Graph:
    """The vehicles so nearly above each vehicle, before or after, that it cannot pass them when it climbs."""
    above: _Graph = defaultdict(set)
    flat = np.array([1.0, 1.0, 0.0])
    for places in (start, end):
        for i, j in pairs_nearer_than(places * flat, places * flat, separation_m).tolist():
            low, high = (i, j) if places[i, 2] > places[j, 2] else (j, i)
            above[low].add(high)
    return above


def _lifted(conflicts: _Graph, above: _Graph, leader: int) -> set[int] | Deadlock:
    """At least one of every two vehicles in conflict, with all above it; the most entangled are taken first."""
    columns = {row: _column(row, above) for row in conflicts}
    held = {row for row in conflicts if leader in columns[row]}
    left = {row: set(others) for row, others in conflicts.items()}
    for row in held:
        for other in left[row] & held:
            return Deadlock(row, other)
    # A vehicle in conflict with one that cannot be lifted must be lifted.
    chosen = [other for row in held for other in left[row]]
    lifted: set[int] = set()
    while True:
        for row in chosen:
            for risen in columns[row] - lifted:
                lifted.add(risen)
                for other in left.pop(risen, set()):
                    left[other].discard(risen)
        free = [row for row, others in left.items() if others]
        if not free:
            return lifted
        chosen = [max(free, key=lambda row: (len(left[row]) / len(columns[row]), -row))]


def _column(row: int, above: _Graph) -> set[int]:
    """A vehicle and all vehicles that must rise before it."""
    column, open_rows = {row}, [row]
    while open_rows:
        new = above.get(open_rows.pop(), set()) - column
        column |= new
        open_rows += new
    return column


def _lanes(lifted: set[int], above: _Graph, crossing: _Graph) -> dict[int, int] | Deadlock:
    """The lowest lane of each lifted vehicle: above those below it, and not that of a vehicle it crosses."""
    below: _Graph = {row: set() for row in lifted}
    for row in lifted:
        for high in above.get(row, set()):
            below[high].add(row)
    lane: dict[int, int] = {}
    try:
        order = list(TopologicalSorter(below).static_order())
    except CycleError as error:
        return Deadlock(*error.args[1][:2])
    for row in order:
        taken = {lane[other] for other in crossing.get(row, set()) if other in lane}
        number = 1 + max((lane[other] for other in below[row]), default=0)
        while number in taken:
            number += 1
        lane[row] = number
    return lane


def _graph(pairs: list[list[int]]) -> _Graph:
    """The neighbours of each row, from pairs."""
    graph: _Graph = defaultdict(set)
    for i, j in pairs:
        graph[i].add(j)
        graph[j].add(i)
    return graph
