"""The distance of every pair of vehicles at every instant: exact while the shape is rigid, bounded while it moves.

A thousand vehicles have half a million pairs. Groups of a tree that are far apart, or whose members move alike, are
bounded together.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.position_limits import ORDER, RESOLUTION_M
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Mask, Rows, halved, joined
from gcs.plan.verification.proof.taylor import Taylor
from gcs.plan.verification.proof.vehicle_tree import VehicleTree, enclosed_table
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, NamedConstraint
from gcs.types import Array


@dataclass(frozen=True)
class PairSeparation:
    """The separation of all vehicles, bounded for pairs (a, b) of groups of one tree."""

    plan: Plan
    tree: VehicleTree

    @cached_property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """The separation alone."""
        return (NamedConstraint(LENGTH_TOLERANCE_M, RESOLUTION_M, ConstraintId(Kind.SEPARATION), "m"),)

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`. A cell that pairs a group of vehicles with itself has no bound, so that it is divided."""
        apart = self._apart(cells)
        length = np.sqrt(sum(apart[axis].middle ** 2 for axis in range(3)))
        toward = apart.middle / np.maximum(length, 1e-9)
        along = (apart[0] * toward[0] + apart[1] * toward[1] + apart[2] * toward[2]).low()
        squared = (apart[0].square() + apart[1].square() + apart[2].square()).low()
        low = np.maximum(along, np.sqrt(np.maximum(squared, 0.0)))
        within = cells.who[:, 0] == cells.who[:, 1]
        limit = self.plan.scenario.limits.separation_min_m
        single = self.tree.parts[cells.who[:, 0], 0] < 0
        low = np.where(within, np.where(single, np.inf, -np.inf), low - limit)
        return low[None], np.where(within, np.inf, length - limit)[None]

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: the wider group, or the time where vehicles move farther than groups are wide."""
        numbers = np.flatnonzero(chosen)
        found, origin = self._parts(cells[numbers])
        return found, numbers[origin]

    def _parts(self, cells: Cells) -> tuple[Cells, Rows]:
        first, second = cells.who.T
        parts = self.tree.parts
        reach = np.where(parts[cells.who, 0] >= 0, self.tree.reach_m[cells.who], -1.0)
        apart = self._apart(cells)
        moved = np.sqrt(sum(apart[axis].deviation() ** 2 for axis in range(3)))
        within, single = first == second, reach.max(axis=1) < 0.0
        long = cells.end_s - cells.start_s > SHORTEST_S
        by_time = np.flatnonzero(~within & long & (single | (moved > 4.0 * reach.max(axis=1))))
        groups = ~single & ~np.isin(np.arange(len(cells)), by_time)
        found, origin = [halved(cells[by_time])], [np.concatenate([by_time, by_time])]

        def add(chosen: Rows, pair: tuple[Rows, Rows]) -> None:
            found.append(replace(cells[chosen], who=np.stack(pair, axis=1)))
            origin.append(chosen)

        inner = np.flatnonzero(groups & within)
        for a, b in ((0, 0), (0, 1), (1, 1)):
            add(inner, (parts[first[inner], a], parts[second[inner], b]))
        for side in (0, 1):
            of_first = np.flatnonzero(groups & ~within & (reach[:, 0] >= reach[:, 1]))
            add(of_first, (parts[first[of_first], side], second[of_first]))
            of_second = np.flatnonzero(groups & ~within & (reach[:, 0] < reach[:, 1]))
            add(of_second, (first[of_second], parts[second[of_second], side]))
        return joined(found), np.concatenate(origin)

    def row(self, who: Rows) -> int:
        """See `Family`."""
        return int(self.tree.row[who[0]])

    def _apart(self, cells: Cells) -> Taylor:
        """The differences (3, N) of places of both groups."""
        shape, tree = self.plan.shape, self.tree
        functions = enclosed(shape.functions, cells.start_s, cells.end_s, ORDER)
        first, second = cells.who.T
        table = shape.basis_ned_m[:, tree.row[first]] - shape.basis_ned_m[:, tree.row[second]]
        return enclosed_table(functions, table, tree.reach[first] + tree.reach[second])
