"""The rest of a plan: parts of its polynomials, and a plan that begins in the air and ends as the old one does."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Array
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.plan import MeshRound, Phase, Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.scenario.schema.scenario import Scenario


def trajectory_part(trajectory: Trajectory, start_s: float, end_s: float) -> Trajectory:
    """The trajectory from one instant to another."""
    return Trajectory(_part(trajectory.state, start_s, end_s), _part(trajectory.control, start_s, end_s))


def shape_part(shape: Shape, start_s: float, end_s: float) -> Shape:
    """The shape from one instant to another."""
    return Shape(_part(shape.functions, start_s, end_s), shape.basis_ned_m)


def _part(polynomials: PPoly, start_s: float, end_s: float) -> PPoly:
    joints = np.asarray(polynomials.x)
    first = int(np.clip(np.searchsorted(joints, start_s, side="right") - 1, 0, len(joints) - 2))
    last = int(np.clip(np.searchsorted(joints, end_s, side="left"), first + 1, len(joints) - 1))
    coefficients = np.array(polynomials.c[:, first:last])
    if start_s != joints[first]:
        coefficients[:, 0] = _moved(coefficients[:, 0], start_s - joints[first])
    return PPoly(coefficients, np.concatenate([[start_s], joints[first + 1 : last], [end_s]]))


def _moved(coefficients: Array, by: float) -> Array:
    """The polynomial (K+1, ...), highest power first, with its origin `by` later (repeated Horner's scheme)."""
    moved = coefficients.copy()
    for end in range(len(moved), 1, -1):
        for power in range(1, end):
            moved[power] += by * moved[power - 1]
    return moved


def plan_from_flight(
    plan: Plan,
    problem: Problem,
    trajectory: Trajectory,
    *,
    objective: float,
    history: tuple[MeshRound, ...],
    timings_s: dict[str, float],
    route_s: tuple[float, ...] = (),
) -> Plan:
    """The plan of a trajectory that solves `problem`, and of the old plan's hover and landing after it."""
    end_s = plan.phase("mission").end_s
    after = trajectory_part(plan.leader_trajectory, end_s, plan.t_end_s)
    return Plan(
        with_times_of_changes(problem.scenario, plan),
        joined([trajectory, after]),
        joined_shapes([problem.shape, shape_part(plan.shape, end_s, plan.t_end_s)]),
        (Phase("mission", problem.start_s, end_s), *(p for p in plan.phases if p.start_s >= end_s)),
        objective,
        history,
        (),
        plan.moves,
        timings_s,
        tuple(problem.start_state.tolist()),
        route_s=route_s,
    )


def with_times_of_changes(scenario: Scenario, plan: Plan) -> Scenario:
    """The scenario with changes at gates and route points begun at their planned times: the track may differ now."""
    starts = iter(move.start_s for move in plan.moves if move.trigger != "auto")
    changes = []
    for change in scenario.formation.change:
        at_s = None if change.auto else next(starts, None)
        placed = (change.gate_m is not None or change.at_point is not None) and at_s is not None
        update = {"gate_m": None, "at_point": None, "at_s": at_s}
        changes.append(change.model_copy(update=update) if placed else change)
    formation = scenario.formation.model_copy(update={"change": tuple(changes)})
    return scenario.model_copy(update={"formation": formation})
