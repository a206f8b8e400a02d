"""Bound constraints over cells (a group of vehicles during an interval of time), subdividing until each is settled.

A cell gives a lower bound of each margin, and the margin of one real vehicle at one instant. While the two differ by
more than the resolution near the least margin of all, the cell is divided. What is left is the least margin: no
vehicle has less at any instant than `proved`, and one has `seen` at `t_s`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import Array

Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]

SHORTEST_S = 1e-3 / 16.0  # shorter intervals are not divided
_RELATIVE = 0.02  # a margin is bounded to this share of itself, or to the resolution
_BATCH = 4096
_FAR = 1e9
_CELLS_MAX = 3_000_000


@dataclass(frozen=True)
class Constraint:
    """What is bounded: margins >= -tolerance are accepted."""

    name: str
    unit: str
    tolerance: float
    resolution: float


@dataclass(frozen=True, eq=False)
class Cells:
    """N cells: the group or the groups (N, w) of vehicles, the interval of time, and the phase of the flight."""

    who: Rows  # (N, w)
    start_s: Array  # (N,)
    end_s: Array  # (N,)
    phase: Rows  # (N,)
    patch: Array  # (N, w) what else a family divides: a patch of the ground; (N, 0) of most

    def __len__(self) -> int:
        return len(self.start_s)

    def __getitem__(self, index: Rows | Mask | slice) -> Cells:
        return Cells(self.who[index], self.start_s[index], self.end_s[index], self.phase[index], self.patch[index])

    @property
    def middle_s(self) -> Array:
        """The instants (N,) in the middle."""
        return 0.5 * (self.start_s + self.end_s)


def joined(parts: list[Cells]) -> Cells:
    """All cells of several."""
    return Cells(
        np.concatenate([p.who for p in parts]),
        np.concatenate([p.start_s for p in parts]),
        np.concatenate([p.end_s for p in parts]),
        np.concatenate([p.phase for p in parts]),
        np.concatenate([p.patch for p in parts]),
    )


def halved(cells: Cells) -> Cells:
    """Both halves of each cell's time: 2 N cells, the first halves first."""
    middle = cells.middle_s
    return joined([replace(cells, end_s=middle), replace(cells, start_s=middle)])


class Family(Protocol):
    """Constraints that are bounded together, because they share what they are computed from."""

    constraints: tuple[Constraint, ...]

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """Lower bounds (C, N) of the margins over the cells, and margins (C, N) of a real vehicle in each.

        Infinite where a constraint does not apply.
        """
        ...

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """The parts of the chosen cells, and the number of the cell that each comes from; none of one without parts."""
        ...

    def row(self, who: Rows) -> int:
        """The row of the vehicle whose margin stands for a cell's."""
        ...


@dataclass
class Proof:
    """What is known of C constraints in P phases; infinite where a constraint does not apply."""

    proved: Array  # (C, P): no vehicle has a smaller margin at any instant
    seen: Array  # (C, P): the least margin that was found, and of which vehicle it is, and when
    row: Rows  # (C, P)
    t_s: Array  # (C, P)


def prove(family: Family, cells: Cells, phases: int) -> Proof:
    """The least margins of a family over cells of any number, phase by phase."""
    count = len(family.constraints)
    shape = (count, phases)
    proof = Proof(np.full(shape, np.inf), np.full(shape, np.inf), np.zeros(shape, dtype=np.intp), np.zeros(shape))
    tolerance = np.array([c.tolerance for c in family.constraints])[:, None]
    resolution = np.array([c.resolution for c in family.constraints])[:, None]
    finest = np.minimum(resolution, tolerance) / 8.0
    level, unsettled = cells, np.ones((count, len(cells)), dtype=bool)
    done = 0
    while len(level):
        parts: list[Cells] = []
        masks: list[Mask] = []
        for first in range(0, len(level), _BATCH):
            batch, wanted = level[first : first + _BATCH], unsettled[:, first : first + _BATCH]
            low, seen = family.bounds(batch)
            low = np.where(np.isnan(low), -np.inf, low)
            _note(proof, family, batch, seen)
            worst = np.minimum(proof.seen[:, batch.phase], _FAR)  # infinite where a constraint does not apply
            gap = np.maximum(resolution, _RELATIVE * np.abs(worst))
            # Near the tolerance the verdict itself decides how closely to look.
            gap = np.where(worst >= -tolerance, np.minimum(gap, np.maximum(worst + tolerance, finest)), gap)
            is_open = wanted & (low < worst - gap)
            divided = is_open.any(axis=0)
            children, origin = family.children(batch, divided) if divided.any() else (batch[:0], np.zeros(0, np.intp))
            has_children = np.zeros(len(batch), dtype=bool)
            has_children[origin] = True
            settled = wanted & ~(is_open & has_children)
            _lower(proof, batch, np.where(settled, low, np.inf))
            if len(children):
                parts.append(children)
                masks.append(is_open[:, origin])
        done += len(level)
        if not parts:
            break
        level, unsettled = joined(parts), np.concatenate(masks, axis=1)
        if done + len(level) > _CELLS_MAX:
            low, seen = _in_batches(family, level)
            _note(proof, family, level, seen)
            _lower(proof, level, np.where(unsettled, low, np.inf))
            break
    return proof


def _in_batches(family: Family, cells: Cells) -> tuple[Array, Array]:
    found = [family.bounds(cells[first : first + _BATCH]) for first in range(0, len(cells), _BATCH)]
    low = np.concatenate([f[0] for f in found], axis=1)
    return np.where(np.isnan(low), -np.inf, low), np.concatenate([f[1] for f in found], axis=1)


def _lower(proof: Proof, cells: Cells, low: Array) -> None:
    for phase in np.unique(cells.phase):
        proof.proved[:, phase] = np.minimum(proof.proved[:, phase], low[:, cells.phase == phase].min(axis=1))


def _note(proof: Proof, family: Family, cells: Cells, seen: Array) -> None:
    """Keep the least margins found, with vehicle and time."""
    middle_s = cells.middle_s
    for phase in np.unique(cells.phase):
        columns = np.flatnonzero(cells.phase == phase)
        values = np.where(np.isnan(seen[:, columns]), -np.inf, seen[:, columns])
        best = values.argmin(axis=1)
        for number in np.flatnonzero(values.min(axis=1) < proof.seen[:, phase]):
            column = columns[best[number]]
            proof.seen[number, phase] = values[number, best[number]]
            proof.row[number, phase] = family.row(cells.who[column])
            proof.t_s[number, phase] = middle_s[column]
