"""The first mesh of several legs: joints at the points, short intervals only where the leader is at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.plan.nlp.leg_mesh import first_mesh
from gcs.plan.nlp.mesh import HOLD
from gcs.plan.ocp.problem import flight_problem
from gcs.scenario.schema.scenario import Scenario
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
