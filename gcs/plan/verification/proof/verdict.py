"""The verdict on one criterion, and on a plan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import VerificationError
from gcs.plan.trajectory.constraint_id import ConstraintId
from gcs.plan.verification.proof.subdivision import Constraint
from gcs.scenario.environment.no_fly import ZoneName

LENGTH_TOLERANCE_M = 0.8e-3  # every length; exact places at ends and joints too
SPEED_TOLERANCE_MPS = 1e-3  # at ends and route points
ANGLE_TOLERANCE_DEG = 0.01
LIMIT_TOLERANCE = 1e-3  # share of the limit
WINDOW_TOLERANCE_M = 10e-3
_LISTED = 5  # failures in an error


class ProofVerdict(StrEnum):
    """What is known of one criterion."""

    PROVED = "proved"
    VIOLATED = "violated"
    UNDECIDED = "undecided"
    SAMPLED = "sampled"


OK = (ProofVerdict.PROVED, ProofVerdict.SAMPLED)  # undecided counts as failed


def verdict_of(worst: float, tolerance: float, proved: float | None) -> ProofVerdict:
    """The verdict on the least margin that was found, and the bound of all margins."""
    if not worst >= -tolerance:
        return ProofVerdict.VIOLATED
    if proved is None:
        return ProofVerdict.SAMPLED
    return ProofVerdict.PROVED if proved >= -tolerance else ProofVerdict.UNDECIDED


@dataclass(frozen=True)
class NamedConstraint(Constraint):
    """A constraint that a report names."""

    id: ConstraintId
    unit: str


@dataclass(frozen=True)
class Check:
    """One criterion in one phase: the least margin that was found, `worst`, with vehicle and time (negative: violated).

    `proved` is a bound: no vehicle has a smaller margin at any instant. A criterion that is only sampled has none.
    """

    constraint: ConstraintId
    phase: str
    unit: str
    worst: float
    tolerance: float
    sysid: int | None
    t_s: float | None
    proved: float | None = None

    @property
    def name(self) -> str:
        """The constraint, for people."""
        return str(self.constraint)

    @property
    def verdict(self) -> ProofVerdict:
        """Proved, violated at `t_s`, undecided at the finest resolution, or sampled only."""
        return verdict_of(self.worst, self.tolerance, self.proved)

    @property
    def ok(self) -> bool:
        """Whether it is proved, or was only sampled and no sample violates it; undecided counts as failed."""
        return self.verdict in OK

    def __str__(self) -> str:
        vehicle = "" if self.sysid is None else f" (vehicle {self.sysid})"
        when = "" if self.t_s is None else f" at t = {self.t_s:.2f} s"
        if self.verdict is ProofVerdict.UNDECIDED:
            assert self.proved is not None
            between = f"margin between {self.proved:.3g} and {self.worst:.3g} {self.unit}"
            return f"{self.name}, {self.phase}: undecided, {between}{when}{vehicle}"
        verdict = "margin" if self.worst >= 0 else "violated by"
        return f"{self.name}, {self.phase}: {verdict} {abs(self.worst):.3g} {self.unit}{when}{vehicle}"


@dataclass(frozen=True)
class NearestZone:
    """The zone that a vehicle passes nearest, and when; no vehicle is nearer to any zone than `distance_m`.

    A zone is a no-fly zone or what is outside a keep-in area; each kind has numbers of its own.
    """

    number: int
    sysid: int
    t_s: float
    distance_m: float
    keep_in: bool = False

    @property
    def name(self) -> ZoneName:
        """The name of the zone."""
        return ZoneName(self.number, self.keep_in)


@dataclass(frozen=True)
class Report:
    """All checks of a plan, and its key figures: bounds, not samples."""

    checks: tuple[Check, ...]
    clearance_min_m: float
    separation_min_m: float | None  # of one vehicle there is none
    window_error_max_m: float
    terminal_error_m: float
    nearest_zone: NearestZone | None = None  # None without zones

    @property
    def ok(self) -> bool:
        """Whether the plan is verified: all checks passed."""
        return all(c.ok for c in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(c for c in self.checks if not c.ok)

    @property
    def sampled(self) -> tuple[str, ...]:
        """The names of criteria that are not proved between samples."""
        return tuple(dict.fromkeys(c.name for c in self.checks if c.verdict is ProofVerdict.SAMPLED))

    def __str__(self) -> str:
        failed, total = len(self.failures), len(self.checks)
        verdict = f"all {total} checks passed" if self.ok else f"FAILED, {failed} of {total} checks did not pass"
        apart = "" if self.separation_min_m is None else f", vehicles at least {self.separation_min_m:.3f} m apart"
        if self.failures:
            more = f"; and {failed - 1} more" if failed > 1 else ""
            last = f"{min(self.failures, key=lambda check: check.worst)}{more}"
        else:
            proved = f"sampled: {', '.join(self.sampled)}" if self.sampled else "every instant proved"
            last = f"integrated again: within {self.window_error_max_m:.4f} m; {proved}"
        return f"verification: {verdict}\n  at least {self.clearance_min_m:.3f} m from the ground{apart}\n  {last}"

    __repr__ = __str__


def refusal(report: Report) -> VerificationError:
    """The error for a plan that failed verification, with its worst checks."""
    worst = "; ".join(str(c) for c in report.failures[:_LISTED])
    worst += f"; and {len(report.failures) - _LISTED} more" if len(report.failures) > _LISTED else ""
    return VerificationError(
        f"the plan failed verification: {worst}",
        reason=worst,
        hint="change the scenario and plan again, or add --unverified to use the plan for inspection",
    )
