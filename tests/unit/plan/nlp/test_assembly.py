"""Exact derivatives of programs with several legs: holds, points that are passed by, speeds, times, jerk, free time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.plan.nlp.route_phases import first_mesh
from gcs.plan.nlp.transcription import Program, transcribe
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search.free_final_time import with_free_time
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.leg_guess import on_time
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.casadis_own import assert_casadis_own
from tests.unit.plan.formations import ROOMY, STRONG
from tests.unit.plan.route_flights import CORNER, FAR, flight_through

RICH = (
    {**CORNER, "radius_m": 3.0, "speed_mps": 2.0, "by_s": 30.0},
    {"position_m": [40.0, 50.0, 7.0], "hold_s": 4.0, "heading_deg": 20.0},
    {**FAR, "radius_m": 2.0, "after_s": 40.0},
)
FREE = {"time": {"flight_s": 60.0, "free": True}}
JERK = {"limits": {**ROOMY, "jerk_max_mps3": 2.0}, "vehicle": STRONG}
KINDS: dict[str, dict[str, Any]] = {
    "time given": {},
    "time free": FREE,
    "jerk limited": JERK,
    "jerk limited, time free": {**JERK, **FREE},
    "on a course": {"formation": {"frame": "course"}, "vehicles": 2},
}


def rich_program(scenario: Scenario) -> tuple[Problem, Program, np.ndarray]:
    problem = flight_problem(scenario)
    problem = with_free_time(problem) if scenario.time.free else problem
    route = straight_route(problem)
    timed = on_time(problem, route)
    guess = along(timed, route)
    mesh = first_mesh(timed, 9.0, 6.0, 2).enforcing_at(np.array([5.0, 31.0]))
    program = transcribe(timed, mesh, guess)
    start = program.scaled(guess)
    return timed, program, start + 0.1 * np.random.default_rng(4).uniform(-1.0, 1.0, len(start))


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_over_several_legs_are_casadis_own(simulation1: Scenario, kind: str) -> None:
    _, program, y = rich_program(flight_through(simulation1, *RICH, **KINDS[kind]))
    assert len(program.y_low) == program.layout.size + 4  # the stretches of four legs
    assert len(program.g_low) == len(program.g_high) == len(program.g_ids)
    assert_casadis_own(program, y)


def test_derivatives_are_differences_of_values(simulation1: Scenario) -> None:
    """Along one direction that changes every unknown, the stretches of the legs with them."""
    _, program, y = rich_program(flight_through(simulation1, *RICH, **FREE))
    along_y = np.random.default_rng(5).normal(size=len(y))
    step = 1e-6
    values = [program.nlp(y + sign * step * along_y, []) for sign in (1.0, -1.0)]
    by_f, by_g = ((np.array(up) - np.array(down)).ravel() / (2.0 * step) for up, down in zip(*values, strict=True))
    gradient = np.array(program.derivatives["grad_f"](y, [])[1]).ravel()
    jacobian = np.array(program.derivatives["jac_g"](y, [])[1])
    assert gradient @ along_y == pytest.approx(float(by_f[0]), rel=1e-6)
    np.testing.assert_allclose(jacobian @ along_y, by_g, rtol=1e-5, atol=1e-5 * np.abs(by_g).max())


def test_rows_of_points_and_times_are_what_they_are_called(simulation1: Scenario) -> None:
    problem, program, y = rich_program(flight_through(simulation1, *RICH))
    rows = [(str(constraint), t_s) for constraint, t_s in program.g_ids]
    g = dict(zip(rows, np.array(program.nlp(y, [])[1]).ravel(), strict=True))
    assert len(g) == len(rows)  # each has a name of its own
    mesh = program.layout.mesh
    w = y[: program.layout.size] * program.unit + program.shift
    state = w[program.layout.joint(int(mesh.arrivals[0])) :][:12]
    at_s = problem.point_s[0]
    away_m = np.linalg.norm(state[:3] - problem.points[0].place_ned_m)
    assert g["distance to point 1", at_s] == pytest.approx(1.0 - (away_m / 3.0) ** 2)
    assert g["speed at point 1", at_s] == pytest.approx((np.linalg.norm(state[3:6]) / 2.0) ** 2 - 1.0)
    stretch = program.stretch(y)
    before_s = stretch[:3] @ mesh.leg_lengths_s[:3]
    assert g["time of point 3", problem.point_s[2]] == pytest.approx(before_s / 60.0)
    assert program.mesh(y).joints_s[mesh.arrivals[2]] == pytest.approx(before_s + 4.0)
    low = dict(zip(rows, program.g_low, strict=True))
    assert low["time of point 3", problem.point_s[2]] == pytest.approx((40.0 - 4.0) / 60.0)
    end = "time of flight", 60.0
    assert g[end] == pytest.approx(stretch @ mesh.leg_lengths_s / 60.0)
    assert low[end] == pytest.approx(56.0 / 60.0)
