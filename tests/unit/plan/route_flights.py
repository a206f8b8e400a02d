"""Small flights through points, for tests: a leader alone or with two others, over flat ground."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search.initial_guess import along
from gcs.plan.search.leg_guess import on_time, routes_through
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import NED_FROM_UP, route_points, with_changes_of_route
from tests.unit.plan.problems import meadow

CORNERS = ([60.0, 20.0, 6.0], [60.0, 60.0, 8.0])  # north, east, up, m
CORNER, FAR = ({"position_m": place} for place in CORNERS)


def flight_through(scenario: Scenario, *route: dict[str, Any], vehicles: int = 1, **tables: Any) -> Scenario:
    """From a hover to another one through points, in 60 s, as `tables` do not say otherwise."""
    fleet = [v.model_dump() for v in scenario.formation.vehicle[:vehicles]]
    ends: dict[str, Any] = {
        "limits": {"north_m": [-60.0, 160.0], "east_m": [-60.0, 140.0]} | tables.pop("limits", {}),
        "formation": {"vehicle": fleet} | tables.pop("formation", {}),
        "time": {"flight_s": 60.0},
        "start": {"position_m": [10.0, 20.0, 5.0]},
        "end": {"position_m": [10.0, 60.0, 5.0]},
        "ground_phases": {"takeoff_s": 12.0, "landing_s": 15.0},
    }
    return with_changes_of_route(meadow(scenario, route=list(route), **{**ends, **tables}))


def route_ned_m(scenario: Scenario) -> np.ndarray:
    """The points of the route (P, 3), round after round, NED, m."""
    return np.array([point.position_m for point in route_points(scenario)]).reshape(-1, 3) * NED_FROM_UP


def first_guess(scenario: Scenario) -> tuple[Problem, Trajectory]:
    """The problem of a flight with its first times at the points, and the guess along its shortest route."""
    problem = flight_problem(scenario)
    route = routes_through(problem)[0]
    timed = on_time(problem, route)
    return timed, along(timed, route)
