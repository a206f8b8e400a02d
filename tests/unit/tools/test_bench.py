"""The race's copy of the problem is the planner's problem; its findings see what is wrong with a solution."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.nlp.variables import ControlForm
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import LIFT
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array
from tools import bench_legs, bench_planner
from tools.bench import describe, findings, race
from tools.bench.findings import Findings
from tools.bench.leader import Leader
from tools.bench.race import Contender, Goal, Record, Unavailable, environment
from tools.bench.skein import interpolated

Route = tuple[Problem, Mesh, Trajectory]


@pytest.fixture(scope="module")
def problem() -> Problem:
    return describe.leader_problem()


@pytest.fixture(scope="module")
def leader(problem: Problem) -> Leader:
    return Leader(describe.numbers(problem, describe.uniform(problem)))


@pytest.fixture(scope="module")
def route() -> Route:
    return describe.route_problem()


@pytest.fixture(scope="module")
def legs(route: Route) -> Leader:
    return Leader(describe.numbers(*route))


def anywhere(leader: Leader, count: int) -> tuple[Array, Array]:
    random = np.random.default_rng(1)
    x = leader.guess_x[random.integers(len(leader.guess_x), size=count)] + 0.2 * random.normal(size=(count, 12))
    return x, random.uniform(leader.u_low, leader.u_high, (count, 4))


def test_dynamics_and_path_constraints_are_the_planners(problem: Problem, leader: Leader) -> None:
    parts = stage_functions.functions(problem)
    below = np.zeros(parts.path.size1_in(1))  # the leader, and the ground below it
    below[LIFT] = problem.scenario.limits.clearance_min_m
    for x, u in zip(*anywhere(leader, 20), strict=True):
        z = np.concatenate([x * leader.state_unit, u * leader.control_unit + leader.control_shift])
        rates = np.array(leader.rates(x, u, np)) * leader.state_unit
        np.testing.assert_allclose(rates, np.array(parts.motion(z)).ravel(), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            leader.path(x, u, np),
            np.array(parts.path(z, below)).ravel(),
            rtol=1e-10,
            atol=1e-10,
        )


def test_cost_is_the_planners(problem: Problem, leader: Leader, route: Route, legs: Leader) -> None:
    for task, copy in ((problem, leader), (route[0], legs)):
        parts = stage_functions.functions(task)
        times = np.linspace(0.0, task.end_s, 20)
        for t, x, u in zip(times, *anywhere(copy, 20), strict=True):
            z = np.concatenate([x * copy.state_unit, u])
            late = 1.0 / (task.end_s - t + 0.5) / copy.numbers["late_integral"]
            rate = float(parts.cost(z, [1.0 / task.mean_s, late]))
            assert copy.cost_rate(x, t, np) == pytest.approx(rate, rel=1e-12)


def test_meshes_cover_the_flight(problem: Problem) -> None:
    meshes = [describe.uniform(problem), describe.refined_at_ends(problem), describe.converged(problem)]
    assert [mesh.intervals for mesh in meshes] == [15, 30, 220]
    for mesh in meshes:
        assert (mesh.joints_s[0], mesh.joints_s[-1]) == (problem.start_s, problem.end_s)


def test_findings_of_the_papers_own_control_form(problem: Problem) -> None:
    """Eq. 41 on 15 intervals: at peace with its nodes, out of its box and off by metres between them."""
    mesh = describe.uniform(problem)
    program = transcribe(problem, mesh, describe.straight(problem), ControlForm.LAGRANGE)
    solution = solve(program, program.scaled(describe.straight(problem)))
    flown = program.trajectory(solution.y)
    found = findings.look(problem, findings.trajectory(interpolated(flown)))
    assert not found.verified
    assert found.control > 0.5
    assert found.window_m > 1.0
    assert found.jump_m < 1e-6
    assert found.objective == pytest.approx(findings.cost(problem, flown), rel=1e-9)
    assert found.objective == pytest.approx(solution.objective, rel=0.02)
    at_nodes = flown.control(program.layout.node_times_s())
    np.testing.assert_allclose(at_nodes, np.clip(at_nodes, problem.control_low, problem.control_high), atol=1e-6)


def test_legs_are_joined_at_the_points(route: Route, legs: Leader) -> None:
    problem, mesh, _ = route
    assert legs.legs == 5 + 1 == len(problem.legs_s)
    assert legs.ends_s.tolist() == [0.0, *problem.point_s, problem.end_s]
    assert [degree for leg in range(legs.legs) for degree in legs.degrees_of(leg)] == list(mesh.degrees)
    assert legs.joints_of(legs.ends_s) == pytest.approx(mesh.joints_s.tolist(), abs=1e-9)
    for leg, point in enumerate(problem.points):
        for low, high in (legs.box_of(leg, end=True), legs.box_of(leg + 1, end=False)):
            np.testing.assert_allclose(low[:3] * legs.state_unit[:3], point.place_ned_m)
            np.testing.assert_array_equal(low[:3], high[:3])
            assert np.all(low[3:] < high[3:])
    for state, (low, high) in (
        (problem.start_state, legs.box_of(0, end=False)),
        (problem.end_state, legs.box_of(5, end=True)),
    ):
        np.testing.assert_allclose(low * legs.state_unit, state)
        np.testing.assert_array_equal(low, high)


def test_joints_follow_the_durations_of_legs(legs: Leader) -> None:
    ends_s = legs.ends_s + np.array([0.0, 1.0, -2.0, 0.5, 0.0, 3.0, 0.0])
    joints = np.array(legs.joints_of(ends_s))
    for leg, own in enumerate(legs.intervals):
        assert (joints[own[0]], joints[own[-1] + 1]) == pytest.approx((ends_s[leg], ends_s[leg + 1]))
        np.testing.assert_allclose(
            np.diff(joints)[own] / np.diff(legs.joints_s)[own],
            (ends_s[leg + 1] - ends_s[leg]) / (legs.ends_s[leg + 1] - legs.ends_s[leg]),
        )


def test_the_guess_of_each_leg_is_skeins(route: Route, legs: Leader) -> None:
    guess = route[2]
    for leg in range(legs.legs):
        times_s, x, u = legs.guess_of(leg)
        low, high = legs.duration_of(leg)
        assert low < times_s[-1] - times_s[0] < high
        # At the very end the polynomials of the guess are those of its last interval.
        np.testing.assert_allclose(x * legs.state_unit, guess.state(times_s), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            u * legs.control_unit + legs.control_shift, guess.control(times_s), rtol=1e-9, atol=1e-9
        )


def record(name: str, objective: float, mesh: str = "", **seconds: object) -> Record:
    package = "" if name.startswith("skein") else name.split("-", maxsplit=1)[0]
    found = Findings(0.0, 0.0, "", 0.0, 0.0, 0.0, objective)
    return Record(Contender(name, "", package=package), mesh, [{"objective": objective, **seconds}] * 3, "", found)


def test_goals_count_against_the_peers_best() -> None:
    records = [
        record(bench_planner.EQ_41, 0.8, "a", cold_s=0.1, solver_s=0.05),
        record("yapss-lg", 0.8, "a", cold_s=0.5, solver_s=0.2),
        record("yapss-lg, monotone mu", 0.80004, "a", cold_s=0.25, solver_s=0.1),
        record(bench_planner.REFINED, 0.81, cold_s=1.0),
    ]
    solver, cold, objective, time, converged = bench_planner.judge(records, 0.81)
    assert [solver.value, cold.value, time.value] == pytest.approx([0.5, 0.4, 4.0])
    assert [solver.met, cold.met, objective.met, time.met, converged.met] == [False, True, True, False, True]
    assert Goal("more is better", 31.0, 30.0, at_least=True).met


def test_goals_of_legs_count_against_the_fastest_peer() -> None:
    records = [
        record(bench_legs.SIX, 0.9, points_s=[10.0], cold_cpu_s=1.0, flight_cpu_s=2.0, verified_cpu_s=3.0),
        record(bench_legs.LEADER, 0.9, points_s=[10.0], cold_cpu_s=0.5, flight_cpu_s=1.0, verified_cpu_s=1.5),
        record(bench_legs.SAME_FORM, 0.8, points_s=[10.2], cold_cpu_s=0.5),
        record("slow", 0.801, points_s=[10.3], cold_cpu_s=20.0),
        record("fast", 0.84, points_s=[11.5], cold_cpu_s=2.0),
    ]
    goals = bench_legs.judge(records)
    assert [goal.value for goal in goals] == pytest.approx([1.5, 0.75, 0.5, 0.25, 0.25, 0.05, 1.3, 1.5])
    assert [goal.met for goal in goals] == [False, True, True, True, True, False, False, False]
    assert all("fast" in goal.name for goal in goals[:5])
    assert bench_legs.judge(records[:3]) == []


def test_a_peer_without_its_python_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setattr(race, "CACHE", tmp_path)
    with pytest.raises(Unavailable, match=r"Python 3\.0"):
        environment(Contender("old", "peer_old", package="no-such-package", pythons=("3.0",)))
