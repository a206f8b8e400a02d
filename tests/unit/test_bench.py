"""The benchmark's copy of the problem is the planner's problem; its findings see what is wrong with a solution."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gcs.physics.quadrotor import Array
from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.program.transcription import transcribe
from gcs.plan.nlp.variables import ControlForm
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.active_vehicles import LIFT
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.trajectory import Trajectory
from tools.bench import describe, findings
from tools.bench.environments import Peer, Unavailable, environment
from tools.bench.goals import Goal, judge
from tools.bench.leader import Leader
from tools.bench.race import Contender, Record


@pytest.fixture(scope="module")
def problem() -> Problem:
    return describe.leader_problem()


@pytest.fixture(scope="module")
def leader(problem: Problem) -> Leader:
    return Leader(describe.numbers(problem, describe.uniform(problem)))


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


def test_cost_is_the_planners(problem: Problem, leader: Leader) -> None:
    parts = stage_functions.functions(problem)
    times = np.linspace(0.0, problem.end_s, 20)
    for t, x, u in zip(times, *anywhere(leader, 20), strict=True):
        z = np.concatenate([x * leader.state_unit, u])
        late = 1.0 / (problem.end_s - t + 0.5) / leader.numbers["late_integral"]
        rate = float(parts.cost(z, [1.0 / problem.duration_s, late]))
        assert leader.cost_rate(x, t, np) == pytest.approx(rate, rel=1e-12)


def test_meshes_cover_the_flight(problem: Problem) -> None:
    meshes = [describe.uniform(problem), describe.refined_at_ends(problem), describe.converged(problem)]
    assert [mesh.intervals for mesh in meshes] == [15, 30, 220]
    for mesh in meshes:
        assert (mesh.joints_s[0], mesh.joints_s[-1]) == (problem.start_s, problem.end_s)


def rebuilt(flown: Trajectory) -> Trajectory:
    """Through points, as contenders hand theirs over."""
    result = {}
    for part, poly in (("state", flown.state), ("control", flown.control)):
        tau = np.linspace(0.1, 0.9, len(poly.c))
        spans = itertools.pairwise(flown.joints_s)
        result[part] = [poly(low + tau * (high - low)).tolist() for low, high in spans]
        result[f"{part}_tau"] = [tau.tolist()] * flown.intervals
    return findings.trajectory(result, flown.joints_s.tolist())


def test_findings_of_the_papers_own_control_form(problem: Problem) -> None:
    """Eq. 41 on 15 intervals: at peace with its nodes, out of its box and off by metres between them."""
    mesh = describe.uniform(problem)
    program = transcribe(problem, mesh, describe.straight(problem), ControlForm.LAGRANGE)
    solution = solve(program, program.scaled(describe.straight(problem)))
    flown = program.trajectory(solution.y)
    found = findings.look(problem, rebuilt(flown))
    assert not found.verified
    assert found.control > 0.5
    assert found.window_m > 1.0
    assert found.jump_m < 1e-6
    assert found.objective == pytest.approx(findings.cost(problem, flown), rel=1e-9)
    assert found.objective == pytest.approx(solution.objective, rel=0.02)
    at_nodes = flown.control(program.layout.node_times_s())
    np.testing.assert_allclose(at_nodes, np.clip(at_nodes, problem.control_low, problem.control_high), atol=1e-6)


def record(name: str, mesh: str, cold_s: float, solver_s: float, objective: float) -> Record:
    peer = name.startswith("yapss")
    runs = [{"cold_s": cold_s, "solver_s": solver_s, "objective": objective}] * 3
    return Record(Contender(name, (), (), is_peer=peer), mesh, runs)


def test_goals_count_against_the_peers_best() -> None:
    records = [
        record("skein, Eq. 41", "a", 0.1, 0.05, 0.8),
        record("yapss-lg", "a", 0.5, 0.2, 0.8),
        record("yapss-lg, monotone mu", "a", 0.25, 0.1, 0.80004),
    ]
    solver, cold, objective = judge(records, {}, None)
    assert [solver.value, cold.value] == pytest.approx([0.5, 0.4])
    assert [solver.met, cold.met] == [False, True]
    assert objective.met
    assert Goal("more is better", 31.0, 30.0, at_least=True).met


def test_a_peer_without_its_python_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setattr("tools.bench.environments.CACHE", tmp_path)
    with pytest.raises(Unavailable, match=r"Python 3\.0"):
        environment(Peer("old", "no-such-package", "peer_old", pythons=("3.0",)))
