"""The proof of a plan from its polynomials alone: every phase, vehicle, pair and instant, over the exact ground.

Each constraint is bounded over intervals of time, which are divided until it is proved, violated at an instant, or
undecided at the finest resolution (counted as failed). It uses nothing of the transcription, the solver, the mesh or
the planner's own margins. `docs/verification.md` lists the checks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Protocol

import numpy as np

from gcs.plan.formation.followers import rounded_thrust_polynomial
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.allowed_shapes import AllowedShapes
from gcs.plan.verification.constraints.bent_formation import BentFormation
from gcs.plan.verification.constraints.equation_of_motion import reintegrated
from gcs.plan.verification.constraints.formation_checks import nearest_pair_m
from gcs.plan.verification.constraints.formation_law import FormationLaw, spans
from gcs.plan.verification.constraints.ground_clearance import GroundClearance
from gcs.plan.verification.constraints.pair_separation import PairSeparation
from gcs.plan.verification.constraints.position_limits import PositionLimits, enclosed_places
from gcs.plan.verification.constraints.scheduled_shape import stretches
from gcs.plan.verification.constraints.state_control_limits import StateControlLimits
from gcs.plan.verification.exact_checks import exact_checks
from gcs.plan.verification.proof.ground_patches import ground_patches
from gcs.plan.verification.proof.subdivision import Cells, Family, Rows, prove
from gcs.plan.verification.proof.vehicle_tree import VehicleTree, vehicle_tree
from gcs.plan.verification.proof.verdict import (
    LENGTH_TOLERANCE_M,
    OK,
    WINDOW_TOLERANCE_M,
    Check,
    NamedConstraint,
    NearestZone,
    ProofVerdict,
    Report,
    refusal,
    verdict_of,
)
from gcs.scenario.environment.no_fly import ZoneName, zone_changes_s, zones
from gcs.types import Array
from gcs.util.cache import once

__all__ = ["AIRBORNE", "LENGTH_TOLERANCE_M", "OK", "Check", "ProofVerdict", "Report", "refusal", "verdict_of", "verify"]

AIRBORNE = (PhaseKind.HOVER, PhaseKind.RUN_UP, PhaseKind.MISSION, PhaseKind.ARRIVAL_HOVER)
_LONGEST_S = 4.0  # of the first intervals
_FEW = 16  # up to so many vehicles, each is a group of its own from the beginning


@once
def verify(plan: Plan) -> Report:
    """The report on a plan: Eqs. 1, 14-25, 51-53 and separations, in every phase, for every vehicle."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # what has no bounds is not proved
        proofs = _Proofs(plan)
        checks = _merged([*proofs.motion(), *proofs.places(), *proofs.separation(), *proofs.formation()])
        clearance = min(_proved(checks, Kind.CLEARANCE))
        separations = _proved(checks, Kind.SEPARATION)
        window = _window_check(plan)
        exact, terminal_m = exact_checks(plan)
        checks += [window, *exact]
    limits = plan.scenario.limits
    return Report(
        tuple(checks),
        clearance + limits.clearance_min_m,
        min(separations) + limits.separation_min_m if separations else None,
        WINDOW_TOLERANCE_M - window.worst,
        terminal_m,
        _least_zone(plan, checks),
    )


def _proved(checks: list[Check], kind: Kind) -> list[float]:
    """The bounds of all constraints of one kind."""
    return [c.proved for c in checks if c.constraint.kind is kind and c.proved is not None]


def _least_zone(plan: Plan, checks: list[Check]) -> NearestZone | None:
    """The zone that a vehicle passes nearest, of all phases; None without zones."""
    found = [(c, c.constraint.of) for c in checks if isinstance(c.constraint.of, ZoneName)]
    if not found:
        return None
    least, name = min(found, key=lambda pair: pair[0].worst)
    distance_m = min(_proved(checks, Kind.ZONE)) + (plan.scenario.limits.zone_margin_m or 0.0)
    return NearestZone(name.number, least.sysid or 0, least.t_s or 0.0, distance_m, name.keep_in)


class _CheckedFamily(Family, Protocol):
    """A family whose margins a report names."""

    @property
    def constraints(self) -> tuple[NamedConstraint, ...]:
        """In the order of the margins."""
        ...

    def row(self, who: Rows) -> int:
        """The row of the one vehicle that groups stand for, or of their first vehicle."""
        ...


@dataclass(frozen=True)
class _Proofs:
    """The families of constraints of one plan, and the cells that each begins with."""

    plan: Plan

    def motion(self) -> list[Check]:
        """Limits of the leader alone, and of all vehicles where they move apart."""
        rounded = rounded_thrust_polynomial(self.plan.leader_trajectory.control).x
        apart = self._interval(rounded)
        moves = self.plan.shape.moves_apart(0.5 * (apart[0] + apart[1]), self.plan.quadrotor.wind)
        together = self._interval(np.empty(0))
        alone = ~self.plan.shape.moves_apart(0.5 * (together[0] + together[1]), self.plan.quadrotor.wind)
        found: list[Check] = []
        if alone.any():
            cells = self._cells(np.zeros(1, dtype=np.intp), together[0][alone], together[1][alone])
            found += self._checks(StateControlLimits(self.plan, None, self._number(PhaseKind.MISSION)), cells)
        if moves.any():
            cells = self._cells(self._groups, apart[0][moves], apart[1][moves])
            found += self._checks(StateControlLimits(self.plan, self._tree, self._number(PhaseKind.MISSION)), cells)
        return found

    def places(self) -> list[Check]:
        """Box, heights, no-fly zones, keep-in areas, and the distance to the ground."""
        scenario = self.plan.scenario
        cells = self._cells(self._groups, *self._interval(zone_changes_s(zones(scenario))))
        airborne = np.array([i for i, p in enumerate(self.plan.phases) if p.name in AIRBORNE], dtype=np.intp)
        ground = ground_patches(scenario.terrain)
        box = PositionLimits(self.plan, self._tree, airborne, self._number(PhaseKind.MISSION), ground, self._area_m())
        pads = np.zeros((len(self.plan.phases), len(self.plan.sysids)))
        for number, phase in enumerate(self.plan.phases):
            if phase.name not in AIRBORNE:
                takes_off = phase.name == PhaseKind.TAKEOFF
                points = self.plan.pads_ned_m if takes_off else self.plan.landing_points_ned_m
                pads[number] = points[:, 2]
        above = partial(enclosed_places, self.plan, self._tree)
        limit_m = scenario.limits.clearance_min_m
        clearance = GroundClearance(above, self._tree, scenario.terrain, limit_m, airborne, pads)
        return self._checks(box, cells) + self._checks(clearance, clearance.around(cells))

    def separation(self) -> list[Check]:
        """Rigid stretches once and exactly; all pairs where the shape moves."""
        plan = self.plan
        if len(plan.sysids) < 2:
            return []
        start_s, end_s = self._interval(np.empty(0))
        middle = 0.5 * (start_s + end_s)
        moving = plan.shape.is_moving(middle)
        checks = []
        phases = self._phase(middle)
        for phase in np.unique(phases[~moving]):
            stretch = middle[~moving & (phases == phase)]
            piece = np.searchsorted(plan.shape.joints_s, stretch, side="right")
            instants = stretch[np.unique(piece, return_index=True)[1]]
            apart, t_s = min((nearest_pair_m(plan.shape.at(float(t))), float(t)) for t in instants)
            margin = apart - plan.scenario.limits.separation_min_m
            name = plan.phases[phase].name
            separation = ConstraintId(Kind.SEPARATION)
            checks.append(Check(separation, name, "m", margin, LENGTH_TOLERANCE_M, None, t_s, proved=margin))
        if moving.any():
            cells = self._cells(np.zeros(1, dtype=np.intp), start_s[moving], end_s[moving])
            pairs = Cells(np.repeat(cells.who, 2, axis=1), cells.start_s, cells.end_s, cells.phase, cells.patch)
            checks += self._checks(PairSeparation(plan, self._tree), pairs)
        return checks

    def formation(self) -> list[Check]:
        """Places in the formation, and the law of every scheduled change."""
        allowed = AllowedShapes.of(self.plan.scenario)
        law: FormationLaw | BentFormation
        if allowed is None:
            law = FormationLaw(self.plan, spans(self.plan))
        else:
            law = BentFormation(self.plan, stretches(self.plan), allowed, self._number(PhaseKind.MISSION))
        ends = [t for part in law.parts for t in (part.start_s, part.end_s)]
        start_s, end_s = self._interval(np.array(ends))
        phase = self._phase(0.5 * (start_s + end_s))
        flies = np.isin(phase, [i for i, p in enumerate(self.plan.phases) if p.name in AIRBORNE])
        found = self._checks(law, law.cells(start_s[flies], end_s[flies], phase[flies]))
        return [replace(c, sysid=self.plan.sysids[law.farthest_row(c.constraint, c.t_s or 0.0)]) for c in found]

    @cached_property
    def _tree(self) -> VehicleTree:
        return vehicle_tree(self.plan.shape)

    @property
    def _groups(self) -> Rows:
        """The groups that cells begin with."""
        return self._tree.leaves if len(self.plan.sysids) <= _FEW else np.zeros(1, dtype=np.intp)

    def _number(self, name: PhaseKind) -> int:
        return [phase.name for phase in self.plan.phases].index(name)

    def _phase(self, t_s: Array) -> Rows:
        """The number of the phase (N,) at instants (N,)."""
        starts = [phase.start_s for phase in self.plan.phases]
        return np.clip(np.searchsorted(starts, t_s, side="right") - 1, 0, len(starts) - 1)

    def _interval(self, more_s: Array) -> tuple[Array, Array]:
        """Starts and ends (N,) of intervals that reach over no joint, no phase and no instant of `more_s`."""
        plan = self.plan
        edges = np.unique(np.concatenate([plan.joints_s, more_s, [p.start_s for p in plan.phases], [plan.t_end_s]]))
        edges = edges[(edges >= plan.t_start_s) & (edges <= plan.t_end_s)]
        parts = [np.linspace(a, b, int(np.ceil((b - a) / _LONGEST_S)), endpoint=False) for a, b in pairwise(edges)]
        every = np.concatenate([*parts, edges[-1:]])
        return every[:-1], every[1:]

    def _cells(self, groups: Rows, start_s: Array, end_s: Array) -> Cells:
        """Every group over every interval."""
        count = len(start_s)
        phase = self._phase(0.5 * (start_s + end_s))
        return Cells(
            np.repeat(groups, count)[:, None],
            np.tile(start_s, len(groups)),
            np.tile(end_s, len(groups)),
            np.tile(phase, len(groups)),
            np.zeros((count * len(groups), 0)),
        )

    def _area_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The box, and what lies between it and the pads: in the phases from and to the ground."""
        limits, plan = self.plan.scenario.limits, self.plan
        points = np.concatenate([plan.pads_ned_m, plan.landing_points_ned_m])
        north, east = (
            (min(low, float(points[:, axis].min())), max(high, float(points[:, axis].max())))
            for axis, (low, high) in enumerate((limits.north_m, limits.east_m))
        )
        return north, east

    def _checks(self, family: _CheckedFamily, cells: Cells) -> list[Check]:
        """The checks of a family, one for each constraint and phase."""
        proof = prove(family, cells, len(self.plan.phases))
        found = []
        for number, constraint in enumerate(family.constraints):
            for phase, name in enumerate(p.name for p in self.plan.phases):
                seen, proved = float(proof.seen[number, phase]), float(proof.proved[number, phase])
                if np.isposinf(seen) and np.isposinf(proved):
                    continue  # it does not apply in this phase
                row, t_s = family.row(proof.who[number, phase]), float(proof.t_s[number, phase])
                sysid = None if constraint.id.kind is Kind.SEPARATION else self.plan.sysids[row]
                found.append(
                    Check(
                        constraint.id, name, constraint.unit, seen, constraint.tolerance, sysid, t_s, min(proved, seen)
                    )
                )
        return found


def _merged(checks: list[Check]) -> list[Check]:
    """One check for each name and phase: the worse of the leader's and the followers', with the lower bound of both."""
    found: dict[tuple[ConstraintId, str], Check] = {}
    for check in checks:
        key = (check.constraint, check.phase)
        other = found.get(key)
        if other is None:
            found[key] = check
            continue
        worse = check if check.worst < other.worst else other
        assert check.proved is not None and other.proved is not None
        proved = min(check.proved, other.proved)
        found[key] = replace(worse, proved=proved)
    return list(found.values())


def _window_check(plan: Plan) -> Check:
    """Eq. 1 re-integrated; of a large fleet whose vehicles move apart, the outermost ones."""
    found = reintegrated(plan)
    margin = WINDOW_TOLERANCE_M - found.error_m
    drift, sysid = ConstraintId(Kind.DRIFT), plan.sysids[found.row]
    return Check(drift, "all", "m", margin, 0.0, sysid, found.start_s, margin if found.complete else None)
