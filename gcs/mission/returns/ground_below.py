"""Highest ground below return tracks: a bound that holds between samples, and for returns from any instant.

Tracks are divided along their length, and by the instants at which they begin. The ground of a part is bounded over the
rectangle that holds it. Parts whose bound is below a height that was seen need no further division.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gcs.autopilots.traits import FleetFirmware
from gcs.mission.returns.rtl_cases import return_ends
from gcs.mission.returns.start_cells import plan_intervals, start_cells
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof import subdivision
from gcs.plan.verification.proof.subdivision import Cells, Constraint, Looks, Mask, Proof, Rows
from gcs.scenario.environment.ground_bounds import Highest, highest_ground
from gcs.types import Array

GAP_M = 0.01  # between the bound and a height that was seen
_LONGEST_S = 4.0
_LEAST_M = 1e-3  # of a part's half length: it is not divided further
_PARTS_MAX = 500_000  # looked at; of what is left then, the bound counts


def highest_below_returns_m(plan: Plan, firmware: FleetFirmware, rally_ned_m: Array, seen_m: float) -> float:
    """A height that no ground below straight returns is above: `seen_m`, or at most `GAP_M` above the ground."""
    ends = return_ends(plan, firmware, rally_ned_m).ned_m[..., :2]
    begin_s, end_s = plan_intervals(plan, _LONGEST_S)
    cell, vehicle, end = (index.ravel() for index in np.indices((len(begin_s), *ends.shape[:2])))

    @lru_cache(maxsize=1)
    def rectangles(cells: Cells) -> _Rectangles:
        vehicle, end = cells.who.T
        spans_s, index = np.unique(cells.start_s + 1j * cells.end_s, return_inverse=True)
        starts = start_cells(plan, spans_s.real, spans_s.imag).starts(vehicle, index.reshape(-1))
        place_m, to_m = starts.place_ned_m[:, :2], ends[vehicle, end]
        away_m = np.linalg.norm(place_m[:, None] - ends[vehicle], axis=-1)
        # Home is an end of every vehicle; a rally point is one only where it may be the nearest.
        own_m = np.take_along_axis(away_m, end[:, None], axis=1)[:, 0]
        flown = (end == 0) | (own_m - away_m.min(axis=1) <= 2.0 * starts.level_m)
        share, half = cells.patch.mean(axis=1), 0.5 * np.diff(cells.patch)[:, 0]
        beside_m = (1.0 - cells.patch[:, 0]) * starts.level_m
        reach_m = half[:, None] * np.abs(to_m - place_m) + beside_m[:, None]
        return _Rectangles(place_m + share[:, None] * (to_m - place_m), reach_m, flown, half * own_m >= beside_m)

    tracks = subdivision.plain_cells(np.stack([vehicle, end], axis=1), begin_s[cell], end_s[cell])
    return _highest_m(plan, tracks, rectangles, seen_m)


def highest_along_m(plan: Plan, begin_m: Array, end_m: Array, seen_m: float) -> float:
    """A height that no ground below straight lines (N, 2) to (N, 2) is above: `seen_m`, or at most `GAP_M` above it."""
    every, each = np.ones(len(begin_m), dtype=bool), np.arange(len(begin_m))

    @lru_cache(maxsize=1)
    def rectangles(cells: Cells) -> _Rectangles:
        line = cells.who[:, 0]
        moved_m, yes = (end_m - begin_m)[line], every[line]
        share, half = cells.patch.mean(axis=1, keepdims=True), 0.5 * np.diff(cells.patch)
        return _Rectangles(begin_m[line] + share * moved_m, half * np.abs(moved_m), yes, yes)

    lines = subdivision.plain_cells(each[:, None], np.zeros(len(each)), np.zeros(len(each)))
    return _highest_m(plan, lines, rectangles, seen_m)


class _Rectangles(NamedTuple):
    """What holds parts (N) of tracks between two shares of their length: their `patch`."""

    centre_m: Array  # (N, 2)
    reach_m: Array  # (N, 2)
    flown: Mask  # whether a return may lead there
    along: Mask  # whether to divide the length, not the time


@dataclass(frozen=True)
class _Depth(Constraint):
    """How far the ground is below height 0. How far it is below a given height does not matter."""

    given_m: float

    def gap(self, worst: Array) -> Array:
        """See `Constraint`."""
        return np.maximum(worst + self.given_m, self.resolution)


@dataclass(frozen=True)
class _GroundBelow:
    """The family of parts of tracks."""

    constraints: tuple[_Depth]
    highest: Highest
    rectangles: Callable[[Cells], _Rectangles]

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`. The ground below the middle is really flown over, at the part's middle instant."""
        centre_m, reach_m, flown, _ = self.rectangles(cells)
        low_m, seen_m = np.full((2, 1, len(cells)), np.inf)
        centre_m, reach_m = centre_m[flown], reach_m[flown]
        low_m[0, flown] = -self.highest(centre_m - reach_m, centre_m + reach_m)
        seen_m[0, flown] = -self.highest(centre_m, centre_m)
        return low_m, seen_m

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: halves of the length, or of the time."""
        _, reach_m, _, along = self.rectangles(cells)
        large = chosen & (reach_m.max(axis=1) > _LEAST_M)
        lengths, times = np.flatnonzero(large & along), np.flatnonzero(large & ~along)
        by_time, by_length = cells[times], cells[lengths]
        first, last = by_length.patch.T
        middle = 0.5 * (first + last)
        ends = [np.stack(pair, axis=1) for pair in ((first, middle), (middle, last))]
        parts = [subdivision.halved(by_time), *(replace(by_length, patch=patch) for patch in ends)]
        return subdivision.joined(parts), np.concatenate([times, times, lengths, lengths])


def _highest_m(plan: Plan, tracks: Cells, rectangles: Callable[[Cells], _Rectangles], given_m: float) -> float:
    depth = _Depth(0.0, GAP_M, given_m)
    proof = Proof.begun((1, 1), tracks.who.shape[1])
    whole = replace(tracks, patch=np.tile([0.0, 1.0], (len(tracks), 1)))
    subdivision.settle(
        _GroundBelow((depth,), highest_ground(plan.scenario.terrain), rectangles), whole, proof, Looks(_PARTS_MAX)
    )
    return max(given_m, -float(proof.proved[0, 0]))
