"""Groups of vehicles as a binary tree: where they have similar values, one bound holds for all of a group."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gcs.plan.formation.shape import Rows, Shape
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.taylor import Taylor
from gcs.types import Array


@dataclass(frozen=True)
class Groups:
    """M = 2 V - 1 groups; group 0 is the whole fleet, groups of one vehicle have no parts."""

    row: Rows  # (M,) the vehicle that stands for the group
    parts: Rows  # (M, 2); -1 where there are none

    @classmethod
    def of(cls, features: Array) -> tuple[Groups, list[Rows]]:
        """The groups of vehicles with features (V, D), divided where they differ most; and the members of each."""
        rows: list[int] = []
        every: list[Rows] = []
        parts: list[tuple[int, int]] = []
        waiting: list[tuple[Rows, int, int]] = [(np.arange(len(features)), -1, 0)]
        while waiting:
            members, parent, side = waiting.pop()
            number = len(rows)
            if parent >= 0:
                pair = parts[parent]
                parts[parent] = (number, pair[1]) if side == 0 else (pair[0], number)
            own = features[members]
            low, high = own.min(axis=0), own.max(axis=0)
            rows.append(int(members[np.abs(own - 0.5 * (low + high)).sum(axis=1).argmin()]))
            every.append(members)
            parts.append((-1, -1))
            if len(members) > 1:
                order = members[np.argsort(own[:, (high - low).argmax()], kind="stable")]
                half = len(order) // 2
                waiting += [(order[:half], number, 0), (order[half:], number, 1)]
        return cls(np.array(rows), np.array(parts)), every

    @property
    def leaves(self) -> Rows:
        """The groups (V,) of one vehicle."""
        return np.flatnonzero(self.parts[:, 0] < 0)

    def largest(self, values: Array) -> Array:
        """The largest value (M, ...) among the members of each group, of values (V, ...) of the vehicles."""
        found = np.array(values)[self.row]
        for groups in self._levels:
            found[groups] = found[self.parts[groups]].max(axis=1)
        return found

    @cached_property
    def _levels(self) -> list[Rows]:
        """Groups that have parts, the deepest first."""
        found, level = [], np.zeros(1, dtype=np.intp)
        while len(level := level[self.parts[level, 0] >= 0]):
            found.append(level)
            level = self.parts[level].ravel()
        return found[::-1]


@dataclass(frozen=True)
class VehicleTree(Groups):
    """Groups by the offsets at all times, and how far members are from the vehicle of their group."""

    reach: Array  # (M, K, 3) largest difference of its members' tables from that vehicle's
    reach_m: Array  # (M,) largest distance of a member from that vehicle, over the whole flight
    reach_ned_m: Array  # (M, 3) the same along each axis


def vehicle_tree(shape: Shape) -> VehicleTree:
    """The tree of a shape's vehicles, divided where their tables differ most."""
    size = np.abs(shape.functions(0.5 * (shape.joints_s[1:] + shape.joints_s[:-1]))).max(axis=0)  # (K,)
    size = np.maximum(size, np.abs(shape.functions(shape.joints_s)).max(axis=0))
    tables = np.moveaxis(shape.basis_ned_m, 1, 0)  # (V, K, 3)
    groups, members = Groups.of((tables * size[:, None]).reshape(len(tables), -1))
    reach = np.stack([np.abs(tables[m] - tables[row]).max(axis=0) for m, row in zip(members, groups.row, strict=True)])
    reach_ned_m = (reach * size[:, None]).sum(axis=1)
    return VehicleTree(groups.row, groups.parts, reach, np.linalg.norm(reach_ned_m, axis=1), reach_ned_m)


def enclosed_offsets(
    shape: Shape, tree: VehicleTree, who: Rows, start_s: Array, end_s: Array, order: int, derivative: int = 0
) -> Taylor:
    """Offsets (3, N) from the leader of all vehicles in the groups (N,), or their derivative, over intervals (N,)."""
    functions = enclosed(shape.functions, start_s, end_s, order, derivative)  # (K, N)
    return enclosed_table(functions, shape.basis_ned_m[:, tree.row[who]], tree.reach[who])


def enclosed_table(functions: Taylor, table: Array, reach: Array) -> Taylor:
    """Functions (K, N) times tables (K, N, 3), known to a reach (N, K, 3): vectors (3, N)."""
    c = np.einsum("okn,kna->oan", functions.c, table)
    remainder = np.einsum("kn,kna->an", functions.remainder, np.abs(table))
    if reach.any():
        remainder = remainder + np.einsum("kn,nka->an", functions.size(), reach)
    return Taylor(c, remainder)
