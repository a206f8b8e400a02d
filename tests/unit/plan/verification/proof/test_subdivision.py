"""Subdivision: of a made-up family the least margin is found and bounded, and what never gets tight is undecided."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from gcs.plan.verification.proof import subdivision as module
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Constraint, Mask, Rows, halved, prove
from gcs.plan.verification.proof.verdict import verdict_of
from gcs.types import Array

END_S = 8.0


@dataclass
class Wave:
    """Margins `floor` + 1 - cos(t - `at_s`) of three vehicles; the bound uses their Lipschitz constant 1."""

    floor: tuple[float, float, float] = (0.3, 0.1, 0.2)
    at_s: float = 2.7
    loose: float = 0.0  # how much the bound lies too low, however short the interval
    tolerance: float = 1e-3
    cells: int = field(default=0, init=False)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        return (Constraint(self.tolerance, 1e-3), Constraint(self.tolerance, 1e-3))

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        self.cells += len(cells)
        seen = np.array(self.floor)[cells.who[:, 0]] + 1.0 - np.cos(cells.middle_s - self.at_s)
        low = seen - 0.5 * (cells.end_s - cells.start_s) - self.loose
        far = np.where(cells.phase == 0, 50.0, np.inf)
        return np.stack([low, far]), np.stack([seen, far])

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        long = np.flatnonzero(chosen & (cells.end_s - cells.start_s > SHORTEST_S))
        return halved(cells[long]), np.concatenate([long, long])


def begin() -> Cells:
    """Three vehicles, two phases of 4 s."""
    who, start_s = (part.ravel() for part in np.meshgrid(np.arange(3), [0.0, 4.0], indexing="ij"))
    phase = (start_s > 0.0).astype(np.intp)
    return Cells(who[:, None].astype(np.intp), start_s, start_s + 4.0, phase, np.zeros((6, 0)))


def test_the_least_margin_is_found_with_vehicle_and_instant_and_bounded_from_below() -> None:
    family = Wave()
    proof = prove(family, begin(), 2)
    assert proof.proved[0, 0] <= 0.1 <= proof.seen[0, 0]
    assert proof.seen[0, 0] - proof.proved[0, 0] <= 3e-3
    assert proof.who[0, 0] == 1
    assert proof.t_s[0, 0] == pytest.approx(2.7, abs=0.1)
    assert family.cells < 2000  # it divides near the minimum only
    late = 1.1 - np.cos(END_S - 2.7)
    assert proof.proved[0, 1] <= late <= proof.seen[0, 1]
    assert proof.t_s[0, 1] == pytest.approx(END_S, abs=0.05)


def test_where_a_constraint_does_not_apply_nothing_is_known() -> None:
    proof = prove(Wave(), begin(), 2)
    assert (proof.proved[1, 0], proof.seen[1, 0]) == (50.0, 50.0)
    assert np.isinf([proof.proved[1, 1], proof.seen[1, 1]]).all()


def verdict(family: Wave) -> str:
    proof = prove(family, begin(), 2)
    proved = float(min(proof.proved[0, 0], proof.seen[0, 0]))
    return verdict_of(float(proof.seen[0, 0]), family.tolerance, proved)


@pytest.mark.parametrize(
    ("floor", "expected"), [(1e-4, "proved"), (-0.5e-3, "proved"), (-1.5e-3, "violated"), (-0.5, "violated")]
)
def test_close_to_the_tolerance_the_verdict_is_right(floor: float, expected: str) -> None:
    assert verdict(Wave((1.0, floor, 1.0))) == expected


def test_a_bound_that_never_gets_tight_is_undecided() -> None:
    assert verdict(Wave((1.0, 0.01, 1.0), loose=0.02)) == "undecided"
    assert verdict(Wave((1.0, 0.05, 1.0), loose=0.02)) == "proved"


def test_the_search_ends_at_its_most_cells_with_a_bound_that_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bound that is 10 too low divides all six cells again and again: 6 + 12 + ... + 768, then 1536 once more."""
    monkeypatch.setattr(module, "_CELLS_MAX", 2000)
    family = Wave(loose=10.0)
    proof = prove(family, begin(), 2)
    assert family.cells == 6 * (2**9 - 1)
    assert -10.0 < proof.proved[0, 0] < 0.1 - 9.9 + 0.01
    assert proof.seen[0, 0] == pytest.approx(0.1, abs=1e-3)


def test_what_is_no_number_is_not_proved() -> None:
    proof = prove(Wave((1.0, np.nan, 1.0)), begin(), 2)
    assert proof.proved[0, 0] == proof.seen[0, 0] == -np.inf
