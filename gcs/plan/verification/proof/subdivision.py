"""Bounds of constraints over cells (a group of vehicles during an interval), divided until each is settled.

A cell gives a lower bound of each margin, and the margin of one real vehicle at one instant. While the two differ by
more than the resolution near the least margin of all, the cell is divided. What is left is the least margin: no
vehicle has less at any instant than `proved`, and one has `seen` at `t_s`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.types import Array
from gcs.util.long_work import report, search_ends_s

Rows = NDArray[np.intp]
Mask = NDArray[np.bool_]

SHORTEST_S = 1e-3 / 16.0  # shorter intervals are not divided
_BATCH = 4096
_FAR = 1e9
_CELLS_MAX = 3_000_000


@dataclass(frozen=True)
class Constraint:
    """What is bounded: margins >= -tolerance are accepted."""

    tolerance: float
    resolution: float
    relative: float = field(default=0.02, kw_only=True)  # or to this share of the margin

    def gap(self, worst: Array) -> Array:
        """How far (...) a bound may be below the least margins (...) that were seen."""
        gap = np.maximum(self.resolution, self.relative * np.abs(worst))
        finest = min(self.resolution, self.tolerance) / 8.0
        # Near the tolerance the verdict itself decides how closely to look.
        near = np.minimum(gap, np.maximum(worst + self.tolerance, finest))
        return np.where(worst >= -self.tolerance, near, gap)


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


def plain_cells(who: Rows, start_s: Array, end_s: Array) -> Cells:
    """Cells of one phase, of which nothing but time and groups is divided."""
    return Cells(who, start_s, end_s, np.zeros(len(who), dtype=np.intp), np.zeros((len(who), 0)))


def joined(parts: list[Cells]) -> Cells:
    """All cells of several."""
    if len(parts) == 1:
        return parts[0]
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

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        ...

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """Lower bounds (C, N) of the margins over the cells, and margins (C, N) of a real vehicle in each.

        Infinite where a constraint does not apply.
        """
        ...

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """The parts of the chosen cells, and the number of the cell that each comes from; none of one without parts."""
        ...


@dataclass
class Proof:
    """What is known of C constraints in P phases; infinite where a constraint does not apply."""

    proved: Array  # (C, P): no vehicle has a smaller margin at any instant
    proved_at_s: Array  # (C, P): about when margins begin that are proved only so far
    seen: Array  # (C, P): the least margin that was found, and whose it is, and when
    who: Rows  # (C, P, w)
    t_s: Array  # (C, P)

    @classmethod
    def begun(cls, shape: tuple[int, int], width: int, seen: float = np.inf) -> Proof:
        """Nothing is proved yet of (C, P) margins; one that was `seen` is known to occur."""
        who = np.zeros((*shape, width), dtype=np.intp)
        return cls(np.full(shape, np.inf), np.zeros(shape), np.full(shape, seen), who, np.zeros(shape))

    def enough(self, constraints: tuple[Constraint, ...]) -> Array:
        """Bounds (C, P) that need not be better."""
        worst = np.minimum(self.seen, _FAR)  # infinite where a constraint does not apply
        return worst - np.stack([constraint.gap(row) for constraint, row in zip(constraints, worst, strict=True)])

    def keep(self, cells: Cells, low: Array) -> None:
        """Take bounds (C, N) of cells as final; infinite ones count for nothing."""
        for number, phase, column, value in _lower(self.proved, cells, low):
            self.proved[number, phase], self.proved_at_s[number, phase] = value, cells.middle_s[column]

    def note(self, cells: Cells, seen: Array) -> None:
        """Take margins (C, N) that occur in the middle of cells."""
        for number, phase, column, value in _lower(self.seen, cells, seen):
            self.seen[number, phase], self.who[number, phase] = value, cells.who[column]
            self.t_s[number, phase] = cells.middle_s[column]


def _lower(known: Array, cells: Cells, values: Array) -> Iterator[tuple[int, int, int, float]]:
    """Where values (C, N) are below known ones (C, P): constraint, phase, the cell with the least, and its value."""
    for phase in range(known.shape[1]):
        columns = np.flatnonzero(cells.phase == phase)
        if not len(columns):
            continue
        best = columns[values[:, columns].argmin(axis=1)]
        least = values[np.arange(len(values)), best]
        for number in np.flatnonzero(least < known[:, phase]).tolist():
            yield number, phase, int(best[number]), float(least[number])


@dataclass
class Looks:
    """How many cells may still be looked at, and until when, by time.monotonic."""

    left: int
    until_s: float = field(default_factory=search_ends_s)

    def last(self, count: int) -> bool:
        """Count further cells; whether the search ends with them, because its cells or its time are used up."""
        self.left -= count
        return self.left < 0 or time.monotonic() > self.until_s


def prove(family: Family, cells: Cells, phases: int) -> Proof:
    """The least margins of a family over cells of any number, phase by phase."""
    proof = Proof.begun((len(family.constraints), phases), cells.who.shape[1])
    settle(family, cells, proof, Looks(_CELLS_MAX))
    return proof


def settle(family: Family, cells: Cells, proof: Proof, looks: Looks) -> None:
    """Add to a proof what is known of more cells."""
    proof.keep(*refined(family, cells, proof, looks))


def refined(
    family: Family, cells: Cells, proof: Proof, looks: Looks, *, proved_is_enough: bool = False
) -> tuple[Cells, Array]:
    """Divide cells. Those that have no parts are left: they, and their bounds (C, M), which are not in the proof.

    With `proved_is_enough`, no cell is divided whose bound does not lower what is proved.
    """
    constraints = family.constraints
    level, unsettled = cells, np.ones((len(constraints), len(cells)), dtype=bool)
    left = [(cells[:0], np.zeros((len(constraints), 0)))]
    while len(level):
        last = looks.last(len(level))
        parts: list[tuple[Cells, Mask]] = []
        for first in range(0, len(level), _BATCH):
            report(f"proving every limit at every instant: {len(level)} intervals")
            last = last or looks.last(0)
            batch, wanted = level[first : first + _BATCH], unsettled[:, first : first + _BATCH]
            low, seen = (np.where(np.isnan(each), -np.inf, each) for each in family.bounds(batch))
            proof.note(batch, seen)
            enough = proof.enough(constraints)
            if proved_is_enough:
                enough = np.minimum(enough, proof.proved)
            is_open = np.asarray(wanted & (low < enough[:, batch.phase]) & (not last))
            proof.keep(batch, np.where(wanted & ~is_open, low, np.inf))
            stays: Mask = np.any(is_open, axis=0)
            if not stays.any():
                continue
            children, origin = family.children(batch, stays)
            parts.append((children, is_open[:, origin]))
            stays[origin] = False
            left.append((batch[stays], np.where(is_open, low, np.inf)[:, stays]))
        level = joined([part for part, _ in parts]) if parts else cells[:0]
        unsettled = np.concatenate([mask for _, mask in parts], axis=1) if parts else unsettled[:, :0]
    return joined([part for part, _ in left]), np.concatenate([low for _, low in left], axis=1)
