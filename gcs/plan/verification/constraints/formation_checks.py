"""Checks the formation of a plan against its scenario: places of all vehicles, separations, times of changes.

The result of each change is computed anew from the scenario, not taken from the planner.
"""

import numpy as np
from scipy.interpolate import PPoly
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist, pdist
from scipy.spatial.transform import Rotation

from gcs.errors import Infeasible
from gcs.plan.formation.assignment import bottleneck
from gcs.plan.formation.reshape import reshape
from gcs.plan.formation.separation import least_distance
from gcs.plan.formation.shape import Rows
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.allowed_shapes import AllowedShapes
from gcs.scenario.schema.scenario import ChangeTable
from gcs.scenario.values.si import NED_FROM_UP, landing_points_ned_m, offsets_ned_m, shape_offsets_ned_m
from gcs.types import Array

_LONGER = 1.0 + 1e-6  # ways that differ by rounding are equally long
_SLACK = 1e-3  # share of a gate's width, as for every limit
_FEW = 40  # up to so many vehicles, all distances are faster than a k-d tree


def expected_places(plan: Plan) -> list[tuple[float, float, Array]]:
    """Start, end and offsets (V, 3) of every part of the flight over which the schedule requires a rigid shape."""
    scenario = plan.scenario
    changes = [change for change in scenario.formation.change if not change.auto]
    places = offsets_ned_m(scenario)
    found, since = [], -np.inf
    for change, move in zip(changes, plan.scheduled_moves, strict=False):  # the number of moves is a check of its own
        found.append((since, move.start_s, places))
        if change.kind == "rotate":
            assert change.angle_deg is not None
            axis = np.array([0.0, 0.0, 1.0] if change.axis is None else change.axis * NED_FROM_UP)
            turn = Rotation.from_rotvec(np.radians(change.angle_deg) * axis / np.linalg.norm(axis))
            places = turn.apply(places)
        elif change.kind == "shrink":
            assert change.scale is not None
            places = change.scale * places
        else:
            assert change.to is not None
            targets = shape_offsets_ned_m(scenario, change.to)
            places = targets[_taken(plan, change, places, targets, move.end_s)]
        since = move.end_s
    found.append((since, np.inf, places))
    return found


def landing_points(plan: Plan) -> Array:
    """Ground points (V, 3) under the final shape of the scenario's formation."""
    if plan.scenario.formation.frame == "course" or (plan.begin_state is not None and bends(plan)):
        return plan.landing_points_ned_m  # the scenario does not fix its final heading, or the size of one that stops
    return landing_points_ned_m(plan.scenario, expected_places(plan)[-1][2])


def late_s(plan: Plan) -> list[tuple[float, float]]:
    """Lateness of each scheduled change, and the instant at which it should begin, s."""
    mission = plan.phase(PhaseKind.MISSION)
    changes = [change for change in plan.scenario.formation.change if not change.auto]
    found = [(np.inf, mission.end_s)] * abs(len(changes) - len(plan.scheduled_moves))
    for change, move in zip(changes, plan.scheduled_moves, strict=False):
        if began_before(plan, move.start_s):
            continue
        required = _required_s(plan, change, move.end_s - move.start_s)
        begun = plan.shape.joints_s[np.abs(plan.shape.joints_s - move.start_s).argmin()]
        found.append(
            (np.inf, move.start_s) if required is None else (float(np.ptp([move.start_s, begun, required])), required)
        )
    return found


def began_before(plan: Plan, start_s: float) -> bool:
    """Whether a change began before a plan that begins in the air."""
    return plan.begin_state is not None and start_s < plan.t_start_s


def _required_s(plan: Plan, change: ChangeTable, duration_s: float) -> float | None:
    """When a scheduled change should begin; None if its gate is not crossed, or its route point not passed."""
    if change.gate_m is not None:
        return crossing_s(plan, change.gate_m)
    if change.at_point is not None:
        return next((each.arrives_s for each in plan.passages if each.number == change.at_point), None)
    return change.begin_s(duration_s)


def crossing_s(plan: Plan, gate_m: tuple[tuple[float, float], tuple[float, float]]) -> float | None:
    """The instant of the mission at which the leader first crosses a gate (two points north, east), or None.

    The leader's side of the gate's line is a polynomial of time: its roots are the crossings.
    """
    mission, state = plan.phase(PhaseKind.MISSION), plan.leader_trajectory.state
    a, b = np.array(gate_m)
    along = b - a
    side = along[0] * (state.c[:, :, 1]) - along[1] * state.c[:, :, 0]
    side[-1] -= along[0] * a[1] - along[1] * a[0]
    roots = np.sort(PPoly(side, state.x).roots(extrapolate=False))
    roots = roots[np.isfinite(roots) & (roots >= mission.start_s) & (roots <= mission.end_s)]
    where = (state(roots)[:, :2] - a) @ along / (along @ along)
    hits = roots[(where >= -_SLACK) & (where <= 1.0 + _SLACK)]
    return float(hits[0]) if len(hits) else None


def bends(plan: Plan) -> bool:
    """Whether automatic changes or the course may bend the scheduled shape."""
    return AllowedShapes.of(plan.scenario) is not None


def assignments_m(plan: Plan) -> list[tuple[float, float]]:
    """For each scheduled change with a free assignment: how much longer its longest way is than need be (Eq. 14), and
    when it begins.

    Longer ways are needed where vehicles on the shortest ones would come too near to each other.
    """
    changes = [change for change in plan.scenario.formation.change if not change.auto]
    found = []
    for change, move in zip(changes, plan.scheduled_moves, strict=False):
        if change.kind != "reshape" or change.assignment == "fixed" or bends(plan):
            continue
        if began_before(plan, move.start_s):
            continue
        before, after = plan.shape.at(move.start_s), plan.shape.at(move.end_s)
        ways = cdist(before, after)
        others = np.arange(len(ways)) != plan.leader
        ways[plan.leader, others], ways[others, plan.leader] = np.inf, np.inf
        flown_m = float(np.diagonal(ways).max())
        # A vehicle that finds no place of its own on a shorter way: there is no better assignment.
        shorter = csr_array(ways < flown_m / _LONGER)
        if (maximum_bipartite_matching(shorter, perm_type="column") < 0).any():
            found.append((0.0, move.start_s))
            continue
        fastest = bottleneck(ways)
        assert fastest is not None
        straight_m = least_distance(before, after[fastest])[0]
        limit_m = plan.scenario.limits.separation_min_m
        shortest_m = float(ways[np.arange(len(ways)), fastest].max())
        found.append((flown_m - shortest_m if straight_m >= limit_m else 0.0, move.start_s))
    return found


def _taken(plan: Plan, change: ChangeTable, places: Array, targets: Array, end_s: float) -> Rows:
    """The place of each vehicle (V,) after a change; any is right where the assignment is free."""
    fixed = np.arange(len(targets))
    if change.assignment == "fixed":
        return fixed
    ended = [move.end_s for move in plan.scheduled_moves if began_before(plan, move.start_s)]
    seen_s = plan.t_start_s if began_before(plan, end_s) and end_s == ended[-1] else end_s
    # Rotated and scaled, or before the last change that the plan begins with, the shape does not tell who is where.
    if bends(plan) or began_before(plan, seen_s):
        limits, leader = plan.scenario.limits, plan.leader
        try:
            return reshape(places, targets, leader, limits.separation_min_m).places
        except Infeasible:
            return fixed
    taken = np.asarray(KDTree(targets).query(plan.shape.at(seen_s))[1])
    # Two on one place: the check names the vehicle that is off.
    return taken if len(np.unique(taken)) == len(taken) else fixed


def nearest_pair_m(places: Array) -> float:
    """Least distance between two of V positions (V, 3)."""
    if len(places) <= _FEW:
        return float(pdist(places).min())
    return float(KDTree(places).query(places, k=2)[0][:, 1].min())
