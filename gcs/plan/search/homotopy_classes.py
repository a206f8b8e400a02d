"""The best flight over all routes: each route whose lower bound can still win is optimised, all are reported."""

import math
import multiprocessing
import signal
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TypeVar

import numpy as np

from gcs.errors import OutOfTime, PlanningError
from gcs.plan.nlp.mesh_refinement import Optimum
from gcs.plan.ocp.objective_sum import least_cost, refuse_false_bounds
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.infeasibility import check_time, explain_infeasible
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.leg_guess import on_time, routes_through
from gcs.plan.search.open_lines import open_where_blocked
from gcs.plan.search.routes import Route, every_route
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.plan.trajectory.leg_lines import LegLimits
from gcs.plan.trajectory.plan import Alternative, MeshRound
from gcs.util.long_work import left_s, within

# A shortened route on the grid is longer than the shortest one on the same sides, by up to this factor.
GRID_EXCESS = 1.02
Task = TypeVar("Task")
Result = TypeVar("Result")
START_S = 2.5  # time for a worker to load the optimiser
_CTRL_C_IS_FOR_THE_PARENT = signal.SIGINT, signal.SIG_IGN


def best_class(
    problem: Problem,
    on_round: Callable[[MeshRound], None],
    *,
    all_routes: bool = False,
    workers: int = 1,
    explained: bool = True,
) -> tuple[Optimum, tuple[Alternative, ...]]:
    """The best optimum over all routes, and the result of each route, shortest first.

    With several `workers`, routes are optimised in parallel where that is quicker; the result is the same. Raises
    Infeasible (no route, too little time, ...) or PlanningError; if `explained`, with the time of flight that is
    enough, whose search takes several solves.
    """
    check_time(problem)
    routes = routes_through(problem) if problem.points else every_route(problem)
    best: Optimum | None = None
    failures: list[PlanningError] = []
    tried: list[Alternative] = []
    ahead: dict[int, Optimum | PlanningError] = {}
    first_s = 0.0
    passed: set[tuple[int, ...]] = set()
    for number, route in enumerate(routes):
        bound = least_objective(problem, route)
        if best is not None and bound >= best.objective and not all_routes:
            tried.append(Alternative(route.length_m, None, f"cannot win: costs at least {bound:.3f}"))
            continue
        if route.sides in passed and not all_routes:
            tried.append(Alternative(route.length_m, None, "passes on the same sides as a shorter route"))
            continue
        if number == 1:
            limit = np.inf if best is None or all_routes else best.objective
            worth = [
                n
                for n in range(1, len(routes))
                if least_objective(problem, routes[n]) < limit and (all_routes or not is_spare(problem, routes, n))
            ]
            if is_faster(len(worth), workers, first_s):
                ahead = dict(
                    zip(worth, run_all(_flight, [(problem, routes[n], left_s()) for n in worth], workers), strict=True)
                )
        began = time.perf_counter()
        try:
            found = _result(ahead[number], on_round) if number in ahead else _optimised(problem, route, on_round)
        except OutOfTime as late:
            if best is None:
                raise
            tried += [Alternative(left.length_m, None, late.message) for left in routes[number:]]
            break
        except PlanningError as failure:
            first_s = max(first_s, time.perf_counter() - began)
            failures.append(failure)
            tried.append(Alternative(route.length_m, None, failure.message))
            continue
        first_s = max(first_s, time.perf_counter() - began)
        refuse_false_bounds(problem, found.trajectory)
        tried.append(Alternative(route.length_m, found.objective, "verified between nodes"))
        if only_turns(problem):
            passed.add(route.sides)
        if best is None or found.objective < best.objective:
            best = found
    if all_routes and problem.coordinates and not problem.follows_course:
        try:
            rigid = best_class(replace(problem, coordinates=()), on_round)[1]
        except PlanningError as failure:
            rigid = (Alternative(0.0, None, failure.message),)
        tried += [replace(route, verdict=f"rigid: {route.verdict}") for route in rigid]
    if best is None:
        # The map is coarse: the optimiser may find a passage that its cells do not show.
        straight = straight_route(problem)
        if any(np.array_equal(route.points_m, straight.points_m) for route in routes):
            raise _explained(problem, routes[0], failures, explained=explained) from failures[-1]
        try:
            best = _optimised(problem, straight, on_round)
        except PlanningError as failure:
            raise _explained(problem, routes[0], [*failures, failure], explained=explained) from failure
    return best, tuple(tried)


def _explained(problem: Problem, route: Route, failures: list[PlanningError], *, explained: bool) -> PlanningError:
    return explain_infeasible(problem, route, failures) if explained else failures[-1]


def only_turns(problem: Problem) -> bool:
    """Whether the formation turns with its course and changes in no other way of its own.

    Then a route with room for every heading and one with room for some lead to the same flight.
    """
    return bool(problem.coordinates) and all(c.free_end for c in problem.coordinates)


def is_spare(problem: Problem, routes: tuple[Route, ...], number: int) -> bool:
    """Whether a route is needed only where a shorter one on the same sides fails."""
    return only_turns(problem) and any(routes[n].sides == routes[number].sides for n in range(number))


def _optimised(problem: Problem, route: Route, on_round: Callable[[MeshRound], None]) -> Optimum:
    timed = on_time(problem, route)
    guess = along(timed, route)
    lined = open_where_blocked(timed, guess)
    try:
        return optimise_on_schedule(lined, guess, on_round)
    except PlanningError as failure:
        near = {leg + beside for leg in failure.legs for beside in (-1, 0, 1)}
        nearby = _without_limits(lined, near)
        everywhere = _without_limits(lined, range(len(lined.lines)))
        if _limits(everywhere) == _limits(lined):
            raise
    if _limits(nearby) not in (_limits(lined), _limits(everywhere)):
        with suppress(PlanningError):
            return optimise_on_schedule(nearby, guess, on_round)
    return optimise_on_schedule(everywhere, guess, on_round)


def _limits(problem: Problem) -> list[LegLimits]:
    return [line.limits for line in problem.lines]


def _without_limits(problem: Problem, legs: Collection[int]) -> Problem:
    """The problem in which these legs have no default limits."""
    lines = enumerate(problem.lines)
    return replace(problem, lines=tuple(x.opened(beside=True, above=True) if n in legs else x for n, x in lines))


def _flight(task: tuple[Problem, Route, float]) -> Optimum | PlanningError:
    """The optimum of one route, or its failure; runs in a worker process, which has so much time left."""
    problem, route, limit_s = task
    try:
        with within(limit_s):
            return _optimised(problem, route, lambda _: None)
    except PlanningError as failure:
        return failure


def _result(found: Optimum | PlanningError, on_round: Callable[[MeshRound], None]) -> Optimum:
    """A worker's result: its rounds are reported now, its failure is raised now."""
    if isinstance(found, PlanningError):
        raise found
    for done in found.history:
        on_round(done)
    return found


def least_objective(problem: Problem, route: Route) -> float:
    """The lower bound of the objective for all flights along a route, or on the straight line where that is longer."""
    straight_m = float(np.linalg.norm(np.diff(problem.stops_ned_m, axis=0), axis=1).sum())
    return least_cost(problem, max(route.length_m / GRID_EXCESS, straight_m))


def is_faster(tasks: int, workers: int, expected_s: float) -> bool:
    """Whether workers finish these tasks of `expected_s` each sooner than one process."""
    return workers > 1 and tasks > 0 and expected_s * (tasks - math.ceil(tasks / min(workers, tasks))) > START_S


def run_all(work: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> list[Result]:
    """Results of `work` in the order of the tasks. The first failure in that order ends all tasks and is raised."""
    pool = multiprocessing.get_context("spawn").Pool(min(workers, len(tasks)), signal.signal, _CTRL_C_IS_FOR_THE_PARENT)
    try:
        return list(pool.imap(work, tasks))
    finally:
        pool.terminate()
        pool.join()
