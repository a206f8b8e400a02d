"""Every step from a scenario file to the first rounds of the optimiser, as commands take them."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from gcs.errors import GcsError
from gcs.plan.formation.timeline import gate_crossing_s, in_turn, lay, scheduled, starts_at_points
from gcs.plan.ocp.bounds import leader_control_bounds, leader_state_bounds
from gcs.plan.ocp.problem import Problem, flight_problem, run_up_problem
from gcs.plan.planner import make_plan
from gcs.plan.search.free_final_time import with_free_time
from gcs.plan.search.infeasibility import check_time
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.leg_guess import on_time, routes_through
from gcs.plan.search.routes import every_route
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.si import ability_of, hover_start_ned_m, leader_index

REFUSED, INFEASIBLE, ACCEPTED = "refused", "infeasible", "accepted"
NO_PLAN, BEGUN, PLANNED = "no plan", "first rounds done", "planned"


def verdict(file: Path) -> str:
    """How far a scenario comes. Any exception but a GcsError passes, and so does a warning of NumPy's."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            scenario = load_scenario(file)
        except GcsError:
            return REFUSED
        try:
            before_planning(scenario)
        except GcsError:
            return INFEASIBLE
        return ACCEPTED


def before_planning(scenario: Scenario) -> None:
    """What the planner computes before the first iteration. Raises GcsError for what has no plan."""
    problem = flight_problem(scenario)
    if scenario.time.free:
        problem = with_free_time(problem)
    check_time(problem)
    ability_of(problem.quadrotor, scenario.limits)
    _bounds(problem)
    problem = on_time(problem, straight_route(problem))
    guess = along(problem, straight_route(problem))
    assert np.isfinite(guess.state(guess.joints_s[:-1])).all()
    for route in (routes_through(problem) if problem.points else every_route(problem))[:1]:
        along(on_time(problem, route), route)
    if any(scenario.start.velocity_mps):
        run_up = run_up_problem(scenario, hover_start_ned_m(scenario)[leader_index(scenario)])
        _bounds(run_up)
        along(run_up, straight_route(run_up))
    changes = scheduled(scenario)
    times = np.linspace(0.0, problem.end_s, 2 + int(problem.end_s))
    places = guess.state(times)[:, :3]
    starts = starts_at_points(scenario, problem.point_s)
    if starts is None:
        crossed = [c.at_s if c.gate_m is None else gate_crossing_s(c.gate_m, times, places) for c in changes]
        starts = tuple(0.0 if t is None else t for t in crossed)
    lay(scenario, in_turn(scenario, starts, problem.end_s), 0.0, problem.end_s)


def _bounds(problem: Problem) -> None:
    times = np.linspace(problem.start_s, problem.end_s, 50)
    leader_state_bounds(problem, times)
    leader_control_bounds(problem, times)


class _EnoughRounds(Exception):
    """The optimiser has done its first rounds."""


def planned(file: Path) -> str:
    """How the first two rounds of the optimiser end. Any exception but a GcsError passes."""
    rounds = 0

    def stop(_: MeshRound) -> None:
        nonlocal rounds
        rounds += 1
        if rounds >= 2:
            raise _EnoughRounds

    try:
        make_plan(load_scenario(file), stop)
    except GcsError:
        return NO_PLAN
    except _EnoughRounds:
        return BEGUN
    return PLANNED
