"""Routes through points: the sides of each leg combined, shortest first, and the leg that has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.leg_guess import one_leg, routes_through
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import CORNER, FAR, flight_through


def test_without_obstacles_the_route_is_its_points(simulation1: Scenario) -> None:
    (route,) = routes_through(flight_problem(flight_through(simulation1, CORNER, FAR)))
    np.testing.assert_allclose(route.points_m, [[10.0, 20.0], [60.0, 20.0], [60.0, 60.0], [10.0, 60.0]])
    assert route.ends == (1, 2)
    assert [leg.length_m for leg in route.legs] == pytest.approx([50.0, 40.0, 50.0])


def test_the_sides_of_all_legs_are_combined_shortest_first(simulation1: Scenario) -> None:
    """Two legs each have a disk a little beside their middle: one short way around, and a longer one."""
    disks = [
        {"north_m": 35.0, "east_m": 22.0, "radius_m": 6.0},
        {"north_m": 63.0, "east_m": 40.0, "radius_m": 6.0},
    ]
    routes = routes_through(flight_problem(flight_through(simulation1, CORNER, FAR, no_fly=disks)))
    assert len(routes) == 4
    lengths_m = [route.length_m for route in routes]
    assert lengths_m == sorted(lengths_m)
    passed = []
    for route in routes:
        first, second, third = route.legs
        np.testing.assert_allclose([leg.points_m[-1] for leg in route.legs], [[60.0, 20.0], [60.0, 60.0], [10.0, 60.0]])
        assert third.length_m == pytest.approx(50.0)
        passed.append((float(np.mean(first.points_m[1:-1, 1])) > 22.0, float(np.mean(second.points_m[1:-1, 0])) > 63.0))
    assert passed[0] == (False, False)  # both on their short side
    assert passed[-1] == (True, True)
    assert len(set(passed)) == 4


def test_a_leg_without_a_way_is_named(simulation1: Scenario) -> None:
    wall = [{"polygon_m": [[-80.0, 38.0], [180.0, 38.0], [180.0, 44.0], [-80.0, 44.0]]}]
    problem = flight_problem(flight_through(simulation1, CORNER, {**FAR, "name": "gate"}, no_fly=wall))
    with pytest.raises(Infeasible, match=r'^no plan: leg 2 \(point 1 to point 2 \("gate"\)\): '):
        routes_through(problem)


def test_one_leg_flies_on_at_a_point_and_rests_in_a_hold(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, CORNER, {**FAR, "hold_s": 5.0}))
    problem = replace(problem, point_s=(20.0, 36.0))
    middle, last = one_leg(problem, 1), one_leg(problem, 2)
    assert (middle.start_s, middle.end_s, last.start_s, last.end_s) == (20.0, 36.0, 41.0, 60.0)
    np.testing.assert_allclose(middle.start_state[VELOCITY], [0.0, 40.0 / 16.0, -2.0 / 16.0])
    assert not middle.end_state[VELOCITY].any()
    np.testing.assert_array_equal(last.end_state, problem.end_state)
    np.testing.assert_allclose(last.start_state[POSITION], [60.0, 60.0, -8.0])
    assert not middle.points
