"""The terms of a plan's cost (Eq. 35), each in its own unit, from what the vehicles fly."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from gcs.physics.states import VELOCITY
from gcs.plan.ocp.objective_sum import quadrature
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS, drag_power, heading_rate, height_rate
from gcs.plan.ocp.problem import Problem, Rate, flight_problem
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

OTHER = "other"
_SEEN = 1e-3  # share of the cost: less is the difference between two quadratures


@dataclass(frozen=True)
class CostTerm:
    """One term of Eq. 35. The cost of a plan is the sum of weight times value over its terms."""

    name: str
    weight: float
    value: float  # 1: what the term measures is of the size of its reference
    reference: str  # the size at which the value is 1


def cost_terms(plan: Plan) -> tuple[CostTerm, ...]:
    """The terms of a plan's cost: energy, heading and height, and whatever else it had to pay for as `other`.

    `other` has the changes that the planner chose, the course frame and terms of your own. A plan with a free time of
    flight, or that begins in the air, has its cost from another flight's references: it has no terms.
    """
    scenario = plan.scenario
    if plan.begin_state is not None or scenario.time.latest_s is not None or scenario.objective.time_weight:
        return ()
    problem = flight_problem(scenario)
    joints_s = plan.joints_s[(plan.joints_s >= 0.0) & (plan.joints_s <= plan.flight_s)]
    objective, times_s, spans_s = problem.objective, *quadrature(np.union1d(joints_s, [0.0, plan.flight_s]))
    late = spans_s * TERMINAL_WEIGHTS[objective.terminal_weight](times_s, plan.flight_s)
    leader = plan.leader_trajectory.state(times_s)
    energy = float(spans_s @ _drag_powers(problem, plan, times_s) / plan.flight_s)
    heading = float(late @ _rates(problem, heading_rate, leader, objective.heading_scale_rad) / late.sum())
    height = float(late @ _rates(problem, height_rate, leader, objective.height_scale_m) / late.sum())
    degrees, metres = np.degrees([objective.heading_ref_rad, objective.heading_scale_rad]), objective.height_scale_m
    found: tuple[CostTerm, ...] = (
        CostTerm("energy", objective.energy_weight, energy, f"{objective.speed_ref_mps:.2f} m/s against the air"),
        CostTerm("heading", objective.heading_weight, heading, f"{degrees[1]:g} degrees off {degrees[0]:g} degrees"),
        CostTerm("height", objective.height_weight, height, f"{metres:g} m off {objective.height_ref_m:g} m"),
    )
    # Every other term is never negative: a flight with a free time is the exception.
    left = plan.objective - sum(term.weight * term.value for term in found)
    if left < -_SEEN * abs(plan.objective):
        return ()
    if left > _SEEN * abs(plan.objective):
        found += (CostTerm(OTHER, 1.0, left, "changes, course and terms of your own"),)
    return found


def _rates(problem: Problem, rate: Rate, states: Array, scale: float) -> Array:
    """A term's rate (N,) at the leader's states (N, 12)."""
    x = ca.SX.sym("x", 12)
    at = ca.Function("rate", [x], [rate(problem, ca.vertsplit(x), (), scale)])
    return np.asarray(at.map(len(states))(states.T), dtype=np.float64).ravel()


def _drag_powers(problem: Problem, plan: Plan, times_s: Array) -> Array:
    """The power against drag (N,), as a mean over all vehicles, and as a share of that at the reference speed."""
    states = plan.states(times_s)
    x = ca.SX.sym("x", 12)
    columns = ca.vertsplit(x)
    power = drag_power(problem, columns[VELOCITY], columns[2], problem.objective.speed_ref_mps)
    at = ca.Function("power", [x], [power]).map(states.shape[0] * states.shape[1])
    powers = np.asarray(at(states.reshape(-1, 12).T), dtype=np.float64).reshape(states.shape[:2])
    return np.asarray(powers.mean(axis=0))
