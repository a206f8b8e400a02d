"""The first mesh of several legs: joints at the points, short intervals only where the leader is at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.plan.nlp.mesh import HOLD, end_refined
from gcs.plan.nlp.route_phases import first_mesh
from gcs.plan.ocp.problem import flight_problem
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import alone, meadow
from tests.unit.plan.route_flights import CORNER, FAR, flight_through


def test_joints_are_at_points_and_at_both_ends_of_a_hold(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, {**CORNER, "hold_s": 6.0}, FAR))
    problem = replace(problem, point_s=(17.0, 41.5))
    mesh = first_mesh(problem, 9.0, 1.0, 5)
    assert mesh.joints_s[[0, -1]].tolist() == [0.0, 60.0]
    assert mesh.joints_s[mesh.arrivals].tolist() == [17.0, 41.5]
    (hold,) = np.flatnonzero(mesh.leg_of_interval == HOLD)
    assert mesh.joints_s[hold : hold + 2].tolist() == [17.0, 23.0]
    np.testing.assert_allclose(mesh.leg_lengths_s, [17.0, 18.5, 18.5])
    assert [degree for degree, leg in zip(mesh.degrees, mesh.legs, strict=True) if leg == HOLD] == [0]


def test_intervals_are_short_at_rest_and_even_where_the_leader_flies_on(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, CORNER, FAR))
    mesh = first_mesh(replace(problem, point_s=(20.0, 40.0)), 9.0, 1.0, 5)
    lengths_s = [np.diff(mesh.joints_s)[mesh.leg_of_interval == leg] for leg in range(3)]
    np.testing.assert_allclose(lengths_s[0], lengths_s[2][::-1])
    np.testing.assert_allclose(lengths_s[1], 20.0 / 3.0)
    np.testing.assert_allclose(lengths_s[0][:4], [1.0, 1.5, 2.25, 3.375])
    assert max(map(max, lengths_s)) <= 7.0


def test_a_short_leg_is_one_interval(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, CORNER, FAR))
    mesh = first_mesh(replace(problem, point_s=(20.0, 21.0)), 9.0, 1.0, 5)
    assert (mesh.leg_of_interval == 1).sum() == 1


def test_a_flight_without_points_is_one_leg_that_is_fine_at_its_ends(simulation1: Scenario) -> None:
    problem = flight_problem(meadow(alone(simulation1)))
    mesh = first_mesh(problem, 9.0, 1.0, 5)
    assert mesh.joints_s.tolist() == end_refined(0.0, 20.0, 9.0, 1.0, 5).joints_s.tolist()
    assert mesh.leg_count == 1


def test_a_leg_between_two_holds_is_fine_at_both_ends_as_far_as_it_is_long(simulation1: Scenario) -> None:
    """Ramps take two fifths of it each at most, and seven tenths where one end alone is at rest."""
    held = [{**point, "hold_s": 2.0} for point in (CORNER, FAR)]
    problem = flight_problem(flight_through(simulation1, *held))
    mesh = first_mesh(replace(problem, point_s=(20.0, 34.0)), 9.0, 1.0, 5)
    between = np.diff(mesh.joints_s)[mesh.leg_of_interval == 1]  # 12 s, of which 4.8 s hold 1, 1.5 and 2.25 s
    np.testing.assert_allclose(between, [1.0, 1.5, 2.25, 2.5, 2.25, 1.5, 1.0])
    problem = flight_problem(flight_through(simulation1, held[0], FAR))
    mesh = first_mesh(replace(problem, point_s=(20.0, 34.0)), 9.0, 1.0, 5)
    between = np.diff(mesh.joints_s)[mesh.leg_of_interval == 1]  # 12 s, of which 8.4 s hold 3.375 s as well
    np.testing.assert_allclose(between, [1.0, 1.5, 2.25, 3.375, 3.875])
