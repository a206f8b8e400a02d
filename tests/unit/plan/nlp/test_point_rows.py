"""Rows about the leader's state at the points of a route, by numbers worked by hand."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from gcs.plan.nlp.program_bounds import scales
from gcs.plan.nlp.route_phases import first_mesh, point_rows
from gcs.plan.nlp.variables import VariableLayout
from gcs.plan.ocp.problem import flight_problem
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import CORNER, FAR, flight_through

LAST = {"position_m": [30.0, 70.0, 6.0], "speed_mps": 2.5}


def test_rows_are_the_distance_within_a_radius_and_the_square_of_a_speed(simulation1: Scenario) -> None:
    flight = flight_through(simulation1, {**CORNER, "radius_m": 4.0, "speed_mps": 2.0}, FAR, LAST)
    problem = replace(flight_problem(flight), point_s=(15.0, 30.0, 45.0))
    layout = VariableLayout(first_mesh(problem, 9.0, 6.0, 2))
    unit, shift = scales(problem, layout)
    shift = shift + 0.5  # as if states had an offset
    made = point_rows(problem, layout, unit, shift)
    assert made is not None
    assert [f"{constraint} at {t_s:g} s" for constraint, t_s in made.ids] == [
        *("distance to point 1 at 15 s", "speed at point 1 at 15 s", "speed at point 3 at 45 s"),
    ]
    assert made.low.tolist() == [0.0, 0.0, 0.0]
    assert made.high.tolist() == [np.inf, 0.0, 0.0]
    joints = layout.mesh.arrivals
    w = np.full(layout.size, 77.0)
    north, east, up = CORNER["position_m"]
    w[layout.joint(int(joints[0])) :][:6] = north + 2.0, east - 1.0, -(up + 2.0), 1.0, 2.0, 2.0  # 3 m off, at 3 m/s
    w[layout.joint(int(joints[2])) :][3:6] = 1.5, -2.0, 0.0  # at 2.5 m/s
    functions = made.functions
    states = functions.pick @ ca.DM((w - shift) / unit) + functions.offset
    values = np.array(functions.values(states)).ravel()
    np.testing.assert_allclose(values, [1.0 - 9.0 / 16.0, 9.0 / 4.0 - 1.0, 0.0], atol=1e-12)
    assert functions.count == 3
    slopes = np.array(ca.DM(functions.jacobian(states)))
    np.testing.assert_allclose(slopes[0, :6], [-4.0 / 16.0, 2.0 / 16.0, 4.0 / 16.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(slopes[1:, 3:6], [[0.5, 1.0, 1.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(slopes[2, 9:12], [2 * 1.5 / 6.25, -4.0 / 6.25, 0.0])
    bent = np.diag(np.array(ca.DM(functions.hessian(states, [8.0, 2.0, 25.0]))))
    np.testing.assert_allclose(bent, [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 8.0, 8.0, 8.0], atol=1e-12)


def test_points_that_are_passed_exactly_at_any_speed_have_no_rows(simulation1: Scenario) -> None:
    problem = replace(flight_problem(flight_through(simulation1, CORNER, FAR)), point_s=(15.0, 30.0))
    layout = VariableLayout(first_mesh(problem, 9.0, 6.0, 2))
    assert point_rows(problem, layout, *scales(problem, layout)) is None
