"""Return altitudes of a large fleet: a few levels, on each of them only vehicles that stay apart there.

Vehicles begin on any level. Of those that come too near to others, one moves to a level on which fewer are in its way,
until nobody is; more levels are tried where that does not end. Distances are looked at from few instants first; an
instant at which that was not enough is added. They are compared in whole steps, so that the last bits of a plan choose
nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from gcs.mission.returns.rtl_cases import Returning, pair_distances
from gcs.types import Array
from gcs.util.long_work import report

_LEVELS = (3, 5, 8, 12)  # so many are tried
LEVELS = _LEVELS[-1]
_SHARES = (1.0, 0.5, 0.2)  # of what is wanted beyond the required distance: it may be less between instants
_FIRST_EVERY = 8  # of the instants given
_MOVES_MAX, _ROUNDS_MAX = 80, 12
_TABU = 12  # moves for which a vehicle does not go back to its level
_GAP_STEP_M = 0.05
_AT_ONCE = 20_000

Rows = NDArray[np.intp]


def lane_order(cases: Sequence[Returning], altitudes_m: Array, wanted_m: float, required_m: float) -> Rows:
    """The level (V,) of each vehicle: the wanted distance, or else some beyond the required one; all 0 if none does."""
    for share in _SHARES:
        found = assigned_levels(cases, altitudes_m, required_m + share * (wanted_m - required_m))
        if found is not None:
            return found
    return np.zeros(altitudes_m.shape[1], dtype=np.intp)


def assigned_levels(cases: Sequence[Returning], altitudes_m: Array, required_m: float) -> Rows | None:
    """The level (V,) of each vehicle, with which no two come nearer than `required_m`; None if none was found.

    `altitudes_m` (L, V) are those of each level above each vehicle's home. All returns of the cases are looked at.
    """
    for levels in _LEVELS:
        search = _Search(cases, altitudes_m[:levels], required_m)
        for number in range(_ROUNDS_MAX):
            tried = f"{levels} levels, round {number + 1} of {_ROUNDS_MAX}"
            report(f"looking for return altitudes that keep every vehicle apart: {tried}")
            if not search.settled():
                break
            if not search.added():
                return search.levels
    return None


class _Search:
    """Levels (V,), the instants looked at so far, and what is known of the distances there."""

    def __init__(self, cases: Sequence[Returning], altitudes_m: Array, required_m: float) -> None:
        self._cases, self._altitudes_m, self._required_m = cases, altitudes_m, required_m
        levels, vehicles = altitudes_m.shape
        self._instants = [set(range(0, len(case.t_s), _FIRST_EVERY)) for case in cases]
        # Whether two vehicles at these levels are too near at an instant looked at; -1: not known yet.
        self._known = np.full((vehicles, vehicles, levels, levels), -1, dtype=np.int8)
        self._first, self._second = np.triu_indices(vehicles, 1)
        self._random = np.random.default_rng(0)
        self.levels: Rows = np.asarray(self._random.integers(0, levels, size=vehicles), dtype=np.intp)

    def settled(self) -> bool:
        """Move vehicles until none is too near to another at the instants looked at; whether that was possible."""
        levels, vehicles = self._altitudes_m.shape
        tabu = np.zeros((vehicles, levels), dtype=np.intp)
        for move in range(_MOVES_MAX):
            every = np.arange(vehicles)
            near = self._near(*np.meshgrid(every, every, indexing="ij"), self.levels[:, None], self.levels[None])
            rows = np.flatnonzero(near.any(axis=1))
            if not len(rows):
                return True
            row, other, at = np.meshgrid(rows, every, np.arange(levels), indexing="ij")
            conflicts = self._near(row, other, at, self.levels[other]).sum(axis=1)
            gain = near[rows].sum(axis=1)[:, None] - conflicts
            gain = gain + 0.5 * self._random.random(gain.shape)  # of equal moves any
            gain[(tabu[rows] > move) | (np.arange(levels) == self.levels[rows][:, None])] = -vehicles
            best, level = np.unravel_index(int(np.argmax(gain)), gain.shape)
            moved = int(rows[best])
            tabu[moved, self.levels[moved]] = move + _TABU
            self.levels[moved] = level
        return False

    def added(self) -> bool:
        """Look at all instants; those at which two vehicles are too near are added. Whether there are any."""
        found = False
        levels = self.levels[self._first], self.levels[self._second]
        for case, instants in zip(self._cases, self._instants, strict=True):
            rest = np.array(sorted(set(range(len(case.t_s))) - instants), dtype=np.intp)
            near = self._too_near(case, rest, (self._first, self._second), levels)
            if near.any():
                found = True
                # One instant of each pair that is too near; other instants may then need no look of their own.
                instants |= {int(rest[np.argmax(row)]) for row in near[near.any(axis=1)]}
        if found:
            self._known[:] = -1
        return found

    def _near(self, first: Rows, second: Rows, at_first: Rows, at_second: Rows) -> NDArray[np.bool_]:
        """Whether pairs at these levels are too near at one of the instants looked at; nobody is near to itself."""
        index = np.broadcast_arrays(first, second, at_first, at_second)
        new = np.argwhere(self._wanted(index))
        if len(new):
            i, j, k, m = new.T
            near = np.zeros(len(new), dtype=bool)
            for case, instants in zip(self._cases, self._instants, strict=True):
                at = np.array(sorted(instants), dtype=np.intp)
                near |= self._too_near(case, at, (i, j), (k, m)).any(axis=1)
            self._known[i, j, k, m] = self._known[j, i, m, k] = near
        return np.asarray((self._known[tuple(index)] > 0) & (index[0] != index[1]))

    def _wanted(self, index: Sequence[Rows]) -> NDArray[np.bool_]:
        """The unknown ones among these pairs, each once: the first vehicle comes before the second."""
        i, j, k, m = (each.ravel() for each in index)
        wanted = np.zeros(self._known.shape, dtype=bool)
        forth, back = i < j, i > j
        wanted[i[forth], j[forth], k[forth], m[forth]] = True
        wanted[j[back], i[back], m[back], k[back]] = True
        return wanted & (self._known < 0)

    def _too_near(
        self, case: Returning, instants: Rows, pairs: tuple[Rows, Rows], levels: tuple[Rows, Rows]
    ) -> NDArray[np.bool_]:
        """Whether (M, I) pairs come too near in returns from these instants of a case.

        Seen from above a return is straight: only pairs whose lines come near each other are looked at in time.
        """
        begin, end = case.from_ned_m[:, instants, :2], case.to_ned_m[:, instants, :2]
        lines = shapely.linestrings(np.stack([begin, end], axis=2))
        beside_m = shapely.distance(lines[pairs[0]], lines[pairs[1]])
        found = np.zeros(beside_m.shape, dtype=bool)
        pair, at = np.nonzero(beside_m < self._required_m)
        for some in range(0, len(pair), _AT_ONCE):
            which, when = pair[some : some + _AT_ONCE], instants[at[some : some + _AT_ONCE]]
            motions = [
                case.at(vehicles[which], when, self._altitudes_m[level[which], vehicles[which]])
                for vehicles, level in zip(pairs, levels, strict=True)
            ]
            gaps_m = np.floor(pair_distances(*motions) / _GAP_STEP_M + 0.5) * _GAP_STEP_M
            found[which, at[some : some + _AT_ONCE]] = gaps_m < self._required_m
        return found
