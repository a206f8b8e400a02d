"""The separations of an export: of the plan, its missions and its returns, one row each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.spatial import KDTree

from gcs.autopilots.traits import Autopilot, titles
from gcs.mission.export.mission_files import MadeMissions
from gcs.mission.machine_independent import rounded_down
from gcs.mission.predicted.timing import knots_in_plan_time_s
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.mission.returns.rtl_cases import WorstReturn
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import LENGTH_TOLERANCE_M, Report
from gcs.scenario.values.navigation_error import judged_separation_m

PROVED_DECIMALS, SEEN_DECIMALS = 3, 2


@dataclass(frozen=True)
class Separation:
    """How near any two vehicles come in one part of an export, which two, and when: plan time, s.

    A `proved` distance is one that no two vehicles come below at any instant; others were seen, at close instants.
    """

    what: str
    distance_m: float
    proved: bool
    required_m: float
    sysids: tuple[int, int]
    t_s: float
    given: bool = True  # what comes too near is left out of the export, or not to be ordered

    @property
    def figure(self) -> str:
        """The distance in words; a proved one is rounded down."""
        if self.proved:
            return f"{max(rounded_down(self.distance_m, PROVED_DECIMALS), 0.0):.{PROVED_DECIMALS}f} m"
        return f"{self.distance_m:.{SEEN_DECIMALS}f} m"

    @property
    def kept(self) -> bool:
        """Whether the separation is at least the required one."""
        return self.distance_m >= self.required_m - LENGTH_TOLERANCE_M

    def data(self) -> dict[str, object]:
        """One row for index.json and `--json`."""
        return asdict(self) | {"kept": self.kept}


class GroundReturns(Separation):
    """The separation of returns by the ground station: they are in no file that could be left out."""


def least(rows: Sequence[Separation]) -> Separation | None:
    """The row with the least distance of all that an export has; None where nothing can come near."""
    return min((row for row in rows if row.given), key=lambda row: row.distance_m, default=None)


def separations(
    plan: Plan, report: Report, autopilots: Sequence[Autopilot], made: MadeMissions, returns: ReturnPlan
) -> tuple[Separation, ...]:
    """The rows of an export; none for a single vehicle."""
    if len(plan.sysids) < 2:
        return ()
    return (*_of_plan(plan, report), *_of_missions(plan, autopilots, made), *_of_returns(plan, returns))


def _of_plan(plan: Plan, report: Report) -> Iterator[Separation]:
    checks = [check for check in report.checks if check.constraint.kind is Kind.SEPARATION and check.t_s is not None]
    if not checks or report.separation_min_m is None:
        return
    t_s = min(checks, key=lambda check: check.worst).t_s
    assert t_s is not None
    places = plan.offsets(np.array([t_s]))[:, 0]
    distance, near = KDTree(places).query(places, k=2)
    row = int(np.argmin(distance[:, 1]))
    other = next(each for each in near[row].tolist() if each != row)
    sysids = plan.sysids[min(row, other)], plan.sysids[max(row, other)]
    yield Separation("plan", report.separation_min_m, True, plan.scenario.limits.separation_min_m, sysids, t_s)


def _of_missions(plan: Plan, autopilots: Sequence[Autopilot], made: MadeMissions) -> Iterator[Separation]:
    required_m, given = judged_separation_m(plan.scenario), made.refusal is None
    closest = None if made.report is None else made.report.closest
    if made.report is not None and closest is not None:
        how = "at the plan's speeds" if made.timing is None else f"model of {titles(autopilots)}"
        first, second = sorted(closest.pair)
        flight, mission = made.report.flights[first], made.missions[first]
        t_s = closest.t_s + float(knots_in_plan_time_s(mission, flight)[0] - flight.t_s[0])
        proved = closest.proved_m > 0.0
        distance_m = closest.proved_m if proved else closest.distance_m
        sysids = plan.sysids[first], plan.sysids[second]
        yield Separation(f"missions, {how}", distance_m, proved, required_m, sysids, t_s, given)
    near = None if made.timing is None else made.timing.nearest
    if near is not None:
        what = f"their legs, one {near.apart_s:.3g} s off"
        yield Separation(what, near.distance_m, False, required_m, near.sysids, near.t_s, given)


def _of_returns(plan: Plan, returns: ReturnPlan) -> Iterator[Separation]:
    required_m = judged_separation_m(plan.scenario)

    def row(what: str, worst: WorstReturn, *, given: bool, part: type[Separation] = Separation) -> Separation:
        proved = worst.proved_m is not None
        distance_m = worst.distance_m if worst.proved_m is None else worst.proved_m
        return part(what, distance_m, proved, required_m, worst.sysids, worst.t_s, given)

    if returns.worst is not None:
        yield row("RTL of all at once", returns.worst, given=returns.separated)
    if returns.routed is not None:
        kept = returns.routed.distance_m >= required_m
        yield row("returns by the ground station", returns.routed, given=kept, part=GroundReturns)
