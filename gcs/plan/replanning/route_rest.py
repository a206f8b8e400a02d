"""The rest of a route: a flight from any state through the points that are still ahead, solved on a mesh of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible, PlanningError
from gcs.physics.quadrotor import POSITION
from gcs.plan.nlp.mesh_refinement import Optimum, optimise
from gcs.plan.ocp.problem import Problem
from gcs.plan.replanning.obstacle_detour import detours
from gcs.plan.search.infeasibility import check_time
from gcs.plan.search.initial_guess import along
from gcs.plan.search.legs.leg_routes import routes_through
from gcs.plan.search.legs.leg_schedule import on_time
from gcs.plan.search.routes import every_route
from gcs.plan.trajectory.plan import MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import NoFlyZone

# A point that is this near in time is not flown to again: from a disturbed state it could only be passed by a turn.
_TOO_NEAR_S = 4.0


def still_ahead(problem: Problem, t_s: float) -> Problem:
    """The problem without the points that are behind the leader at a time, or too near to fly to from any state."""
    count = sum(arrival_s <= t_s + _TOO_NEAR_S for arrival_s in problem.point_s)
    return replace(problem, points=problem.points[count:], point_s=problem.point_s[count:])


def flown_through(
    problem: Problem, old: Trajectory, zones: tuple[NoFlyZone, ...], on_round: Callable[[MeshRound], None]
) -> Optimum:
    """The flight from the problem's start through its points, around new disks `zones`, near the `old` trajectory.

    Raises Infeasible, where a disk covers a point too, or PlanningError.
    """
    _refuse_covered(problem, zones)
    check_time(problem)
    failures: list[PlanningError] = []
    for timed, guess in _guesses(problem, old, zones):
        try:
            return optimise(timed, guess, on_round, near=not zones)
        except PlanningError as failure:
            failures.append(failure)
    raise next((f for f in failures if isinstance(f, Infeasible)), failures[-1])


def _guesses(problem: Problem, old: Trajectory, zones: tuple[NoFlyZone, ...]) -> Iterator[tuple[Problem, Trajectory]]:
    for guess in detours(problem, old, zones):
        yield problem, guess
    for route in routes_through(problem) if problem.points else every_route(problem):
        timed = on_time(problem, route)
        yield timed, along(timed, route)


def _refuse_covered(problem: Problem, zones: tuple[NoFlyZone, ...]) -> None:
    """Raises Infeasible where a point lies in a new zone, seen from any vehicle at its time."""
    for point, t_s in zip(problem.points, problem.point_s, strict=True):
        places = point.place_ned_m[POSITION] + problem.shape.at(t_s)
        for zone in zones:
            inside_m = -float(outside_m(zone, np.full(len(places), t_s), places[:, 0], places[:, 1]).min())
            if inside_m > point.radius_m:
                raise Infeasible(
                    f"no plan: {point.words} of the route cannot be passed: a vehicle would be {inside_m:.1f} m inside "
                    "a new no-fly zone",
                    hint="land, return or hold (`gcs attach`); the old plan has not changed",
                )
