"""The separation that straight returns (RTL) keep, at whatever instant of the plan all vehicles are ordered to return.

Intervals of start times are halved until the bound of each pair is near enough to the least distance seen. What is
left at 1 ms or 1 cm keeps its bound, and counts as undecided if that is below the required separation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.traits import FleetFirmware
from gcs.mission.failsafe.every_start.return_tubes import Tubes, least_of_pairs
from gcs.mission.failsafe.every_start.start_cells import Rows, StartCells, plan_intervals, start_cells
from gcs.mission.failsafe.rtl_cases import ReturnEnds, return_ends
from gcs.mission.failsafe.rtl_motion import Returning, ReturnSpeeds
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

RESOLUTION_S, RESOLUTION_M = 1e-3, 1e-2
_LONGEST_S = 1.0
_GAP_SHARE, _GAP_MIN_M, _GAP_MAX_M = 0.5, 0.01, 0.1
_BATCH = 20_000
_ITEMS_MAX = 1_000_000  # what is left then is undecided

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ProvedSeparation:
    """No return brings two vehicles nearer than `proved_m`; one from `t_s` brings rows `pair` to `least_m`."""

    proved_m: float
    least_m: float
    t_s: float
    pair: tuple[int, int]
    ends: str


def proved_separation(
    plan: Plan,
    firmware: FleetFirmware,
    speeds: ReturnSpeeds,
    altitudes_m: Array,
    rally_ned_m: Array,
    required_m: float,
    seen_m: float,
) -> ProvedSeparation:
    """The proved separation of returns at these altitudes (V,); `seen_m` is a distance that is known to occur."""
    found = _Search(plan, return_ends(plan, firmware, rally_ned_m), speeds, altitudes_m, required_m, seen_m)
    begin_s, end_s = plan_intervals(plan, _LONGEST_S)
    first, second = np.triu_indices(len(altitudes_m), 1)
    cells, pairs = len(begin_s), len(first)
    items = _Items(np.repeat(begin_s, pairs), np.repeat(end_s, pairs), np.tile(first, cells), np.tile(second, cells))
    for to_rally in (False, True):
        found.settle(items, to_rally=to_rally)
    return ProvedSeparation(min(found.proved_m, found.least_m), found.least_m, *found.where)


@dataclass(frozen=True)
class _Items:
    """Pairs (M,) of vehicles, and intervals of start times."""

    begin_s: Array
    end_s: Array
    first: Rows
    second: Rows

    def __len__(self) -> int:
        return len(self.begin_s)

    def __getitem__(self, index: Mask | slice) -> _Items:
        return _Items(self.begin_s[index], self.end_s[index], self.first[index], self.second[index])

    def halved(self) -> _Items:
        """Both halves of every interval."""
        middle_s = 0.5 * (self.begin_s + self.end_s)
        begin_s, end_s = np.concatenate([self.begin_s, middle_s]), np.concatenate([middle_s, self.end_s])
        return _Items(begin_s, end_s, np.tile(self.first, 2), np.tile(self.second, 2))


class _Search:
    """Halves items until the bound of each is settled."""

    def __init__(
        self,
        plan: Plan,
        ends: ReturnEnds,
        speeds: ReturnSpeeds,
        altitudes_m: Array,
        required_m: float,
        seen_m: float,
    ) -> None:
        self._plan, self._ends, self._speeds, self._altitudes_m = plan, ends, speeds, altitudes_m
        self._required_m = required_m
        self.least_m = seen_m
        self.proved_m = np.inf
        self.where: tuple[float, tuple[int, int], str] = (plan.t_start_s, (0, 0), "")
        self._looked = 0

    @property
    def _enough_m(self) -> float:
        left_m = self.least_m - self._required_m
        if left_m < 0.0:
            return self.least_m - _GAP_MAX_M
        return max(self.least_m - float(np.clip(_GAP_SHARE * left_m, _GAP_MIN_M, _GAP_MAX_M)), self._required_m)

    def settle(self, items: _Items, *, to_rally: bool) -> None:
        """Bound all items, and their halves as long as that is needed."""
        while len(items):
            parts = [items[n : n + _BATCH] for n in range(0, len(items), _BATCH)]
            settled = [self._bound(part, to_rally=to_rally) for part in parts]
            low_m, fine = (np.concatenate(column) for column in zip(*settled, strict=True))
            self._looked += len(items)
            done = (low_m >= self._enough_m) | fine | (self._looked > _ITEMS_MAX)
            self.proved_m = min(self.proved_m, float(np.min(low_m[done], initial=np.inf)))
            items = items[~done].halved()

    def _bound(self, items: _Items, *, to_rally: bool) -> tuple[Array, Mask]:
        """The bound of each item, and whether it is too small to be halved."""
        times = np.stack([items.begin_s, items.end_s], axis=1)
        spans_s, cell = np.unique(times, axis=0, return_inverse=True)
        cells = start_cells(self._plan, spans_s[:, 0], spans_s[:, 1])
        cell = cell.reshape(-1)
        rows = np.unique([items.first, items.second])
        tubes, open_ends = self._tubes(cells, rows, to_rally=to_rally)
        against_m = cells.against(items.first, items.second, cell)
        low_m = np.full(len(items), np.inf)
        for one in range(len(tubes)):
            for other in range(len(tubes)):
                which = open_ends[one][items.first, cell] & open_ends[other][items.second, cell]
                if not which.any():
                    continue
                index = cell[which]
                found_m, seen_m = least_of_pairs(
                    tubes[one][items.first[which], index],
                    tubes[other][items.second[which], index],
                    (against_m[0][which], against_m[1][which]),
                )
                low_m[which] = np.minimum(low_m[which], found_m)
                if one == other == 0:
                    self._look(items[which], seen_m, "nearest" if to_rally else "home")
        reach_m = (cells.level_m + cells.vertical_m)[items.first, cell]
        reach_m = reach_m + (cells.level_m + cells.vertical_m)[items.second, cell]
        fine = (items.end_s - items.begin_s <= RESOLUTION_S) | (reach_m <= RESOLUTION_M)
        return low_m, fine

    def _look(self, items: _Items, seen_m: Array, ends: str) -> None:
        at = int(np.argmin(seen_m))
        if seen_m[at] < self.least_m:
            self.least_m = float(seen_m[at])
            t_s = 0.5 * float(items.begin_s[at] + items.end_s[at])
            self.where = (t_s, (int(items.first[at]), int(items.second[at])), ends)

    def _tubes(self, cells: StartCells, rows: Rows, *, to_rally: bool) -> tuple[list[Tubes], list[Mask]]:
        """Tubes (V, N) to the nearest end, to the second nearest and so on, and whether a return may lead there.

        Those of other vehicles than `rows` stay empty.
        """
        ends = self._ends
        count = len(cells.begin_s)
        places_m = ends.ned_m if to_rally else ends.ned_m[:, :1]
        away_m = np.linalg.norm(cells.place_ned_m[:, :, None, :2] - places_m[:, None, :, :2], axis=-1)
        order = np.argsort(away_m, axis=-1, kind="stable")
        tubes, possible = [], []
        least_m = away_m.min(axis=-1)
        for rank in range(places_m.shape[1]):
            chosen = order[..., rank]
            away = np.take_along_axis(away_m, chosen[..., None], axis=-1)[..., 0]
            may = away - least_m <= 2.0 * cells.level_m
            if not may[rows].any():
                break
            to = np.take_along_axis(places_m, chosen[..., None], axis=1)
            datum_m = ends.datum_m(to, to_rally=to_rally)
            case = Returning("", cells.middle_s, cells.place_ned_m, to, datum_m, self._speeds, ends.waits_s)
            times_s, places = np.zeros((len(away_m), count, 5)), np.zeros((len(away_m), count, 5, 3))
            for row in rows.tolist():
                times_s[row], places[row] = case.motion(row, self._altitudes_m[row])
            climbs_m = cells.place_ned_m[..., 2] + datum_m + self._altitudes_m[:, None]
            tubes.append(Tubes.of((times_s, places), cells.level_m, cells.vertical_m, climbs_m, self._speeds))
            possible.append(may)
        return tubes, possible
