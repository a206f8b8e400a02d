"""The search for the least distance of pairs of vehicles that return straight, over intervals of start times.

Intervals are halved until the bound of each pair is near enough to the least distance seen. What is left at 1 ms or
1 cm keeps its bound, and counts as undecided if that is below the required separation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.mission.failsafe.every_start.return_tubes import Tubes, least_of_pairs
from gcs.mission.failsafe.every_start.start_cells import Rows, Starts, start_cells
from gcs.mission.failsafe.rtl_cases import ReturnEnds
from gcs.mission.failsafe.rtl_motion import Returning, ReturnSpeeds
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

LONGEST_S, RESOLUTION_S, RESOLUTION_M = 1.0, 1e-3, 1e-2
_GAP_SHARE, _GAP_MIN_M, _GAP_MAX_M = 0.5, 0.01, 0.1
_BATCH = 20_000
_ITEMS_MAX = 1_000_000  # what is left then is undecided

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ProvedSeparation:
    """No return brings two vehicles nearer than `proved_m`; one from `t_s` brings rows `pair` to `least_m`.

    The bound is the least about `proved_at_s`.
    """

    proved_m: float
    least_m: float
    t_s: float
    pair: tuple[int, int]
    ends: str
    proved_at_s: float


@dataclass(frozen=True)
class PairItems:
    """Pairs (M,) of vehicles, and intervals of start times."""

    begin_s: Array
    end_s: Array
    first: Rows
    second: Rows

    def __len__(self) -> int:
        return len(self.begin_s)

    def __getitem__(self, index: Mask | slice) -> PairItems:
        return PairItems(self.begin_s[index], self.end_s[index], self.first[index], self.second[index])

    def halved(self) -> PairItems:
        """Both halves of every interval."""
        middle_s = 0.5 * (self.begin_s + self.end_s)
        begin_s, end_s = np.concatenate([self.begin_s, middle_s]), np.concatenate([middle_s, self.end_s])
        return PairItems(begin_s, end_s, np.tile(self.first, 2), np.tile(self.second, 2))


class PairSearch:
    """Halves items until the bound of each is settled."""

    def __init__(
        self,
        plan: Plan,
        ends: ReturnEnds,
        speeds: ReturnSpeeds,
        altitudes_m: Array,
        required_m: float,
        seen_m: float,
        items_max: int = _ITEMS_MAX,
    ) -> None:
        """Begin with a distance that is known to occur. What `items_max` items leave is undecided."""
        self._plan, self._ends, self._speeds, self._altitudes_m = plan, ends, speeds, altitudes_m
        self._required_m = required_m
        self.least_m = seen_m
        self.proved_m = np.inf
        self.where: tuple[float, tuple[int, int], str] = (plan.t_start_s, (0, 0), "")
        self._proved_at_s = plan.t_start_s
        self._looked, self._items_max = 0, items_max

    @property
    def proof(self) -> ProvedSeparation:
        """What is proved by all that was settled."""
        return ProvedSeparation(min(self.proved_m, self.least_m), self.least_m, *self.where, self._proved_at_s)

    @property
    def enough_m(self) -> float:
        """A bound that need not be better: near the least distance seen, and not below the required one."""
        left_m = self.least_m - self._required_m
        if left_m < 0.0:
            return self.least_m - _GAP_MAX_M
        return max(self.least_m - float(np.clip(_GAP_SHARE * left_m, _GAP_MIN_M, _GAP_MAX_M)), self._required_m)

    def settle(self, items: PairItems, *, to_rally: bool) -> None:
        """Bound all items, and their halves as long as that is needed."""
        while len(items):
            parts = [items[n : n + _BATCH] for n in range(0, len(items), _BATCH)]
            settled = [self._bound(part, to_rally=to_rally) for part in parts]
            low_m, fine = (np.concatenate(column) for column in zip(*settled, strict=True))
            self._looked += len(items)
            done = (low_m >= self.enough_m) | fine | (self._looked > self._items_max)
            self.keep(low_m[done], 0.5 * (items.begin_s + items.end_s)[done])
            items = items[~done].halved()

    def keep(self, low_m: Array, t_s: Array) -> None:
        """Bounds that are final."""
        if len(low_m) and low_m.min() < self.proved_m:
            self.proved_m, self._proved_at_s = float(low_m.min()), float(t_s[np.argmin(low_m)])

    def _bound(self, items: PairItems, *, to_rally: bool) -> tuple[Array, Mask]:
        """The bound of each item, and whether it is too small to be halved."""
        times = np.stack([items.begin_s, items.end_s], axis=1)
        spans_s, cell = np.unique(times, axis=0, return_inverse=True)
        cells = start_cells(self._plan, spans_s[:, 0], spans_s[:, 1])
        cell = cell.reshape(-1)
        both = np.concatenate([items.first, items.second]) * len(spans_s) + np.tile(cell, 2)
        key, row = np.unique(both, return_inverse=True)
        rows = np.split(row.reshape(-1), 2)
        starts = cells.starts(key // len(spans_s), key % len(spans_s))
        tubes, open_ends = self._tubes(starts, key // len(spans_s), to_rally=to_rally)
        against_m = cells.against(items.first, items.second, cell)
        low_m = np.full(len(items), np.inf)
        for one in range(len(tubes)):
            for other in range(len(tubes)):
                which = open_ends[one][rows[0]] & open_ends[other][rows[1]]
                if not which.any():
                    continue
                found_m, seen_m = least_of_pairs(
                    tubes[one][(rows[0][which],)],
                    tubes[other][(rows[1][which],)],
                    (against_m[0][which], against_m[1][which]),
                )
                low_m[which] = np.minimum(low_m[which], found_m)
                if one == other == 0:
                    self._look(items[which], seen_m, "nearest" if to_rally else "home")
        reach_m = sum(starts.level_m[n] + starts.vertical_m[n] for n in rows)
        fine = (items.end_s - items.begin_s <= RESOLUTION_S) | (reach_m <= RESOLUTION_M)
        return low_m, fine

    def _look(self, items: PairItems, seen_m: Array, ends: str) -> None:
        at = int(np.argmin(seen_m))
        if seen_m[at] < self.least_m:
            self.least_m = float(seen_m[at])
            t_s = 0.5 * float(items.begin_s[at] + items.end_s[at])
            self.where = (t_s, (int(items.first[at]), int(items.second[at])), ends)

    def _tubes(self, starts: Starts, vehicle: Rows, *, to_rally: bool) -> tuple[list[Tubes], list[Mask]]:
        """Tubes (M,) of vehicles (M,) to the nearest end, the second nearest and so on; whether they may be flown."""
        ends, place_m = self._ends, starts.place_ned_m
        every_m = ends.ned_m if to_rally else ends.ned_m[:, :1]
        places_m, over_m = every_m[vehicle], ends.datum_m(every_m, to_rally=to_rally) + self._altitudes_m[:, None]
        away_m = np.linalg.norm(place_m[:, None, :2] - places_m[..., :2], axis=-1)
        order = np.argsort(away_m, axis=-1, kind="stable")
        tubes, possible = [], []
        for rank in range(places_m.shape[1]):
            chosen = order[:, rank]
            away = np.take_along_axis(away_m, chosen[:, None], axis=-1)[:, 0]
            may = away - away_m.min(axis=-1) <= 2.0 * starts.level_m
            if not may.any():
                break
            to_m, top_m = places_m[np.arange(len(vehicle)), chosen], over_m[vehicle, chosen]
            waits_s = ends.waits_s[None, vehicle]
            case = Returning("", away, place_m[None], to_m[None], top_m[None], self._speeds, waits_s)
            motion_s, motion_m = case.motion(0, 0.0)
            climbs_m = place_m[:, 2] + top_m
            tubes.append(Tubes.of((motion_s, motion_m), starts.level_m, starts.vertical_m, climbs_m, self._speeds))
            possible.append(may)
        return tubes, possible
