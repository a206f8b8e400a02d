"""The scheduled shape at every instant, laid out anew from the scenario: what automatic changes and the course bend.

Rigid between changes. During a change all vehicles follow the smooth step of its leg.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import Infeasible
from gcs.plan.formation.coordinates import budget_of_each
from gcs.plan.formation.reshape import reshape
from gcs.plan.formation.time_scaling import least_duration, smooth_step
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.formation_checks import expected_places
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.taylor import Taylor, constant
from gcs.scenario.schema.scenario import ChangeTable
from gcs.scenario.values.si import NED_FROM_UP
from gcs.types import Array


@dataclass(frozen=True)
class Stretch:
    """A part of the flight over which the scheduled shape is a few functions of time times fixed tables."""

    start_s: float
    end_s: float
    law: Literal["rigid", "rotate", "in step"]
    tables_ned_m: Array  # (K, V, 3): the places; along, across and ahead of the axis; or before and after
    angle_rad: float = 0.0  # of a rotation

    @property
    def widest_m(self) -> float:
        """No vehicle is farther from the leader: each function is at most one."""
        return float(np.linalg.norm(self.tables_ned_m, axis=2).max(axis=1).sum())

    def functions(self, start_s: Array, end_s: Array, order: int) -> list[Taylor]:
        """The K functions over intervals (N,) within the stretch."""
        one = constant(np.ones(len(start_s)), order)
        if self.law == "rigid":
            return [one]
        step, length_s = smooth_step().c, self.end_s - self.start_s
        powers = length_s ** np.arange(len(step) - 1, -1, -1)
        timed = PPoly((step / powers[:, None])[..., None], np.array([self.start_s, self.end_s]))
        share = enclosed(timed, start_s, end_s, order)[0]
        if self.law == "in step":
            return [1.0 - share, share]
        angle = share * self.angle_rad
        return [one, angle.cos(), angle.sin()]


def stretches(plan: Plan) -> list[Stretch]:
    """The parts of the flight in order; those of no length are left out."""
    changes = [change for change in plan.scenario.formation.change if not change.auto]
    places = expected_places(plan)
    found = [Stretch(*places[0][:2], "rigid", places[0][2][None])]
    for change, move, (_, _, before), (start_s, end_s, after) in zip(
        changes, plan.scheduled_moves, places[:-1], places[1:], strict=False
    ):
        if change.kind == "rotate":
            found.append(_rotation(change, move.start_s, move.end_s, before))
        else:
            stops, ends = legs_of(plan, change, before, after)
            edges = move.start_s + (move.end_s - move.start_s) * ends
            for (low, high), (a, b) in zip(pairwise(edges.tolist()), pairwise(stops), strict=True):
                found.append(Stretch(low, high, "in step", np.stack([a, b])))
        found.append(Stretch(start_s, end_s, "rigid", after[None]))
    return [stretch for stretch in found if stretch.end_s > stretch.start_s]


def _rotation(change: ChangeTable, start_s: float, end_s: float, before: Array) -> Stretch:
    """About an axis through the leader: what lies along it stays."""
    assert change.angle_deg is not None
    axis = np.array([0.0, 0.0, 1.0]) if change.axis is None else np.array(change.axis) * NED_FROM_UP
    axis = axis / np.linalg.norm(axis)
    along = (before @ axis)[:, None] * axis
    tables = np.stack([along, before - along, np.cross(axis, before)])
    return Stretch(start_s, end_s, "rotate", tables, float(np.radians(change.angle_deg)))


def legs_of(plan: Plan, change: ChangeTable, before: Array, after: Array) -> tuple[list[Array], Array]:
    """Where the legs of a shrink or a reshape begin and end: shapes (V, 3), and shares (L+1,) of its duration."""
    scenario = plan.scenario
    if change.kind == "shrink":
        return [before, after], np.array([0.0, 1.0])
    try:
        made = reshape(before, after, plan.leader, scenario.limits.separation_min_m, fixed=True)
    except Infeasible:
        return [before, after], np.array([0.0, 1.0])
    timed = [(leg.basis_ned_m, least_duration(leg, budget_of_each(scenario))[0]) for leg in made.legs]
    timed = [(tables, seconds) for tables, seconds in timed if seconds > 0.0]
    if not timed:
        return [before, after], np.array([0.0, 1.0])
    ends = np.cumsum([0.0, *(seconds for _, seconds in timed)])
    return [before, *(tables[1] for tables, _ in timed)], ends / ends[-1]
