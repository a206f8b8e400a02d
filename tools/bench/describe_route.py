"""A leader's route over Simulation 1's mountains as plain numbers, on Skein's first mesh: what every contender gets.

Knows: Skein's own problem. Does not know: contenders.
"""

from __future__ import annotations

from typing import Any

from gcs.plan.nlp.leg_mesh import first_mesh
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.mesh_refinement import DEGREE, LONGEST_S, SHORTEST_S
from gcs.plan.nlp.program.leg_rows import leg_times
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search.initial_guess import along
from gcs.plan.search.legs.leg_routes import routes_through
from gcs.plan.search.legs.leg_schedule import on_time
from gcs.plan.search.routes import Route
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tools.bench.describe import alone, numbers
from tools.bench_route import drawn

POINTS, SEED = 5, 1


def six_on_route() -> Scenario:
    """The paper's formation through five points."""
    return drawn(POINTS, SEED)


def route_problem() -> tuple[Problem, Route]:
    """The common problem, with a guess of its times at the points, and the route of that guess."""
    problem = flight_problem(alone(six_on_route()))
    route = routes_through(problem)[0]
    return on_time(problem, route), route


def route_guess(problem: Problem, route: Route) -> Trajectory:
    """The guess of every contender: Skein's first one."""
    return along(problem, route)


def route_mesh(problem: Problem) -> Mesh:
    """The first mesh that Skein solves on."""
    return first_mesh(problem, LONGEST_S, SHORTEST_S, DEGREE)


def route_numbers(problem: Problem, route: Route, mesh: Mesh) -> dict[str, Any]:
    """Everything route.py's Legs reads; arrays as lists."""
    assert all(not point.radius_m and not point.hold_s for point in problem.points)
    guess, times = route_guess(problem, route), leg_times(problem, mesh)
    assert times is not None
    at_s = guess.state.x
    return numbers(problem, mesh) | {
        "points_ned_m": [point.place_ned_m.tolist() for point in problem.points],
        "leg_of_interval": mesh.leg_of_interval.tolist(),
        "stretch": [float(times.low[0]), float(times.high[0])],
        "guess_s": at_s.tolist(),
        "guess_state": guess.state(at_s).tolist(),
        "guess_control": guess.control(at_s).tolist(),
    }
