"""A flight whose time nobody fixes: an unknown of the program, between bounds, with a cost of its own.

Knows: where such a flight is looked for, and how its time becomes a round number. Does not know: how the program has it
(`transcription`). Energy is that of the whole flight against the reference, `[time] flight_s`, so that flights of
different length compare: a straight one costs a_1 (T_ref / T)^2 + time_weight T / T_ref.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import PlanningError
from gcs.plan.nlp.mesh_refinement import Optimum, lasting, optimise
from gcs.plan.ocp.objectives import FreeTime
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.homotopy_classes import best_class
from gcs.plan.search.infeasibility import least_time_s
from gcs.plan.trajectory.plan import Alternative, MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario

_LONGEST = 4.0  # times the reference, or the least time, where the scenario says nothing
_EASY = 1.5  # times what speed limits alone need: from there the optimiser finds its way
_ROUND_S = 0.01


def best_flight(
    problem: Problem, on_round: Callable[[MeshRound], None], *, every_way: bool, workers: int = 1
) -> tuple[Optimum, tuple[Alternative, ...]]:
    """The best flight in the scenario's time, or in the best time where that is free. Raises PlanningError."""
    if not problem.scenario.time.free:
        return best_class(problem, on_round, every_way=every_way, workers=workers)
    problem = freed(problem)
    best, alternatives = best_class(problem, on_round, every_way=every_way, workers=workers)
    return _rounded(problem, best, on_round), alternatives


def freed(problem: Problem) -> Problem:
    """The problem with its time as an unknown; it ends, for a guess, where that is easy."""
    scenario, time = problem.scenario, problem.scenario.time
    least_s = least_time_s(problem)
    earliest_s = max(time.earliest_s or 0.0, least_s)
    latest_s = time.latest_s or _LONGEST * max(time.flight_s, least_s)
    easy_s = float(np.clip(max(time.flight_s, _EASY * least_s), min(earliest_s, latest_s), latest_s))
    free = FreeTime(min(earliest_s, latest_s), latest_s, scenario.objective.time_weight, time.flight_s)
    return replace(lasting(problem, problem.start_s + easy_s), free_time=free)


def fixed(scenario: Scenario, flight_s: float) -> Scenario:
    """The scenario with this time of flight and no other."""
    if not scenario.time.free:
        return scenario
    return scenario.model_copy(update={"time": scenario.time.model_copy(update={"flight_s": flight_s, "free": False})})


def _rounded(problem: Problem, best: Optimum, on_round: Callable[[MeshRound], None]) -> Optimum:
    """The same flight in the next round time, where that has one: people read it, vehicles' clocks have it."""
    time = problem.free_time
    assert time is not None
    if not any(problem.scenario.objective.weights) and not problem.extra_objectives:
        return best  # no flight of a given time is better than another
    end_s = float(np.ceil((best.trajectory.end_s - 1e-9) / _ROUND_S)) * _ROUND_S
    end_s = round(min(end_s, time.latest_s), 6)
    exact = replace(lasting(problem, end_s), free_time=replace(time, earliest_s=end_s, latest_s=end_s))
    try:
        found = optimise(exact, _stretched(best.trajectory, end_s), on_round)
    except PlanningError:
        return best
    return replace(found, history=(*best.history, *found.history), moves=best.moves)


def _stretched(trajectory: Trajectory, end_s: float) -> Trajectory:
    """The same states in another time, for a guess."""
    factor = (end_s - trajectory.start_s) / (trajectory.end_s - trajectory.start_s)
    joints = trajectory.start_s + factor * (trajectory.joints_s - trajectory.start_s)
    joints[-1] = end_s
    parts = []
    for polynomials in (trajectory.state, trajectory.control):
        powers = np.arange(len(polynomials.c) - 1.0, -1.0, -1.0)
        parts.append(PPoly(polynomials.c / factor ** powers[:, None, None], joints))
    return Trajectory(*parts)
