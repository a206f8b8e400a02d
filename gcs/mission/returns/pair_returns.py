"""Proved separation of straight returns (RTL) that all vehicles begin at the same instant, any instant of the plan.

All pairs of a small fleet are bounded over intervals of start times; `proved_fleet` does it for larger ones. Intervals
are halved until the bound of each pair is near enough to the least distance seen. What is left at 1 ms or 1 cm keeps
its bound, and counts as undecided if that is below the required separation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from gcs.mission.predicted.closest_approach import least_distance
from gcs.mission.returns.rtl_cases import Motion, ReturnEnds, Returning, ReturnSpeeds, ReturnTo, places_at
from gcs.mission.returns.start_cells import Starts, plan_intervals, start_cells
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof import subdivision
from gcs.plan.verification.proof.subdivision import Cells, Constraint, Looks, Mask, Proof, Rows
from gcs.types import Array

LONGEST_S, RESOLUTION_S, RESOLUTION_M = 1.0, 1e-3, 1e-2
_GAP_SHARE, _GAP_MIN_M, _GAP_MAX_M = 0.5, 0.01, 0.1
_PAIRS_MAX = 1_000_000  # what is left then is undecided


@dataclass(frozen=True)
class Tubes:
    """Returns (..., K) from the middle of intervals, and how far those from other instants are from them.

    A start that is moved by a (level) and b (vertically) moves the return, at equal time, by no more than a + v b / c
    level and b + s (b / c + a / v) vertically, at climb speed c, cruise speed v and sink speed s: a straight leg at
    constant speed shortens the vector to its end, which never spreads two starts. Two starts that move alike move their
    returns alike, but for the shares of the legs that are done. Above its end a vehicle has no level uncertainty, on
    the ground none at all.
    """

    times_s: Array  # (..., 5)
    places_ned_m: Array  # (..., 5, 3)
    level_m: Array  # (...) of the starts
    vertical_m: Array
    top_m: Array  # of the height at which they return
    speeds: ReturnSpeeds

    @classmethod
    def of(cls, motion: Motion, level_m: Array, vertical_m: Array, climbs_m: Array, speeds: ReturnSpeeds) -> Tubes:
        """The tubes around a motion; `climbs_m` (...) is negative where a start is above its return altitude."""
        top_m = np.clip(vertical_m - climbs_m, 0.0, vertical_m)
        return cls(motion[0], motion[1], level_m, vertical_m, top_m, speeds)

    def __getitem__(self, index: tuple[Rows, ...]) -> Tubes:
        arrays = (self.times_s, self.places_ned_m, self.level_m, self.vertical_m, self.top_m)
        times_s, places_ned_m, level_m, vertical_m, top_m = (each[index] for each in arrays)
        return Tubes(times_s, places_ned_m, level_m, vertical_m, top_m, self.speeds)

    @property
    def _late_s(self) -> tuple[Array, Array, Array]:
        """How much (...) the ends of climb, cruise and descent may be earlier or later."""
        climbed_s = self.vertical_m / self.speeds.climb_mps
        arrived_s = climbed_s + self.level_m / self.speeds.cruise_mps
        return climbed_s, arrived_s, arrived_s + self.top_m / self.speeds.sink_mps

    def marks_s(self) -> Array:
        """Times (..., 10) between which the uncertainty does not change and motions are straight."""
        climbed_s, arrived_s, landed_s = self._late_s
        begin, climbed, across, sinks, landed = np.moveaxis(self.times_s, -1, 0)
        marks = [begin, climbed - climbed_s, climbed, climbed + climbed_s, across, across + arrived_s]
        marks += [sinks - arrived_s, sinks, landed, landed + landed_s]
        return np.asarray(np.maximum(np.stack(marks, axis=-1), 0.0))

    def climbing(self, t_s: Array) -> Mask:
        """Whether all returns still climb, at each time (..., I)."""
        return np.asarray(t_s <= (self.times_s[..., 1] - self._late_s[0])[..., None])

    def level_reach_m(self, t_s: Array) -> Array:
        """How far (..., I) returns may be from the middle one, level."""
        climbed_s, arrived_s, _ = self._late_s
        across_m = self.level_m + self.speeds.cruise_mps * climbed_s
        over = t_s >= (self.times_s[..., 2] + arrived_s)[..., None]
        return np.where(over, 0.0, np.where(self.climbing(t_s), self.level_m[..., None], across_m[..., None]))

    def shortened_m(self, t_s: Array, until_s: Array) -> Array:
        """How far (..., I) returns may be, level, from the middle one moved like its start; until `until_s`.

        The leg turns and shortens the move across it, by the share of the leg that is done.
        """
        climbed_s = self._late_s[0]
        leg = self.places_ned_m[..., 2, :2] - self.places_ned_m[..., 1, :2]
        shortest_m = np.maximum(np.hypot(leg[..., 0], leg[..., 1]) - self.level_m, 1e-6)
        passed_s = np.maximum(until_s - (self.times_s[..., 1] - climbed_s)[..., None], 0.0)
        share = np.minimum(self.speeds.cruise_mps * passed_s / shortest_m[..., None], 1.0)
        late_m = self.speeds.cruise_mps * climbed_s
        return np.where(self.climbing(t_s), 0.0, share * self.level_m[..., None] + late_m[..., None])

    def vertical_reach_m(self, t_s: Array) -> Array:
        """How far (..., I) returns may be from the middle one, vertically."""
        climbed_s, arrived_s, landed_s = self._late_s
        climbs = t_s < (self.times_s[..., 1] + climbed_s)[..., None]
        sinks = t_s > (self.times_s[..., 3] - arrived_s)[..., None]
        landed = t_s >= (self.times_s[..., 4] + landed_s)[..., None]
        reach_m = np.where(climbs, self.vertical_m[..., None], self.top_m[..., None])
        reach_m = reach_m + np.where(sinks, (self.speeds.sink_mps * arrived_s)[..., None], 0.0)
        return np.where(landed, 0.0, reach_m)


def least_of_pairs(first: Tubes, second: Tubes, against_m: tuple[Array, Array]) -> tuple[Array, Array]:
    """Two distances (M,) of pairs: one that no return of the interval is below, and the least of the middle one.

    `against_m` is how far, level and vertically, two starts move against each other.
    """
    marks_s = np.sort(np.concatenate([first.marks_s(), second.marks_s()], axis=-1), axis=-1)
    places = [places_at((one.times_s, one.places_ned_m), marks_s) for one in (first, second)]
    between = places[1] - places[0]
    middle_s = 0.5 * (marks_s[:, :-1] + marks_s[:, 1:])
    both = first.climbing(middle_s) & second.climbing(middle_s)
    level_m = first.level_reach_m(middle_s) + second.level_reach_m(middle_s)
    vertical_m = first.vertical_reach_m(middle_s) + second.vertical_reach_m(middle_s)
    shortened_m = sum(one.shortened_m(middle_s, marks_s[:, 1:]) for one in (first, second))
    level_m = np.minimum(level_m, against_m[0][:, None] + shortened_m)
    vertical_m = np.where(both, against_m[1][:, None], vertical_m)
    begin, end = between[:, :-1], between[:, 1:]
    distance_m, _ = least_distance(begin, end)
    beside_m, _ = least_distance(begin[..., :2], end[..., :2])
    over_m = np.where(begin[..., 2] * end[..., 2] <= 0.0, 0.0, np.minimum(*np.abs((begin[..., 2], end[..., 2]))))
    apart_m = np.hypot(np.maximum(beside_m - level_m, 0.0), np.maximum(over_m - vertical_m, 0.0))
    low_m = np.maximum(distance_m - np.hypot(level_m, vertical_m), apart_m)
    return np.asarray(low_m.min(axis=-1)), np.asarray(distance_m.min(axis=-1))


@dataclass(frozen=True)
class ProvedSeparation:
    """No return brings two vehicles nearer than `proved_m`; one from `t_s` brings rows `pair` to `least_m`.

    The bound is the least about `proved_at_s`.
    """

    proved_m: float
    least_m: float
    t_s: float
    pair: tuple[int, int]
    to: ReturnTo
    proved_at_s: float

    @classmethod
    def of(cls, proof: Proof) -> ProvedSeparation:
        """What is proved of `StraightReturns`."""
        first, second, to_rally = proof.who[0, 0].tolist()
        proved_m, least_m, t_s = float(proof.proved[0, 0]), float(proof.seen[0, 0]), float(proof.t_s[0, 0])
        to = ReturnTo.either(to_rally=to_rally)
        return cls(min(proved_m, least_m), least_m, t_s, (first, second), to, float(proof.proved_at_s[0, 0]))


@dataclass(frozen=True)
class ReturnDistance(Constraint):
    """The distance of two returning vehicles; how near its bound must come depends on what is required."""

    required_m: float

    def gap(self, worst: Array) -> Array:
        """See `Constraint`: what is left to the required distance, at most."""
        left_m = worst - self.required_m
        near_m = np.minimum(np.clip(_GAP_SHARE * left_m, _GAP_MIN_M, _GAP_MAX_M), left_m)
        return np.where(left_m < 0.0, _GAP_MAX_M, near_m)


@dataclass(frozen=True, eq=False)
class StraightReturns:
    """The family of pairs of vehicles (first, second, 1) that return to the nearest of their ends; or (.., 0): home."""

    plan: Plan
    ends: ReturnEnds
    speeds: ReturnSpeeds
    altitudes_m: Array  # (V,)
    required_m: float
    to_rally: bool = False

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """The distance of the two vehicles alone."""
        return (ReturnDistance(0.0, RESOLUTION_M, self.required_m),)

    def cells(self, pairs: Cells) -> Cells:
        """Cells of pairs of vehicles (first, second)."""
        to_rally = np.full((len(pairs), 1), self.to_rally, dtype=np.intp)
        return replace(pairs, who=np.concatenate([pairs.who, to_rally], axis=1))

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`: of every end to which a return of the interval may lead; seen to the nearest ones."""
        vehicle, starts, rows, against_m = self._starts(cells)
        tubes = list(self._tubes(starts, vehicle))
        low_m, seen_m = np.full((2, 1, len(cells)), np.inf)
        for one, (first, first_may) in enumerate(tubes):
            for other, (second, second_may) in enumerate(tubes):
                which = first_may[rows[0]] & second_may[rows[1]]
                if not which.any():
                    continue
                both = first[(rows[0][which],)], second[(rows[1][which],)]
                found_m, middle_m = least_of_pairs(*both, (against_m[0][which], against_m[1][which]))
                low_m[0, which] = np.minimum(low_m[0, which], found_m)
                if one == other == 0:
                    seen_m[0, which] = middle_m
        return low_m, seen_m

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: halves of the time."""
        _, starts, rows, _ = self._starts(cells)
        wide = (starts.level_m + starts.vertical_m)[rows].sum(axis=0) > RESOLUTION_M
        numbers = np.flatnonzero(chosen & wide & (cells.end_s - cells.start_s > RESOLUTION_S))
        return subdivision.halved(cells[numbers]), np.tile(numbers, 2)

    @lru_cache(maxsize=1)  # noqa: B019 - asked twice in a row for the same cells; the family lives no longer than a proof
    def _starts(self, cells: Cells) -> tuple[Rows, Starts, Rows, tuple[Array, Array]]:
        """Vehicles (M,) and starts, each once; which (2, N) each pair has; how much pairs move against each other."""
        times = np.stack([cells.start_s, cells.end_s], axis=1)
        spans_s, cell = np.unique(times, axis=0, return_inverse=True)
        spans, cell = start_cells(self.plan, spans_s[:, 0], spans_s[:, 1]), cell.reshape(-1)
        first, second, _ = cells.who.T
        key, row = np.unique(np.stack([first, second]) * len(spans_s) + cell, return_inverse=True)
        vehicle, at = np.divmod(key, len(spans_s))
        return vehicle, spans.starts(vehicle, at), row.reshape(2, -1), spans.against(first, second, cell)

    def _tubes(self, starts: Starts, vehicle: Rows) -> Iterator[tuple[Tubes, Mask]]:
        """Tubes (M,) of vehicles (M,) to the nearest end, the second nearest and so on; whether they may be flown."""
        ends, place_m = self.ends, starts.place_ned_m
        every_m = ends.ned_m if self.to_rally else ends.ned_m[:, :1]
        places_m, over_m = every_m[vehicle], ends.datum_m(every_m, to_rally=self.to_rally) + self.altitudes_m[:, None]
        away_m = np.linalg.norm(place_m[:, None, :2] - places_m[..., :2], axis=-1)
        order = np.argsort(away_m, axis=-1, kind="stable")
        for rank in range(places_m.shape[1]):
            chosen = order[:, rank]
            away = np.take_along_axis(away_m, chosen[:, None], axis=-1)[:, 0]
            may = away - away_m.min(axis=-1) <= 2.0 * starts.level_m
            if not may.any():
                break
            to_m, top_m = places_m[np.arange(len(vehicle)), chosen], over_m[vehicle, chosen]
            waits_s = ends.waits_s[None, vehicle]
            to = ReturnTo.either(to_rally=self.to_rally)
            case = Returning(to, away, place_m[None], to_m[None], top_m[None], self.speeds, waits_s)
            climbs_m = place_m[:, 2] + top_m
            motion = case.motion(0, 0.0)
            yield Tubes.of(motion, starts.level_m, starts.vertical_m, climbs_m, self.speeds), may


def proved_separation(returns: StraightReturns, seen_m: float, longest_s: float = LONGEST_S) -> ProvedSeparation:
    """The proved separation of returns to homes and to rally points; `seen_m` is a distance that is known to occur."""
    proof, looks, plan = Proof.begun((1, 1), 3, seen_m), Looks(_PAIRS_MAX), returns.plan
    begin_s, end_s = plan_intervals(plan, longest_s)
    every = np.stack(np.triu_indices(len(returns.altitudes_m), 1), axis=1)
    cells, pairs = len(begin_s), len(every)
    whole = subdivision.plain_cells(np.tile(every, (cells, 1)), np.repeat(begin_s, pairs), np.repeat(end_s, pairs))
    for to_rally in (False, True) if returns.ends.ned_m.shape[1] > 1 else (False,):
        family = replace(returns, to_rally=to_rally)
        subdivision.settle(family, family.cells(whole), proof, looks)
    return ProvedSeparation.of(proof)
