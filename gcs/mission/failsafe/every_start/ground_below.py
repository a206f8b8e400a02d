"""The highest ground below return tracks: a bound that holds between samples, and at whatever instant returns begin.

Tracks are divided along their length, and by the instants at which they begin. The ground of a part is bounded over the
rectangle that holds it. Parts whose bound is below a height that was seen are done with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.traits import FleetFirmware
from gcs.mission.failsafe.every_start.start_cells import Rows, plan_intervals, start_cells
from gcs.mission.failsafe.rtl_cases import return_ends
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.ground_bounds import Highest, highest_ground

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

GAP_M = 0.01  # between the bound and a height that was seen
_LONGEST_S = 4.0
_LEAST_M = 1e-3  # of a part's half length: it is not divided further
_PARTS_MAX = 500_000  # looked at; of what is left then, the bound counts


def highest_below_returns_m(plan: Plan, firmware: FleetFirmware, rally_ned_m: Array, seen_m: float) -> float:
    """A height that no ground below straight returns is above: `seen_m`, or at most `GAP_M` above the ground."""
    ends = return_ends(plan, firmware, rally_ned_m).ned_m[..., :2]
    begin_s, end_s = plan_intervals(plan, _LONGEST_S)
    cells, vehicles, count = len(begin_s), *ends.shape[:2]
    cell, vehicle, end = (index.ravel() for index in np.indices((cells, vehicles, count)))
    parts = _Parts(vehicle, end, begin_s[cell], end_s[cell], np.zeros(len(cell)), np.ones(len(cell)))
    search = _Highest(highest_ground(plan.scenario.terrain), seen_m)
    while len(parts.vehicle):
        spans_s, index = np.unique(parts.begin_s + 1j * parts.end_s, return_inverse=True)
        starts = start_cells(plan, spans_s.real, spans_s.imag).starts(parts.vehicle, index.reshape(-1))
        place_m, to_m = starts.place_ned_m[:, :2], ends[parts.vehicle, parts.end]
        away_m = np.linalg.norm(place_m[:, None] - ends[parts.vehicle], axis=-1)
        # Home is an end of every vehicle; a rally point is one only where it may be the nearest.
        own_m = np.take_along_axis(away_m, parts.end[:, None], axis=1)[:, 0]
        flown = (parts.end == 0) | (own_m - away_m.min(axis=1) <= 2.0 * starts.level_m)
        share, half = 0.5 * (parts.first + parts.last), 0.5 * (parts.last - parts.first)
        centre_m = place_m + share[:, None] * (to_m - place_m)
        beside_m = (1.0 - parts.first) * starts.level_m
        reach_m = half[:, None] * np.abs(to_m - place_m) + beside_m[:, None]
        along = half * own_m >= beside_m
        left = search.left(centre_m, reach_m, flown)
        parts = parts.halved(left, along=along)
    return search.bound_m


def highest_along_m(plan: Plan, begin_m: Array, end_m: Array, seen_m: float) -> float:
    """A height that no ground below straight lines (N, 2) to (N, 2) is above: `seen_m`, or at most `GAP_M` above it."""
    search = _Highest(highest_ground(plan.scenario.terrain), seen_m)
    while len(begin_m):
        middle_m = 0.5 * (begin_m + end_m)
        left = search.left(middle_m, 0.5 * np.abs(end_m - begin_m), np.ones(len(begin_m), dtype=bool))
        begin_m, end_m = (
            np.concatenate([begin_m[left], middle_m[left]]),
            np.concatenate([middle_m[left], end_m[left]]),
        )
    return search.bound_m


@dataclass(frozen=True)
class _Parts:
    """Parts (M,) of tracks: of a vehicle, to an end, of returns that begin in an interval, between two shares."""

    vehicle: Rows
    end: Rows
    begin_s: Array
    end_s: Array
    first: Array
    last: Array

    def halved(self, kept: NDArray[np.bool_], *, along: NDArray[np.bool_]) -> _Parts:
        """Both halves of each part to keep: of its length, or of its interval."""
        middle_s, middle = 0.5 * (self.begin_s + self.end_s), 0.5 * (self.first + self.last)
        one = (self.begin_s, np.where(along, self.end_s, middle_s), self.first, np.where(along, middle, self.last))
        two = (np.where(along, self.begin_s, middle_s), self.end_s, np.where(along, middle, self.first), self.last)
        both = (np.concatenate([a[kept], b[kept]]) for a, b in zip(one, two, strict=True))
        return _Parts(np.tile(self.vehicle[kept], 2), np.tile(self.end[kept], 2), *both)


class _Highest:
    """The highest ground that was seen, and the highest bound; a height that is given counts as bound."""

    def __init__(self, highest: Highest, given_m: float) -> None:
        self._highest, self._given_m, self.bound_m, self._seen_m = highest, given_m, given_m, -np.inf
        self._looked = 0

    def left(self, centre_m: Array, reach_m: Array, flown: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which rectangles (M, 2) are to be divided; only those that are `flown` count."""
        self._looked += len(centre_m)
        left = flown.copy()
        if not flown.any():
            return left
        # The middle is below a track of the part's own middle instant: there is this ground.
        self._seen_m = max(self._seen_m, float(self._highest(centre_m[flown], centre_m[flown]).max()))
        high_m = self._highest(centre_m[flown] - reach_m[flown], centre_m[flown] + reach_m[flown])
        small = (reach_m[flown].max(axis=1) <= _LEAST_M) | (self._looked > _PARTS_MAX)
        done = (high_m <= max(self._given_m, self._seen_m + GAP_M)) | small
        self.bound_m = max(self.bound_m, float(high_m[done].max(initial=-np.inf)))
        left[flown] = ~done
        return left
