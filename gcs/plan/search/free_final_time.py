"""Flights of free time: the time of flight is an unknown between bounds, with a cost, and is rounded at the end.

Energy is that of the whole flight over the reference time (`[time] flight_s`), so that flights of different length are
comparable: a straight one costs a_1 (T_ref / T)^2 + time_weight T / T_ref.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gcs.errors import PlanningError
from gcs.plan.formation.shape import stretched_polynomials
from gcs.plan.nlp.mesh_refinement import Optimum, with_end, with_times
from gcs.plan.ocp.problem import FreeTime, Problem
from gcs.plan.search.gate_centring import centred
from gcs.plan.search.homotopy_classes import best_class
from gcs.plan.search.leg_guess import least_legs_s
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.plan.trajectory.plan import Alternative, MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.fields import FLIGHT_MAX_S
from gcs.scenario.schema.scenario import Scenario

_LONGEST = 4.0  # times the reference or the least time, where the scenario gives no latest_s
_EASY = 1.5  # times what the speed limits need: from such a guess the optimiser converges
_ROUND_S = 0.01


def best_flight(
    problem: Problem,
    on_round: Callable[[MeshRound], None],
    *,
    all_routes: bool,
    workers: int = 1,
    explained: bool = True,
) -> tuple[Optimum, tuple[Alternative, ...]]:
    """The best flight in the scenario's time, or in the best time where that is free. Raises as `best_class`."""
    free = problem.scenario.time.free
    if free:
        problem = with_free_time(problem)
    best, alternatives = best_class(problem, on_round, all_routes=all_routes, workers=workers, explained=explained)
    if free:
        best = _rounded(problem, best, on_round)
    return centred(problem, best, on_round), alternatives


def with_free_time(problem: Problem) -> Problem:
    """The problem with its time as an unknown, and a guess of its end that is easy to fly."""
    scenario, time = problem.scenario, problem.scenario.time
    least_s = least_legs_s(problem)
    earliest_s = max(time.earliest_s or 0.0, least_s)
    latest_s = time.latest_s or min(_LONGEST * max(time.flight_s, least_s), FLIGHT_MAX_S)
    easy_s = float(np.clip(max(time.flight_s, _EASY * least_s), min(earliest_s, latest_s), latest_s))
    free = FreeTime(min(earliest_s, latest_s), latest_s, scenario.objective.time_weight, time.flight_s)
    return replace(with_end(problem, problem.start_s + easy_s), free_time=free)


def with_fixed_time(scenario: Scenario, flight_s: float) -> Scenario:
    """The scenario with this time of flight and no other."""
    if not scenario.time.free:
        return scenario
    return scenario.model_copy(update={"time": scenario.time.model_copy(update={"flight_s": flight_s, "free": False})})


def _rounded(problem: Problem, best: Optimum, on_round: Callable[[MeshRound], None]) -> Optimum:
    """The same flight in the next multiple of 0.01 s, where one exists: short to read, exact in vehicles' clocks."""
    time = problem.free_time
    assert time is not None
    if not any(problem.scenario.objective.weights) and not problem.extra_objectives:
        return best  # all flights of one time cost the same
    end_s = float(np.ceil((best.trajectory.end_s - 1e-9) / _ROUND_S)) * _ROUND_S
    end_s = round(min(end_s, time.latest_s), 6)
    exact = with_times(replace(problem, lines=best.lines), best.trajectory.end_s, best.point_s)
    exact = replace(with_end(exact, end_s), free_time=replace(time, earliest_s=end_s, latest_s=end_s))
    try:
        found = optimise_on_schedule(exact, _stretched(best.trajectory, end_s), on_round)
    except PlanningError:
        return best
    return replace(found, history=(*best.history, *found.history))


def _stretched(trajectory: Trajectory, end_s: float) -> Trajectory:
    """The same states, stretched to another time: an initial guess."""
    state, control = trajectory.state, trajectory.control
    return Trajectory(*(stretched_polynomials(part, trajectory.start_s, end_s) for part in (state, control)))
