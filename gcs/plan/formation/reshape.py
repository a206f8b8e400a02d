"""Reshape (§2.2.3): an assignment of places and collision-free paths to them; the leader keeps its place."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.distance import cdist

from gcs.errors import Infeasible
from gcs.plan.formation.altitude_lanes import Deadlock, find_lanes
from gcs.plan.formation.assignment import Places, bottleneck, least_squares
from gcs.plan.formation.separation import least_distance, least_gap, near_point
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.transforms import reshape_paths_m, straight
from gcs.plan.formation.turns import find_turns
from gcs.types import Array

# Places written with two decimals should not fail for the last bit of their differences.
SLACK_M = 1e-9
# Where room is made, it is this much more than required, so that rounding decides nothing.
_ROOM = 1.01
_MOST_SPREAD = 4.0  # times the shape's size: beyond that it is no longer the same flight


@dataclass(frozen=True)
class Reshaped:
    """A change to new places, leg by leg."""

    legs: tuple[Shape, ...]  # each on [0, 1], flown one after the other
    offsets_after_ned_m: Array  # (V, 3)
    places: Places  # (V,) row of the target of each vehicle
    way: str  # for people
    least_distance_m: float  # between any two vehicles on any leg

    @property
    def longest_m(self) -> float:
        """The length of the longest path of each leg, all together."""
        return sum(float(reshape_paths_m(leg.at(0.0), leg.at(1.0)).max()) for leg in self.legs)


def reshape(
    offsets_ned_m: Array,
    targets_ned_m: Array,
    leader: int,
    separation_m: float,
    *,
    fixed: bool = False,
    sysids: Sequence[int] | None = None,
) -> Reshaped:
    """The change from offsets (V, 3) to targets (V, 3), no two vehicles nearer than the separation at any instant.

    Straight by the fastest assignment (Eq. 14), else straight by the least sum of squares, else the shortest of three:
    in altitude lanes, one after another in turns, spread out while they cross. `fixed`: every vehicle to the target of
    its own row. Raises `Infeasible`, naming two vehicles by their `sysids`, when the shapes themselves are too tight or
    no path keeps the separation.
    """
    if np.any(targets_ned_m[leader] != 0.0) or np.any(offsets_ned_m[leader] != 0.0):
        raise ValueError("offsets are from the leader: its own must be zero, before and after")
    names = list(range(1, len(offsets_ned_m) + 1)) if sysids is None else list(sysids)
    for stand_ned_m, when in ((offsets_ned_m, "before"), (targets_ned_m, "after")):
        gap_m, i, j = least_gap(stand_ned_m)
        if gap_m < separation_m - SLACK_M:
            raise Infeasible(
                f"{when} the change vehicles {names[i]} and {names[j]} stand {gap_m:.2f} m apart; "
                f"separation_min_m is {separation_m:g} m",
                hint="give the shape a larger spacing",
            )
    tries: list[Places] = []
    for places, words in _tries(offsets_ned_m, targets_ned_m, leader, separation_m, fixed):
        tries.append(places)
        made = _flown([offsets_ned_m, targets_ned_m[places]], places, words)
        if made.least_distance_m >= separation_m - SLACK_M:
            return made
    laned = [_in_lanes(offsets_ned_m, targets_ned_m, places, leader, separation_m) for places in tries]
    turned = [_in_turns(offsets_ned_m, targets_ned_m, places, separation_m) for places in tries]
    nearest, roomiest = max(
        ((least_distance(offsets_ned_m, targets_ned_m[places]), places) for places in tries),
        key=lambda pair: pair[0][0],
    )
    spread = _spread(offsets_ned_m, targets_ned_m, roomiest, nearest[0], separation_m)
    if found := [made for made in (*laned, *turned, spread) if made is not None]:
        return min(found, key=lambda made: made.longest_m)
    distance_m, i, j = nearest
    free = 'leave out assignment = "fixed", ' if fixed else ""
    raise Infeasible(
        f"vehicles {names[i]} and {names[j]} would pass each other at {distance_m:.2f} m, and no altitude lane "
        f"above the others exists, nor an order of turns; separation_min_m is {separation_m:g} m",
        hint=f"give the shapes a larger spacing, {free}or add an intermediate shape",
    )


def _tries(
    offsets: Array, targets: Array, leader: int, separation_m: float, fixed: bool
) -> Iterator[tuple[Places, str]]:
    """Assignments in the order in which they are tried, with their descriptions when they are flown straight."""
    if fixed:
        yield np.arange(len(offsets), dtype=np.intp), "straight, each vehicle to its own place"
        return
    distance = np.asarray(cdist(offsets, targets))
    distance[leader], distance[:, leader] = np.inf, np.inf
    distance[leader, leader] = 0.0
    # The leader does not move, so a path past it is clear or not, whatever the others do.
    clear = distance.copy()
    others = np.arange(len(offsets)) != leader
    near = near_point(offsets[:, None], targets[None, :], np.zeros(3)) < separation_m
    clear[near & others[:, None] & others] = np.inf
    for table in (clear, distance):
        fastest = bottleneck(table)
        if fastest is None:
            continue
        yield fastest, "straight, shortest longest path"
        least = least_squares(table)
        assert least is not None
        yield least, "straight, least sum of squared paths"
        return


def _in_lanes(offsets: Array, targets: Array, places: Places, leader: int, separation_m: float) -> Reshaped | None:
    """The change through altitude lanes; None where there are none."""
    end = targets[places]
    lanes = find_lanes(offsets, end, leader, separation_m)
    if isinstance(lanes, Deadlock):
        return None
    words = "in one altitude lane" if lanes.count == 1 else f"in {lanes.count} altitude lanes"
    made = _flown([offsets, lanes.risen_ned_m, lanes.crossed_ned_m, end], places, words)
    return made if made.least_distance_m >= separation_m - SLACK_M else None


def _in_turns(offsets: Array, targets: Array, places: Places, separation_m: float) -> Reshaped | None:
    """The change of some vehicles after others; None where no order is found."""
    stops = find_turns(offsets, targets[places], separation_m - SLACK_M)
    return None if stops is None else _flown(stops, places, f"straight, in {len(stops) - 1} turns")


def _spread(offsets: Array, targets: Array, places: Places, nearest_m: float, separation_m: float) -> Reshaped | None:
    """The change at a larger size, by the nearest that two vehicles come without it; None where that is too large."""
    if nearest_m * _MOST_SPREAD < separation_m * _ROOM:
        return None
    factor, end = separation_m * _ROOM / nearest_m, targets[places]
    words = f"spread out to {factor:.2f} times the size, across, together again"
    return _flown([offsets, factor * offsets, factor * end, end], places, words)


def _flown(stops: list[Array], places: Places, way: str) -> Reshaped:
    """The change straight from stop to stop, all vehicles in step."""
    legs = list(pairwise(stops))
    return Reshaped(
        legs=tuple(straight(start, end) for start, end in legs),
        offsets_after_ned_m=stops[-1],
        places=places,
        way=way,
        least_distance_m=min(least_distance(start, end)[0] for start, end in legs),
    )
