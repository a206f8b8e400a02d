"""Groups of vehicles as a binary tree: each with one vehicle that stands for it, and how far the others are from it.

Vehicles of a group have nearly the same offsets, so one bound can hold for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Array
from gcs.plan.formation.shape import Rows, Shape
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.taylor import Taylor


@dataclass(frozen=True)
class VehicleTree:
    """M = 2 V - 1 groups; group 0 is the whole fleet, groups of one vehicle have no parts."""

    row: Rows  # (M,) the vehicle that stands for the group
    reach: Array  # (M, K, 3) largest difference of its members' tables from that vehicle's
    parts: Rows  # (M, 2); -1 where there are none
    reach_m: Array  # (M,) largest distance of a member from that vehicle, over the whole flight
    reach_ned_m: Array  # (M, 3) the same along each axis

    @property
    def leaves(self) -> Rows:
        """The groups (V,) of one vehicle."""
        return np.flatnonzero(self.parts[:, 0] < 0)

    def largest(self, values: Array) -> Array:
        """The largest value (M,) among the members of each group, of values (V,) of the vehicles."""
        found = np.array(values)[self.row]
        for group in reversed(range(len(self.row))):  # a group's parts come after it
            if self.parts[group, 0] >= 0:
                found[group] = found[self.parts[group]].max()
        return found


def vehicle_tree(shape: Shape) -> VehicleTree:
    """The tree of a shape's vehicles, divided where their tables differ most."""
    size = np.abs(shape.functions(0.5 * (shape.joints_s[1:] + shape.joints_s[:-1]))).max(axis=0)  # (K,)
    size = np.maximum(size, np.abs(shape.functions(shape.joints_s)).max(axis=0))
    tables = np.moveaxis(shape.basis_ned_m, 1, 0)  # (V, K, 3)
    features = (tables * size[:, None]).reshape(len(tables), -1)
    rows: list[int] = []
    reach: list[Array] = []
    parts: list[tuple[int, int]] = []
    waiting: list[tuple[Rows, int, int]] = [(np.arange(len(tables)), -1, 0)]
    while waiting:
        members, parent, side = waiting.pop()
        number = len(rows)
        if parent >= 0:
            pair = parts[parent]
            parts[parent] = (number, pair[1]) if side == 0 else (pair[0], number)
        own = features[members]
        low, high = own.min(axis=0), own.max(axis=0)
        first = members[np.abs(own - 0.5 * (low + high)).sum(axis=1).argmin()]
        rows.append(int(first))
        reach.append(np.abs(tables[members] - tables[first]).max(axis=0))
        parts.append((-1, -1))
        if len(members) > 1:
            order = members[np.argsort(own[:, (high - low).argmax()], kind="stable")]
            half = len(order) // 2
            waiting += [(order[:half], number, 0), (order[half:], number, 1)]
    all_reach = np.stack(reach)
    reach_ned_m = (all_reach * size[:, None]).sum(axis=1)
    return VehicleTree(
        np.array(rows), all_reach, np.array(parts), np.asarray(np.linalg.norm(reach_ned_m, axis=1)), reach_ned_m
    )


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
