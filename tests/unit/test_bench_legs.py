"""The benchmark's legs are the planner's legs: points, durations, mesh and guess; its goals count what they say."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.nlp.mesh import Mesh
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.routes import Route
from tools.bench.describe_route import POINTS, route_guess, route_mesh, route_numbers, route_problem
from tools.bench.findings import Findings
from tools.bench.race import Contender, Record
from tools.bench.route import Legs
from tools.bench.route_goals import LEADER, SAME_FORM, SIX, judge_legs


@pytest.fixture(scope="module")
def described() -> tuple[Problem, Route, Mesh]:
    problem, route = route_problem()
    return problem, route, route_mesh(problem)


@pytest.fixture(scope="module")
def legs(described: tuple[Problem, Route, Mesh]) -> Legs:
    return Legs(route_numbers(*described))


def test_legs_are_joined_at_the_points(described: tuple[Problem, Route, Mesh], legs: Legs) -> None:
    problem, _, mesh = described
    assert legs.count == POINTS + 1 == len(problem.legs_s)
    assert legs.ends_s.tolist() == [0.0, *problem.point_s, problem.end_s]
    assert [degree for leg in range(legs.count) for degree in legs.degrees_of(leg)] == list(mesh.degrees)
    assert legs.joints_of(legs.ends_s) == pytest.approx(mesh.joints_s.tolist(), abs=1e-9)
    for leg, point in enumerate(problem.points):
        for low, high in (legs.box_of(leg, end=True), legs.box_of(leg + 1, end=False)):
            np.testing.assert_allclose(low[:3] * legs.state_unit[:3], point.place_ned_m)
            np.testing.assert_array_equal(low[:3], high[:3])
            assert np.all(low[3:] < high[3:])
    for state, (low, high) in (
        (problem.start_state, legs.box_of(0, end=False)),
        (problem.end_state, legs.box_of(POINTS, end=True)),
    ):
        np.testing.assert_allclose(low * legs.state_unit, state)
        np.testing.assert_array_equal(low, high)


def test_joints_follow_the_durations_of_legs(legs: Legs) -> None:
    ends_s = legs.ends_s + np.array([0.0, 1.0, -2.0, 0.5, 0.0, 3.0, 0.0])
    joints = np.array(legs.joints_of(ends_s))
    for leg, own in enumerate(legs.intervals):
        assert (joints[own[0]], joints[own[-1] + 1]) == pytest.approx((ends_s[leg], ends_s[leg + 1]))
        np.testing.assert_allclose(
            np.diff(joints)[own] / np.diff(legs.joints_s)[own],
            (ends_s[leg + 1] - ends_s[leg]) / (legs.ends_s[leg + 1] - legs.ends_s[leg]),
        )


def test_the_guess_of_each_leg_is_skeins(described: tuple[Problem, Route, Mesh], legs: Legs) -> None:
    problem, route, _ = described
    guess = route_guess(problem, route)
    for leg in range(legs.count):
        times_s, x, u = legs.guess_of(leg)
        low, high = legs.duration_of(leg)
        assert low < times_s[-1] - times_s[0] < high
        # At the very end the polynomials of the guess are those of its last interval.
        np.testing.assert_allclose(x * legs.state_unit, guess.state(times_s), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            u * legs.control_unit + legs.control_shift, guess.control(times_s), rtol=1e-9, atol=1e-9
        )


def test_cost_is_the_planners_on_a_route(described: tuple[Problem, Route, Mesh], legs: Legs) -> None:
    problem = described[0]
    parts = stage_functions.functions(problem)
    random = np.random.default_rng(1)
    for t in np.linspace(0.0, problem.end_s, 10):
        x, u = legs.guess(t)
        x = x + 0.2 * random.normal(size=12)
        late = 1.0 / (problem.end_s - t + 0.5) / legs.numbers["late_integral"]
        rate = float(parts.cost(np.concatenate([x * legs.state_unit, u]), [1.0 / problem.mean_s, late]))
        assert legs.cost_rate(x, t, np) == pytest.approx(rate, rel=1e-12)


def record(name: str, points_s: list[float], **seconds: float) -> Record:
    peer = not name.startswith("skein")
    return Record(Contender(name, (), (), is_peer=peer), "", [{"points_s": points_s, **seconds}])


def test_goals_count_against_the_fastest_peer() -> None:
    records = [
        record(SIX, [10.0], cold_cpu_s=1.0, flight_cpu_s=2.0, verified_cpu_s=3.0),
        record(LEADER, [10.0], cold_cpu_s=0.5, flight_cpu_s=1.0, verified_cpu_s=1.5),
        record(SAME_FORM, [10.2], cold_cpu_s=0.5),
        record("slow", [10.3], cold_cpu_s=20.0),
        record("fast", [11.5], cold_cpu_s=2.0),
    ]
    objectives = dict(zip((id(r) for r in records), (0.9, 0.9, 0.8, 0.801, 0.84), strict=True))
    findings = {key: Findings(0.0, 0.0, "", 0.0, 0.0, 0.0, value) for key, value in objectives.items()}
    goals = judge_legs(records, findings)
    assert [goal.value for goal in goals] == pytest.approx([1.5, 0.75, 0.5, 0.25, 0.25, 0.05, 1.3, 1.5])
    assert [goal.met for goal in goals] == [False, True, True, True, True, False, False, False]
    assert all("fast" in goal.name for goal in goals[:5])
    assert judge_legs(records[:3], findings) == []
