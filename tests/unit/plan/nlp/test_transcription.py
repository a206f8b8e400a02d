"""The nonlinear program: its derivatives against CasADi's own, its solutions against problems solved on paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.physics.quadrotor import derivative
from gcs.physics.states import NX
from gcs.plan.formation.timeline import lay
from gcs.plan.nlp.gauss import gauss_rule
from gcs.plan.nlp.ipopt import Solution, solve
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.transcription import Program, transcribe
from gcs.plan.nlp.variables import ControlForm, VariableLayout
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.trajectory.integration_windows import window_errors
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.casadis_own import assert_casadis_own
from tests.unit.plan.formations import SHRINK, TO_FILE, TURN, at, auto, fleet
from tests.unit.plan.problems import changed, meadow, straight, vertical_move, with_bounds


def evenly(problem: Problem, intervals: int, degree: int) -> Mesh:
    return Mesh(np.linspace(problem.start_s, problem.end_s, intervals + 1), (degree,) * intervals)


def solved(problem: Problem, mesh: Mesh) -> tuple[Solution, Trajectory, Program]:
    program = transcribe(problem, mesh, straight(problem))
    solution = solve(program, program.scaled(straight(problem)))
    return solution, program.trajectory(solution.y), program


def drift_m(flown: Trajectory, problem: Problem) -> float:
    """Largest error of a window of 5 s."""
    windows = window_errors(
        lambda t: flown.state(t)[None], lambda t: flown.control(t)[None], flown.joints_s, problem.quadrotor
    )
    return float(windows.error_m.max())


@pytest.fixture(scope="module")
def rich(simulation1: Scenario) -> tuple[Problem, Mesh]:
    """Every kind of term: mountains, a disk, six vehicles, unequal degrees, watched instants."""
    disk = {"north_m": 600.0, "east_m": 450.0, "radius_m": 80.0}
    problem = flight_problem(changed(simulation1, no_fly=[disk]))
    return problem, Mesh(np.array([0.0, 20.0, 120.0, 275.0]), (2, 4, 3)).enforcing_at(
        np.array([0.0, 60.0, 130.0, 275.0])
    )


def near(program: Program, problem: Problem, seed: int) -> Array:
    random = np.random.default_rng(seed)
    start = program.scaled(straight(problem))
    return np.asarray(start + 0.1 * random.normal(size=len(start)))


@pytest.mark.parametrize("form", ControlForm)
@pytest.mark.parametrize("watched", [True, False])
def test_derivatives_are_casadis_own(rich: tuple[Problem, Mesh], watched: bool, form: ControlForm) -> None:
    problem, mesh = rich
    program = transcribe(problem, mesh if watched else replace(mesh, extra_s=np.zeros(0)), straight(problem), form)
    assert_casadis_own(program, near(program, problem, 1))


BENDS = {
    "scheduled": {"changes": (at(TURN, 2.0), at(SHRINK, 30.0))},
    "scale, heading and blend": {"changes": (auto(SHRINK), auto(TURN), auto(TO_FILE))},
    "course and scale on a moving base": {
        "changes": (at({**SHRINK, "scale": 0.9}, 2.0), auto(SHRINK)),
        "formation": {"frame": "course"},
    },
}


@pytest.mark.parametrize("kind", BENDS)
def test_derivatives_are_casadis_own_where_the_shape_moves(simulation1: Scenario, kind: str) -> None:
    disk = {"north_m": 20.0, "east_m": 7.0, "radius_m": 3.0}
    hill = {"north_m": [25.0], "east_m": [5.0], "height_m": [3.0], "spread_north_m": [9.0], "spread_east_m": [9.0]}
    scenario = fleet(
        simulation1,
        5,
        "row",
        time={"flight_s": 60.0},
        no_fly=[disk],
        terrain={"ripple": None, "mountains": hill},
        **BENDS[kind],
    )
    problem = flight_problem(scenario)
    starts = tuple(float(c.at_s) for c in scenario.formation.change if c.at_s is not None)
    problem = replace(problem, shape=lay(scenario, starts, 0.0, 60.0).shape)
    guess = along(problem, straight_route(problem))
    mesh = Mesh(np.array([0.0, 8.0, 33.0, 60.0]), (2, 4, 3)).enforcing_at(np.array([5.0, 34.0, 40.0]))
    program = transcribe(problem, mesh, guess)
    start = program.scaled(guess)
    assert_casadis_own(program, start + 0.1 * np.random.default_rng(3).normal(size=len(start)))


def test_rows_are_eqs_44_and_46_written_out(rich: tuple[Problem, Mesh]) -> None:
    """Sum by sum as the paper has them, from the polynomials, with no matrix of the program's."""
    problem, mesh = rich
    program = transcribe(problem, mesh, straight(problem))
    at = near(program, problem, 3)
    flown = program.trajectory(at)
    g = np.array(program.nlp(at, [])[1]).ravel()
    row = 0
    unit = np.array([100.0, 100.0, 10.0, 5.0, 5.0, 1.0, 0.1, 0.1, 1.0, 0.05, 0.05, 0.05])
    for i, degree in enumerate(mesh.degrees):
        low, high = mesh.joints_s[i], mesh.joints_s[i + 1]
        rule = gauss_rule(degree)
        times = low + 0.5 * (high - low) * (rule.nodes + 1.0)
        rate = derivative(flown.state(times), flown.control(times), problem.quadrotor)
        values = flown.state(np.concatenate([[low], times]))
        defects = rule.differentiation @ values - 0.5 * (high - low) * rate
        end = (at * program.unit + program.shift)[program.layout.joint(i + 1) :][:NX]  # an unknown of its own
        np.testing.assert_allclose(g[row : row + NX * degree].reshape(degree, NX) * unit, defects, atol=1e-7)
        row += NX * degree
        joint = end - values[0] - 0.5 * (high - low) * rule.weights @ rate
        np.testing.assert_allclose(g[row : row + NX] * unit, joint, atol=1e-7)
        constraint, t_s = program.g_ids[row + 2]
        assert (str(constraint), t_s) == ("Eq. 1 for height", high)
        row += NX


def test_every_row_and_unknown_has_a_name_of_its_own(rich: tuple[Problem, Mesh]) -> None:
    problem, mesh = rich
    program = transcribe(problem, mesh, straight(problem))
    assert (
        len(program.g_ids)
        == len(program.g_low)
        == len(program.g_high)
        == np.array(program.nlp(np.zeros(program.layout.size), [])[1]).size
    )
    assert len({(str(constraint), t_s) for constraint, t_s in program.g_ids}) == len(program.g_ids)
    assert len(program.y_ids) == program.layout.size
    assert str(program.y_ids[program.layout.node(1, 2) + 5]) == "limit of vertical speed"
    assert str(program.y_ids[program.layout.control(3) + 3]) == "limit of control U4"


@pytest.mark.parametrize("form", ControlForm)
def test_unknowns_become_a_trajectory_and_come_back(rich: tuple[Problem, Mesh], form: ControlForm) -> None:
    problem, mesh = rich
    program = transcribe(problem, mesh, straight(problem), form)
    at = np.clip(near(program, problem, 4), program.y_low, program.y_high)
    # The end of an interval is an unknown of its own until Eq. 46 ties it to the polynomial; tie it here.
    flown = program.trajectory(at)
    again = program.scaled(flown)
    free = np.ones(len(at), bool)
    free[: NX * (mesh.intervals + 1)] = False
    np.testing.assert_allclose(again[free], at[free], atol=1e-9)
    np.testing.assert_allclose(again[:NX], at[:NX], atol=1e-9)


@pytest.mark.parametrize("form", ControlForm)
def test_sampling_takes_unknowns_to_what_the_trajectory_says(form: ControlForm) -> None:
    layout = VariableLayout(Mesh(np.array([0.0, 1.0, 4.0]), (2, 5)), form)
    w = np.random.default_rng(5).normal(size=layout.size)
    times = np.array([0.0, 0.3, 1.0, 1.7, 3.9999])
    z = (layout.sampling(times) @ w).reshape(-1, 16)
    for t, row in zip(times, z, strict=True):
        i = int(t >= 1.0)
        low, high = layout.mesh.joints_s[i : i + 2]
        rule = gauss_rule(layout.mesh.degrees[i])
        values = [w[layout.joint(i) :][:NX], *(w[layout.node(i, k) :][:NX] for k in range(rule.degree))]
        tau = np.array([2 * (t - low) / (high - low) - 1])
        np.testing.assert_allclose(row[:NX], (rule.interpolation(tau) @ np.array(values))[0], atol=1e-12)
        share = (t - low) / (high - low)
        control = (1 - share) * w[layout.control(i) :][:4] + share * w[layout.control(i + 1) :][:4]
        if form is ControlForm.LAGRANGE:
            points = [w[layout.control(2 * i + k) :][:4] for k in range(rule.degree)]
            powers = np.polyfit(rule.nodes, np.array(points), rule.degree - 1)
            control = tau[0] ** np.arange(rule.degree - 1, -1, -1) @ powers
        np.testing.assert_allclose(row[NX:], control, atol=1e-10)


def test_quadrature_integrates_over_all_intervals() -> None:
    layout = VariableLayout(Mesh(np.array([-1.0, 1.0, 4.0]), (3, 4)))
    assert layout.quadrature() @ layout.node_times_s() ** 4 == pytest.approx((4**5 + 1) / 5)


def test_one_interval_of_linear_thrust_has_one_way_up(simulation1: Scenario) -> None:
    """Without drag, from rest to rest, the height can only be 3 r^2 - 2 r^3, and thrust its second derivative."""
    calm = changed(simulation1, vehicle={"drag_Nspm": [0.0, 0.0, 0.0]})
    problem = with_bounds(vertical_move(calm, 10.0, 20.0), 1.0)
    _, flown, _ = solved(problem, evenly(problem, 1, 5))
    times = np.linspace(0, 20, 41)
    r = times / 20
    np.testing.assert_allclose(-flown.state(times)[:, 2], 3.0 + 10.0 * (3 * r**2 - 2 * r**3), atol=1e-6)
    np.testing.assert_allclose(flown.control(times)[:, 0], 0.5 * (9.8 + 10.0 * (6 - 12 * r) / 20**2), atol=1e-6)
    np.testing.assert_allclose(np.delete(flown.state(times), [2, 5], axis=1)[:, 2:], 0.0, atol=1e-6)


def test_least_energy_is_bang_coast_bang(simulation1: Scenario) -> None:
    """Of |v|^3 between rests under |a| <= A: speed up by A, hold v with v (T - v/A) = d, slow down by A."""
    calm = changed(simulation1, vehicle={"drag_Nspm": [0.0, 0.0, 0.0]}, objective={"weights": [1.0, 0.0, 0.0]})
    rise, duration, most = 10.0, 20.0, 0.2
    problem = with_bounds(vertical_move(calm, rise, duration), 0.5 * most)
    problem = replace(problem, objective=replace(problem.objective, energy_weight=1.0, height_weight=0.0))
    held = (duration - np.sqrt(duration**2 - 4 * rise / most)) * most / 2
    ramp = held / most
    least = (held**3 * (duration - 2 * ramp) + 2 * held**4 / (4 * most)) / (duration * (rise / duration) ** 3)
    errors = []
    for intervals in (5, 20):
        solution, flown, _ = solved(problem, evenly(problem, intervals, 3))
        errors.append(solution.objective - least)
        assert solution.objective > least  # fewer controls than the true problem has
    middle = -flown.state(np.linspace(ramp + 2, duration - ramp - 2, 20))[:, 5]
    np.testing.assert_allclose(middle, held, rtol=2e-2)
    assert flown.control(np.array([1.0, 19.0]))[:, 0] == pytest.approx([4.9 + 0.1, 4.9 - 0.1], abs=1e-4)
    assert errors[1] < 0.01 * least
    assert errors[1] < errors[0] / 4


def test_accuracy_grows_with_the_degree(simulation1: Scenario) -> None:
    """On one mesh the flight over 5 s windows and the objective go to their limits as it does."""
    problem = flight_problem(meadow(simulation1))
    drifts, objectives = [], []
    degrees = (3, 4, 5, 6, 7)
    for degree in (*degrees, 9):
        solution, flown, _ = solved(problem, evenly(problem, 6, degree))
        drifts.append(drift_m(flown, problem))
        objectives.append(solution.objective)
    drift = np.array(drifts[:-1])
    off = np.abs(np.array(objectives[:-1]) - objectives[-1])
    assert (drift[1:] < drift[:-1] / 3).all()
    assert drift[-1] < 1e-4
    assert off[0] > 1e-2  # three nodes cannot
    assert off[1:].max() < 1e-4
    assert off[-1] < 2e-5  # the solver's own tolerance
