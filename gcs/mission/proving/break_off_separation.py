"""The distance of pairs while a flight is broken off, bounded over spans of the instant at which all break off.

Cells are the windows of the flight's own separation, with the time since the breaking off beside them: (level, number,
from_s, to_s). On windows of several intervals all of that time is looked at together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs.mission.proving.break_off import BROKEN_OFF, Braking, BreakOff
from gcs.mission.proving.track import FleetMotion
from gcs.mission.proving.track_criteria import PIECE, TrackCriterion, TrackSeparation, squared
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Constraint, Mask, Rows, halved, joined
from gcs.types import Array

AT_REST_S = 1e6  # since the breaking off: all vehicles rest
_ROUNDING_M = 1e-9
_FROM, _TO = 2, 3  # columns of a patch
_DOWN = 2


@dataclass(frozen=True, eq=False)
class BreakOffSeparation:
    """The distance of pairs (a, b) that break off at one instant, at every time after it.

    Vehicles that land do so at speeds and on ground that are not known: once both rest, their level distance counts.
    """

    motion: FleetMotion
    limit_m: float
    vertical_scale: float
    how: BreakOff

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """The one criterion."""
        return (TrackCriterion(f"separation, broken off to {self.how.manoeuvre}", "m", self.limit_m),)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return (BROKEN_OFF,)

    @cached_property
    def _flight(self) -> TrackSeparation:
        """The flight that is broken off; seen from above where vehicles land."""
        return TrackSeparation(self.motion, self.limit_m, np.inf if self.how.lands else self.vertical_scale)

    def cells(self) -> Cells:
        """Every pair on the one window that holds all of the flight."""
        return self._with_times(self._flight.cells())

    def _with_times(self, cells: Cells) -> Cells:
        """Windows with all of the time since the breaking off; single intervals until all rest, and after that."""
        until_s = np.full(len(cells), AT_REST_S)
        single = np.flatnonzero(cells.patch[:, 0] == PIECE)
        if len(single):
            some = cells[single]
            until_s[single] = np.maximum(*(brake.rest_s[1] for brake in self._brakes(some)))
        found = replace(cells, patch=np.column_stack([cells.patch, np.zeros(len(cells)), until_s]))
        if not self.how.lands:
            return found
        rests = found[single]
        patch = rests.patch.copy()
        patch[:, _FROM:] = AT_REST_S
        return joined([found, replace(rests, patch=patch)])

    def _brakes(self, cells: Cells) -> tuple[Braking, Braking]:
        first, second = (
            Braking.of(self.motion, cells.who[:, one], cells.start_s, cells.end_s, self.how.brake_mps2)
            for one in (0, 1)
        )
        return first, second

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        low, seen = np.empty(len(cells)), np.empty(len(cells))
        single = cells.patch[:, 0] == PIECE
        for level in np.unique(cells.patch[~single, 0]).astype(int).tolist():
            chosen = np.flatnonzero(cells.patch[:, 0] == level)
            low[chosen], seen[chosen] = self._of_windows(cells[chosen], level)
        chosen = np.flatnonzero(single)
        if len(chosen):
            low[chosen], seen[chosen] = self._within_one(cells[chosen])
        return low[None] - self.limit_m, seen[None] - self.limit_m

    @cached_property
    def _runs(self) -> tuple[tuple[Array, Array], ...]:
        """Boxes (V, windows, 3) of all that vehicles may reach which break off in windows of 1, 2, 4, ... intervals."""
        found = []
        for low, high, slow, fast in self.motion.windows:
            longest_s = _largest(slow, fast)[..., None] / (2.0 * self.how.brake_mps2)
            found.append((low + np.minimum(slow * longest_s, 0.0), high + np.maximum(fast * longest_s, 0.0)))
        return tuple(found)

    def _of_windows(self, cells: Cells, level: int) -> tuple[Array, Array]:
        """By the boxes of the brakes, and by the distance in flight and how much both velocities differ."""
        number = cells.patch[:, 1].astype(np.intp)
        a, b = cells.who.T
        flight, _ = self._flight.of_windows(cells, level)
        _, _, slow, fast = self.motion.windows[level]
        fastest = np.maximum(*(_largest(slow[row, number], fast[row, number]) for row in (a, b)))
        _, _, slow, fast = self.motion.relative.windows[level]
        against = _largest(slow[a, number] - fast[b, number], fast[a, number] - slow[b, number])
        low, high = self._runs[level]
        gap = np.maximum(low[a, number] - high[b, number], low[b, number] - high[a, number])
        boxes = np.linalg.norm(np.maximum(gap, 0.0) * self._flight.scale, axis=1)
        stretched = max(1.0, 1.0 / self._flight.vertical_scale)
        together = flight - against * fastest / self.how.brake_mps2 * stretched
        middle = replace(cells, start_s=cells.middle_s, end_s=cells.middle_s)
        seen = self._distance_m(*self._brakes(middle), np.full(len(cells), AT_REST_S))
        return np.maximum(boxes, together) - _ROUNDING_M, seen

    def _within_one(self, cells: Cells) -> tuple[Array, Array]:
        """By the box, by the tangent in the middle's direction, and as windows are."""
        first, second = self._brakes(cells)
        begin_s, until_s = cells.patch[:, _FROM], cells.patch[:, _TO]
        middle_s = 0.5 * (begin_s + until_s)
        rests = (begin_s >= AT_REST_S) & self.how.lands
        scale = np.stack([np.ones(len(cells))] * 2 + [np.where(rests, 0.0, 1.0 / self.vertical_scale)])
        stretched = scale.max(axis=0)
        apart = (first.place - second.place) * scale
        runs = first.run_m(middle_s) - second.run_m(middle_s)
        spread_m = first.spread_m(until_s) + second.spread_m(until_s)
        # How far each may have descended: it has begun when it rests, at the earliest.
        sunk_m = [np.zeros(len(cells))] * 2
        if self.how.lands:
            sunk_m = [self.how.sink_mps * np.maximum(until_s - brake.rest_s[0], 0.0) for brake in (first, second)]
            sunk_m = [np.where(rests, 0.0, sunk) for sunk in sunk_m]
        low, high = apart.range()
        steps = []
        for brake, sign in ((first, 1.0), (second, -1.0)):
            ends = [sign * (brake.run_m(at_s) - brake.run_m(middle_s)) * scale for at_s in (begin_s, until_s)]
            steps.append((np.minimum(*ends), np.maximum(*ends)))
        low = low + runs * scale + steps[0][0] + steps[1][0] - spread_m * scale
        high = high + runs * scale + steps[0][1] + steps[1][1] + spread_m * scale
        low[_DOWN] -= sunk_m[1] * scale[_DOWN]
        high[_DOWN] += sunk_m[0] * scale[_DOWN]
        boxes = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0), axis=0)
        # Toward the nearest that the middle may be
        nearest = apart.middle + runs * scale
        nearest[_DOWN] = _nearest(nearest[_DOWN], sunk_m[1] * scale[_DOWN], sunk_m[0] * scale[_DOWN])
        toward = nearest / np.maximum(np.linalg.norm(nearest, axis=0), 1e-9)
        along = (apart[0] * toward[0] + apart[1] * toward[1] + apart[2] * toward[2]).low()
        along = along + np.sum(toward * runs * scale, axis=0) - spread_m * stretched
        ends_s = [begin_s, until_s, *(np.clip(_ends_s(brake), begin_s, until_s) for brake in (first, second))]
        rates = [
            np.abs(np.sum(toward * (first.speed_mps(at_s) - second.speed_mps(at_s)) * scale, axis=0)) for at_s in ends_s
        ]
        along = along - 0.5 * (until_s - begin_s) * np.max(rates, axis=0)
        along = along - np.where(toward[_DOWN] > 0.0, sunk_m[1], sunk_m[0]) * np.abs(toward[_DOWN]) * scale[_DOWN]
        flat = scale * np.array([[1.0], [1.0], [0.0 if self.how.lands else 1.0]])
        together = np.sqrt(np.maximum(squared((first.place - second.place) * flat).low(), 0.0))
        together = together - first.against_m(second, until_s) * stretched
        low_m = np.maximum(np.maximum(boxes, along), together) - _ROUNDING_M
        seen_m = [self._distance_m(first, second, at_s) for at_s in (begin_s, middle_s, until_s)]
        return low_m, np.min(seen_m, axis=0)

    def _distance_m(self, first: Braking, second: Braking, after_s: Array) -> Array:
        """The least distance (M,) that occurs so long after all broke off in the middle of a cell."""
        apart = (first.place - second.place).middle + first.run_m(after_s) - second.run_m(after_s)
        if self.how.lands:
            sunk_m = [self.how.sink_mps * np.maximum(after_s - _ends_s(brake), 0.0) for brake in (first, second)]
            apart[_DOWN] = np.where(after_s >= AT_REST_S, 0.0, _nearest(apart[_DOWN], sunk_m[1], sunk_m[0]))
        apart[_DOWN] /= self.vertical_scale
        return np.asarray(np.linalg.norm(apart, axis=0))

    def moved_m(self, cells: Cells) -> Array:
        """How much (M,) what was seen differs at equal times for other instants of the cell, at most."""
        first, second = self._brakes(cells)
        deviation = np.linalg.norm((first.place - second.place).deviation(), axis=0)
        until_s = cells.patch[:, _TO]
        moved = deviation + first.spread_m(until_s) + second.spread_m(until_s)
        if self.how.lands:
            moved += sum(self.how.sink_mps * (brake.rest_s[1] - brake.rest_s[0]) for brake in (first, second))
        return np.where(cells.patch[:, 0] == PIECE, moved * max(1.0, 1.0 / self.vertical_scale), np.inf)

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: both halves of a window; then of the instants or of the time since, whichever matters more."""
        single = cells.patch[:, 0] == PIECE
        wide = chosen & ~single
        parts, origin = self._flight.children(replace(cells, patch=cells.patch[:, :_FROM]), wide)
        found = [self._with_times(parts)]
        twice = len(found[0]) - len(parts)
        origins = [origin, origin[parts.patch[:, 0] == PIECE][:twice]]
        narrow = np.flatnonzero(chosen & single)
        if len(narrow):
            some = cells[narrow]
            begin_s, until_s = some.patch[:, _FROM], some.patch[:, _TO]
            brakes = self._brakes(some)
            of_instant = np.linalg.norm((brakes[0].place - brakes[1].place).deviation(), axis=0)
            of_instant = of_instant + sum(brake.spread_m(until_s) for brake in brakes)
            of_time = sum(np.linalg.norm(brake.run_m(until_s) - brake.run_m(begin_s), axis=0) for brake in brakes)
            if self.how.lands:
                of_time = of_time + self.how.sink_mps * (until_s - begin_s)
                of_instant = of_instant + sum(
                    self.how.sink_mps * (brake.rest_s[1] - brake.rest_s[0]) for brake in brakes
                )
            can_time, can_instant = until_s - begin_s > SHORTEST_S, some.end_s - some.start_s > SHORTEST_S
            in_time = can_time & ((of_time > of_instant) | ~can_instant)
            in_instant = can_instant & ~in_time
            for side in (0, 1):
                half = some[in_time]
                patch = half.patch.copy()
                patch[:, _TO - side] = 0.5 * (patch[:, _FROM] + patch[:, _TO])
                found.append(replace(half, patch=patch))
                origins.append(narrow[in_time])
            found.append(halved(some[in_instant]))
            origins += [narrow[in_instant]] * 2
        return joined(found), np.concatenate(origins)


def _ends_s(brake: Braking) -> Array:
    """The time (M,) at which the middle one rests."""
    return np.asarray(np.linalg.norm(brake.velocity.middle, axis=0) / brake.brake_mps2)


def _nearest(value: Array, below: Array, above: Array) -> Array:
    """The value (...) nearest to 0 from `below` below one to `above` above it."""
    return np.asarray(np.clip(0.0, value - below, value + above))


def _largest(low: Array, high: Array) -> Array:
    """The length (...) that no vector of a box (..., 3) exceeds."""
    return np.asarray(np.linalg.norm(np.maximum(np.abs(low), np.abs(high)), axis=-1))
