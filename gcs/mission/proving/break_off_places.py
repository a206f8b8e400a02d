"""Heights, zones and the ground while a flight is broken off, bounded over spans of the instant of the breaking off.

Vehicles that land stay above the place at which they come to rest: for zones they do as those that hold, and what is
below them counts too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.mission.proving.break_off import BROKEN_OFF, Braking, BreakOff
from gcs.mission.proving.track import FleetMotion
from gcs.mission.proving.track_criteria import TrackCriterion, TrackPlaces
from gcs.plan.verification.constraints.ground_clearance import GroundClearance
from gcs.plan.verification.constraints.position_limits import ORDER, outside_moved_zone
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Constraint, Mask, Rows, halved, joined
from gcs.plan.verification.proof.taylor import Taylor
from gcs.plan.verification.proof.vehicle_tree import VehicleTree
from gcs.scenario.environment.no_fly import Zone, displacement_m, zone_changes_s
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array

_TIMES_MPS = 1.0  # as if a zone that begins or ends moved so fast
_FROM, _TO = 0, 1  # columns of a patch: time since the breaking off
WAY_HALVES = 2**11 - 1  # of a way to rest, over the ground: down to a thousandth of it


@dataclass(frozen=True, eq=False)
class BreakOffPlaces(TrackPlaces):
    """Heights above 0 and zones, at every time after a vehicle broke off."""

    how: BreakOff

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """In the order of the margins."""
        return tuple(replace(one, name=f"{one.name}, broken off to {self.how.manoeuvre}") for one in super().criteria)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return (BROKEN_OFF,) * len(self.criteria)

    def cells(self) -> Cells:
        """Every piece of every vehicle, until it rests and no zone changes any more."""
        row, start_s, end_s = self.motion.row, self.motion.starts_s, self.motion.ends_s
        cells = Cells(row[:, None], start_s, end_s, np.zeros(len(row), dtype=np.intp), np.zeros((len(row), 2)))
        if self.how.manoeuvre == "return":
            cells.patch[:, _TO] = self._braking(cells).rest_s[1]
            return cells
        moved_s = float(zone_changes_s([zone for _, zone in self.zones]).max(initial=-np.inf))
        cells.patch[:, _TO] = np.maximum(self._braking(cells).rest_s[1], moved_s - start_s)
        return cells

    def _braking(self, cells: Cells) -> Braking:
        return Braking.of(self.motion, cells.who[:, 0], cells.start_s, cells.end_s, self.how.brake_mps2)

    def _place(self, cells: Cells) -> Taylor:
        return self._braking(cells).enclosed(*cells.patch.T)

    def _outside(self, zone: Zone, place: Taylor, cells: Cells) -> tuple[Array, Array]:
        moved = np.zeros((ORDER + 1, 2, len(cells)))
        first_s, last_s = cells.start_s + cells.patch[:, _FROM], cells.end_s + cells.patch[:, _TO]
        moved[0] = displacement_m(zone, 0.5 * (first_s + last_s)).T
        off = np.zeros((2, len(cells)))
        for at_s in (first_s, last_s, *(np.clip(move[0], first_s, last_s) for move in zone.moves)):
            off = np.maximum(off, np.abs(displacement_m(zone, at_s).T - moved[0]))
        return outside_moved_zone(zone, place, Taylor(moved, off), (first_s, last_s), descends=self.how.lands)

    def moved_m(self, cells: Cells) -> Array:
        """How much (M,) a margin in the middle differs at equal times for other instants of the cell, at most."""
        braking = self._braking(cells)
        moved = np.linalg.norm(braking.place.deviation(), axis=0) + braking.spread_m(cells.patch.mean(axis=1))
        if len(zone_changes_s([zone for _, zone in self.zones])):
            moved = np.full(len(cells), np.inf)
        return np.asarray(moved)

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: halves of the instants or of the time since, whichever matters more."""
        rows = np.flatnonzero(chosen)
        some = cells[rows]
        braking, (begin_s, until_s) = self._braking(some), some.patch.T
        of_instant = np.linalg.norm(braking.place.deviation(), axis=0) + braking.spread_m(until_s)
        of_time = np.linalg.norm(braking.run_m(until_s) - braking.run_m(begin_s), axis=0)
        for _, zone in self.zones:
            if zone.moves:
                ends = (displacement_m(zone, at_s) for at_s in (some.start_s + begin_s, some.start_s + until_s))
                of_time = of_time + np.linalg.norm(np.subtract(*ends), axis=1)
            if zone.in_force_s is not None:  # both count in the same way for whether it is in force
                of_time = of_time + _TIMES_MPS * (until_s - begin_s)
                of_instant = of_instant + _TIMES_MPS * (some.end_s - some.start_s)
        can_time, can_instant = until_s - begin_s > SHORTEST_S, some.end_s - some.start_s > SHORTEST_S
        in_time = can_time & ((of_time > of_instant) | ~can_instant)
        in_instant = can_instant & ~in_time
        found, origins = [halved(some[in_instant])], [rows[in_instant]] * 2
        for side in (0, 1):
            half = some[in_time]
            patch = half.patch.copy()
            patch[:, _TO - side] = 0.5 * patch.sum(axis=1)
            found.append(replace(half, patch=patch))
            origins.append(rows[in_time])
        return joined(found), np.concatenate(origins)


def ground_below_brakes(
    motion: FleetMotion, airborne: Mask, terrain: Terrain, limit_m: float, how: BreakOff
) -> tuple[GroundClearance, tuple[TrackCriterion, ...], Cells, Callable[[Cells], Array]]:
    """The clearance on the way to rest of vehicles that break off in pieces (P,) in which they are `airborne`.

    With its criteria, its cells, and how much what is seen differs for other instants of a cell, at most.
    Ways are halved as groups of vehicles are: half n of vehicle v's way has the number v * `WAY_HALVES` + n, and its
    own halves are 2 n + 1 and 2 n + 2.
    """
    vehicles = len(motion.begins)
    node = np.arange(WAY_HALVES)
    inner = np.where(2 * node + 2 < WAY_HALVES, 2 * node + 1, -1)
    parts = np.stack([inner, np.where(inner < 0, -1, inner + 1)], axis=1)
    first = np.arange(vehicles).repeat(WAY_HALVES)[:, None] * WAY_HALVES
    every = np.tile(parts, (vehicles, 1))
    depth = np.floor(np.log2(node + 1.0))
    begins = (node + 1.0 - 2.0**depth) * 0.5**depth
    _, _, slow, fast = motion.windows[-1]
    fastest = np.linalg.norm(np.maximum(np.abs(slow), np.abs(fast)), axis=2).max(axis=1)
    reach_m = fastest[:, None] ** 2 / (4.0 * how.brake_mps2) * 0.5**depth
    row = np.arange(vehicles).repeat(WAY_HALVES)
    none = np.zeros((len(row), 3))
    ways = VehicleTree(row, np.where(every < 0, -1, every + first), none[:, None][:, :0], reach_m.ravel(), none)

    def places(some: Cells) -> Taylor:
        vehicle, half = np.divmod(some.who[:, 0], WAY_HALVES)
        braking = Braking.of(motion, vehicle, some.start_s, some.end_s, how.brake_mps2)
        return braking.share(begins[half], begins[half] + 0.5 ** depth[half])

    def moved_m(some: Cells) -> Array:
        braking = Braking.of(motion, some.who[:, 0] // WAY_HALVES, some.start_s, some.end_s, how.brake_mps2)
        north, east, down = places(some).middle
        # From below the ground a vehicle may come as near to it as it moves.
        depth_m = np.maximum(ground_height_m(terrain, north, east) + down, 0.0)
        moved = np.linalg.norm(braking.place.deviation(), axis=0) + braking.spread_m(np.full(len(some), np.inf))
        return np.asarray(moved + depth_m)

    spans = motion.starts_s[airborne], motion.ends_s[airborne]
    who = (motion.row[airborne] * WAY_HALVES)[:, None].astype(np.intp)
    cells = Cells(who, *spans, np.zeros(len(who), dtype=np.intp), np.zeros((len(who), 0)))
    family = GroundClearance(places, ways, terrain, limit_m, np.array([0]), np.zeros((1, vehicles)))
    criteria = (
        TrackCriterion(f"clearance above the ground, broken off to {how.manoeuvre}", "m", limit_m),
        TrackCriterion("room beside the ground", "m", 0.0),
    )
    return family, criteria, family.around(cells), moved_m
