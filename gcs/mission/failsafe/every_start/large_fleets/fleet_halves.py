"""A tree of vehicles: near ones share a node, so that far groups are excluded together.

Nodes are numbered as in a heap: the root is 1, and n has the children 2n and 2n + 1. A leaf has one vehicle or none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs.mission.failsafe.every_start.start_cells import Rows
from gcs.physics.quadrotor import Array


@dataclass(frozen=True)
class FleetHalves:
    """The vehicle of each leaf, and the leaf's node; `leaves` is a power of two."""

    leaves: int
    vehicles: Rows  # (V,) in the order of leaves
    slots: Rows  # (V,) their leaves, from 0

    @classmethod
    def of(cls, places: Array) -> FleetHalves:
        """The tree of places (V, D): each node is cut across its widest axis, in two equal halves."""
        leaves = 1 << int(np.ceil(np.log2(max(len(places), 1))))
        slots = np.zeros(len(places), dtype=np.intp)
        left = [(np.arange(len(places)), 0, leaves)]
        while left:
            rows, slot, width = left.pop()
            if len(rows) <= 1:
                slots[rows] = slot
                continue
            axis = int(np.argmax(np.ptp(places[rows], axis=0)))
            rows = rows[np.argsort(places[rows, axis], kind="stable")]
            half = (len(rows) + 1) // 2
            left += [(rows[:half], slot, width // 2), (rows[half:], slot + width // 2, width // 2)]
        vehicles = np.argsort(slots)
        return cls(leaves, vehicles, slots[vehicles])

    def vehicle(self, nodes: Rows) -> Rows:
        """The vehicles of leaves (M,)."""
        at = np.searchsorted(self.slots, nodes - self.leaves)
        return np.asarray(self.vehicles[np.minimum(at, len(self.vehicles) - 1)])

    def is_leaf(self, nodes: Rows) -> NDArray[np.bool_]:
        """Which nodes (M,) are leaves."""
        return np.asarray(nodes >= self.leaves)

    def is_empty(self, nodes: Rows) -> NDArray[np.bool_]:
        """Which nodes (M,) have no vehicle."""
        return np.asarray(self._counts[nodes] == 0)

    @cached_property
    def _counts(self) -> Rows:
        found = np.zeros(2 * self.leaves, dtype=np.intp)
        found[self.leaves + self.slots] = 1
        for node in range(self.leaves - 1, 0, -1):
            found[node] = found[2 * node] + found[2 * node + 1]
        return found

    def boxes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Corners (2 * leaves, ..., D) of the boxes of all nodes, from those of vehicles (V, ..., D).

        Empty nodes have infinite corners, the low one above the high one.
        """
        shape = (2 * self.leaves, *low.shape[1:])
        lows, highs = np.full(shape, np.inf), np.full(shape, -np.inf)
        lows[self.leaves + self.slots], highs[self.leaves + self.slots] = low[self.vehicles], high[self.vehicles]
        width = self.leaves
        while width > 1:
            half = width // 2
            pairs = (half, 2, *low.shape[1:])
            lows[half:width] = lows[width : 2 * width].reshape(pairs).min(axis=1)
            highs[half:width] = highs[width : 2 * width].reshape(pairs).max(axis=1)
            width = half
        return lows, highs
