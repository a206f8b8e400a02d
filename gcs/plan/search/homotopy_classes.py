"""Of several ways through the map the best: each optimised as long as it can still win, each accounted for.

Knows: routes, their lower bounds, what to try when none works. Does not know: how one way is optimised.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gcs.errors import PlanningError
from gcs.plan.nlp.mesh_refinement import Optimum
from gcs.plan.ocp.objective_sum import least_cost, refuse_false_bounds
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.infeasibility import check_time, explain_infeasible
from gcs.plan.search.initial_guess import along, straight_way
from gcs.plan.search.parallel import each, pays
from gcs.plan.search.routes import Route, every_route
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.plan.trajectory.plan import Alternative, MeshRound

# Taut ways on a grid are up to so much longer than the shortest way on the same sides.
GRID_EXCESS = 1.02


def best_class(
    problem: Problem, on_round: Callable[[MeshRound], None], *, every_way: bool = False, workers: int = 1
) -> tuple[Optimum, tuple[Alternative, ...]]:
    """The best optimum over all ways found, and what became of each way, shortest first.

    With several `workers` ways are optimised at once where that is quicker; the result is the same. Raises Infeasible
    (no way at all, too little time, ...) or PlanningError.
    """
    check_time(problem)
    routes = every_route(problem)
    best: Optimum | None = None
    failures: list[PlanningError] = []
    tried: list[Alternative] = []
    ahead: dict[int, Optimum | PlanningError] = {}
    first_s = 0.0
    for number, route in enumerate(routes):
        bound = least_objective(problem, route)
        if best is not None and bound >= best.objective and not every_way:
            tried.append(Alternative(route.length_m, None, f"cannot win: costs at least {bound:.3f}"))
            continue
        if number == 1:
            limit = np.inf if best is None or every_way else best.objective
            worth = [n for n in range(1, len(routes)) if least_objective(problem, routes[n]) < limit]
            if pays(len(worth), workers, first_s):
                ahead = dict(zip(worth, each(_flight, [(problem, routes[n]) for n in worth], workers), strict=True))
        began = time.perf_counter()
        try:
            found = _known(ahead[number], on_round) if number in ahead else _optimised(problem, route, on_round)
        except PlanningError as failure:
            first_s = max(first_s, time.perf_counter() - began)
            failures.append(failure)
            tried.append(Alternative(route.length_m, None, failure.message))
            continue
        first_s = max(first_s, time.perf_counter() - began)
        refuse_false_bounds(problem, found.trajectory)
        tried.append(Alternative(route.length_m, found.objective, "holds between nodes"))
        if best is None or found.objective < best.objective:
            best = found
    if every_way and problem.coordinates and not problem.follows_course:
        tried += [replace(way, verdict=f"rigid: {way.verdict}") for way in _rigid(problem, on_round)]
    if best is None:
        # The map is coarse; the optimiser may find room that its cells do not show.
        try:
            best = optimise_on_schedule(problem, along(problem, straight_way(problem)), on_round)
        except PlanningError as failure:
            raise explain_infeasible(problem, routes[0], [*failures, failure]) from failure
    return best, tuple(tried)


def _optimised(problem: Problem, route: Route, on_round: Callable[[MeshRound], None]) -> Optimum:
    return optimise_on_schedule(problem, along(problem, route), on_round)


def _flight(task: tuple[Problem, Route]) -> Optimum | PlanningError:
    """One way in a process of its own."""
    try:
        return _optimised(*task, lambda _: None)
    except PlanningError as failure:
        return failure


def _known(found: Optimum | PlanningError, on_round: Callable[[MeshRound], None]) -> Optimum:
    """What a worker has found, told as if it were found now."""
    if isinstance(found, PlanningError):
        raise found
    for done in found.history:
        on_round(done)
    return found


def _rigid(problem: Problem, on_round: Callable[[MeshRound], None]) -> tuple[Alternative, ...]:
    """What the formation could do without changing by itself, for comparison."""
    try:
        return best_class(replace(problem, coordinates=()), on_round)[1]
    except PlanningError as failure:
        return (Alternative(0.0, None, failure.message),)


def least_objective(problem: Problem, route: Route) -> float:
    """The lower bound of the objective for all flights along a route, or on the straight line where that is longer."""
    straight_m = float(np.linalg.norm((problem.end_state - problem.start_state)[:3]))
    return least_cost(problem, max(route.length_m / GRID_EXCESS, straight_m))
