"""What was proved of tracks: a check for each criterion, and their report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.errors import VerificationError, counted
from gcs.mission.proving.track_criteria import TrackCriterion
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.verification.proof.subdivision import SHORTEST_S, Cells, Family, Looks, Proof, settle
from gcs.plan.verification.proof.verdict import OK, ProofVerdict, verdict_of

CELLS_MAX = 20_000_000
_LISTED = 5


@dataclass(frozen=True)
class TrackCheck:
    """One criterion: the nearest value to its limit that was found, `seen`, with its vehicles and instant.

    `proved` is a bound: no vehicle has a value beyond it at any instant. `seen` is infinite, without vehicles, where it
    was decided of no instant that was looked at whether the criterion applies.
    """

    name: str
    unit: str
    limit: float
    most: bool  # the limit is the largest value that is allowed; else the least
    seen: float
    proved: float
    tolerance: float
    vehicles: tuple[str, ...]
    t_s: float
    kind: Kind | None = None  # where code must know it; `name` is for people

    @property
    def verdict(self) -> ProofVerdict:
        """Proved, violated at `t_s`, or undecided at the finest resolution."""
        sign = -1.0 if self.most else 1.0
        return verdict_of(sign * (self.seen - self.limit), self.tolerance, sign * (self.proved - self.limit))

    @property
    def ok(self) -> bool:
        """Whether it is proved; undecided counts as failed."""
        return self.verdict in OK

    def __str__(self) -> str:
        who = f"vehicle{'s' if len(self.vehicles) > 1 else ''} {' and '.join(self.vehicles)}"
        against = f"{'at most' if self.most else 'at least'} {self.limit:.4g} {self.unit}"
        if self.verdict is ProofVerdict.PROVED:
            return f"{self.name}: {'≤' if self.most else '≥'} {self.proved:.4g} {self.unit} proved, {against} required"
        where = f"at t = {self.t_s:.3f} s ({who}), {against} required"
        if self.verdict is ProofVerdict.UNDECIDED:
            if not self.vehicles:
                return f"{self.name}: undecided, perhaps {self.proved:.4g} {self.unit}, {against} required"
            between = f"between {self.proved:.4g} and {self.seen:.4g} {self.unit}"
            finest = f"intervals of {SHORTEST_S * 1e6:g} µs, {CELLS_MAX:,} of them, or the time limit decide no more"
            return f"{self.name}: undecided, {between} {where}; {finest}"
        return f"{self.name}: {self.seen:.4g} {self.unit} {where}"


@dataclass(frozen=True)
class UnsafeSpan:
    """A span of instants at which it is not proved that a flight may be broken off; at all others it is.

    `vehicles`, breaking off at `t_s`, have the value `seen`: the nearest to the limit, or beyond it, of those that were
    looked at. The verdict is "undecided" where none is beyond it.
    """

    start_s: float
    end_s: float
    name: str
    verdict: ProofVerdict
    seen: float
    unit: str
    vehicles: tuple[str, ...]
    t_s: float

    def __str__(self) -> str:
        from_to = f"{self.start_s:.2f} s to {self.end_s:.2f} s: {self.name}"
        verdict = "" if self.verdict is ProofVerdict.VIOLATED else f" {self.verdict},"
        return (
            f"{from_to}{verdict} {self.seen:.4g} {self.unit} from t = {self.t_s:.3f} s ({' and '.join(self.vehicles)})"
        )


@dataclass(frozen=True)
class TrackReport:
    """All checks of tracks, and what was not checked because no limit was stated."""

    checks: tuple[TrackCheck, ...]
    unchecked: tuple[str, ...]
    vehicles: tuple[str, ...]
    t_start_s: float
    t_end_s: float
    unsafe: tuple[UnsafeSpan, ...] = ()  # of the instants of a breaking off

    @property
    def ok(self) -> bool:
        """Whether every check is proved."""
        return all(check.ok for check in self.checks)

    @property
    def failures(self) -> tuple[TrackCheck, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if not check.ok)

    def refusal(self) -> VerificationError | None:
        """The error for tracks that failed; None where all is proved."""
        if self.ok:
            return None
        worst = "; ".join(map(str, self.failures[:_LISTED]))
        return VerificationError(f"not proved: {worst}", hint="change the trajectories, or the limits")

    def __str__(self) -> str:
        verdict = "every instant proved" if self.ok else f"FAILED, {len(self.failures)} of {len(self.checks)} checks"
        span = f"{counted(len(self.vehicles), 'vehicle')}, {self.t_start_s:g} s to {self.t_end_s:g} s"
        return "\n  ".join([f"{span}: {verdict}", *map(str, self.checks), *map(str, self.unsafe)])

    __repr__ = __str__


def settled_checks(
    names: tuple[str, ...], family: Family, criteria: tuple[TrackCriterion, ...], cells: Cells, phases: int = 1
) -> list[TrackCheck]:
    """One check for each criterion, of its worst phase."""
    proof = Proof.begun((len(criteria), phases), cells.who.shape[1])
    settle(family, cells, proof, Looks(CELLS_MAX))
    found = []
    for number, criterion in enumerate(criteria):
        phase = int(proof.seen[number].argmin())
        seen, proved = float(proof.seen[number, phase]), float(proof.proved[number].min())
        if np.isposinf(seen) and np.isposinf(proved):
            continue  # it applies to nobody at any instant
        known = np.isfinite(seen)
        sign = -1.0 if criterion.most else 1.0
        found.append(
            TrackCheck(
                criterion.name,
                criterion.unit,
                criterion.limit,
                criterion.most,
                criterion.limit + sign * seen,
                criterion.limit + sign * min(proved, seen),
                family.constraints[number].tolerance,
                tuple(names[row] for row in proof.who[number, phase]) if known else (),
                float(proof.t_s[number, phase] if known else proof.proved_at_s[number].min()),
                criterion.kind,
            )
        )
    return found
