"""Lower bounds of the objective: no flight costs less in any term, or the search would discard the best route."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly, make_interp_spline

from gcs.errors import UsageError
from gcs.plan.nlp.mesh_refinement import Optimum, optimise
from gcs.plan.ocp.objective_sum import least_cost, lower_bound, refuse_false_bounds, term_cost, weighted
from gcs.plan.ocp.objectives import TERMS, least_energy
from gcs.plan.ocp.problem import Flights, ObjectiveTerm, Problem, Share, flight_problem
from gcs.plan.search.free_final_time import with_free_time
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import SHRINK, auto, fleet
from tests.unit.plan.problems import alone, meadow
from tests.unit.plan.route_flights import CORNER, FAR, first_guess, flight_through

PROBLEMS: dict[str, Callable[[Scenario], Problem]] = {
    "given time": lambda s: flight_problem(meadow(alone(s))),
    "free time": lambda s: with_free_time(
        flight_problem(meadow(alone(s), time={"flight_s": 20.0, "free": True}, objective={"time_weight": 0.7}))
    ),
    "wind": lambda s: flight_problem(meadow(alone(s), wind={"speed_mps": 1.0, "from_deg": 200.0})),
    "route": lambda s: first_guess(flight_through(s, CORNER, FAR))[0],
    "moving shape": lambda s: flight_problem(
        fleet(s, 3, "row", (auto(SHRINK),), formation={"frame": "course"}, time={"flight_s": 40.0})
    ),
}


def by_name(term: ObjectiveTerm) -> str:
    return term.name


def assert_bound_holds(problem: Problem, term: ObjectiveTerm, trajectory: Trajectory) -> None:
    cost, bound = term_cost(problem, term, trajectory), lower_bound(problem, term, trajectory)
    assert bound <= cost + 1e-9 * max(abs(cost), 1.0), f"{term.name}: bound {bound:.9g}, cost {cost:.9g}"


def counts_in(problem: Problem, term: ObjectiveTerm) -> bool:
    return any(row is term for row, _ in weighted(problem))


@cache
def optimised(name: str, scenario: str) -> tuple[Problem, Optimum]:
    problem = PROBLEMS[name](Scenario.model_validate_json(scenario))
    return problem, optimise(problem, along(problem, straight_route(problem)))


@st.composite
def trajectories(draw: st.DrawFn, chains: int) -> Trajectory:
    """Cubic splines through random points in random time, with the speeds that belong to the positions."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    duration_s, reach_m = draw(st.floats(5.0, 200.0)), draw(st.floats(0.1, 300.0))
    times = np.linspace(0.0, duration_s, draw(st.integers(4, 12)))
    width = 12 + 4 * chains
    values = rng.normal(size=(len(times), width)) * ([reach_m] * 3 + [1.0] * (width - 3))
    splines = [PPoly.from_spline(make_interp_spline(times, values[:, column])) for column in range(width)]
    kept = slice(3, -3)  # the spline's repeated knots
    state = np.stack([spline.c[:, kept] for spline in splines], axis=-1)
    state[0, :, 3:6] = 0.0
    state[1:, :, 3:6] = state[:-1, :, :3] * np.array([3.0, 2.0, 1.0])[:, None, None]
    joints = splines[0].x[3:-3]
    return Trajectory(PPoly(state, joints), PPoly(np.zeros((1, len(joints) - 1, 4 + chains)), joints))


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("term", TERMS, ids=by_name)
@settings(max_examples=5, deadline=None)
@given(data=st.data())
def test_no_trajectory_costs_less_than_the_bound_of_any_term(
    simulation1: Scenario, name: str, term: ObjectiveTerm, data: st.DataObject
) -> None:
    problem = PROBLEMS[name](simulation1)
    if counts_in(problem, term):
        assert_bound_holds(problem, term, data.draw(trajectories(len(problem.coordinates))))


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("term", TERMS, ids=by_name)
def test_no_optimised_flight_costs_less_than_the_bound_of_any_term(
    simulation1: Scenario, name: str, term: ObjectiveTerm
) -> None:
    problem, optimum = optimised(name, simulation1.model_dump_json())
    if counts_in(problem, term):
        assert_bound_holds(problem, term, optimum.trajectory)


def test_every_term_counts_in_one_of_the_problems(simulation1: Scenario) -> None:
    problems = [make(simulation1) for make in PROBLEMS.values()]
    for term in TERMS:
        assert any(counts_in(problem, term) for problem in problems), term.name


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_terms_add_up_to_the_cost_of_the_optimised_flight(simulation1: Scenario, name: str) -> None:
    problem, optimum = optimised(name, simulation1.model_dump_json())
    total = sum(weight * term_cost(problem, term, optimum.trajectory) for term, weight in weighted(problem))
    assert total == pytest.approx(optimum.objective, rel=0.02)  # the program weighs fewer instants


@settings(max_examples=20, deadline=None)
@given(length_m=st.floats(30.0, 200.0), share=st.floats(0.0, 1.0))
def test_the_bound_of_a_free_time_holds_at_every_time(simulation1: Scenario, length_m: float, share: float) -> None:
    problem = PROBLEMS["free time"](simulation1)
    assert problem.free_time is not None
    earliest_s, latest_s = problem.free_time.earliest_s, problem.free_time.latest_s
    exactly = np.array([earliest_s + share * (latest_s - earliest_s)])
    flights = Flights(length_m, exactly, exactly)
    bounds = [weight * term.lower_bound(problem, flights, term.scale(problem)) for term, weight in weighted(problem)]
    assert least_cost(problem, length_m) <= float(np.sum(sum(bounds, start=np.zeros(1)))) + 1e-12


def too_high(problem: Problem, flights: Flights, scale: float) -> Any:
    return 2.0 * least_energy(problem, flights, scale)


def test_a_bound_that_is_too_high_fails_and_is_refused(simulation1: Scenario) -> None:
    problem, optimum = optimised("given time", simulation1.model_dump_json())
    term = replace(TERMS[0], name="twice", lower_bound=too_high)
    with pytest.raises(AssertionError, match="twice: bound"):
        assert_bound_holds(problem, term, optimum.trajectory)
    with pytest.raises(UsageError, match=r'lower bound of objective "twice" is [\d.]+, but an optimised flight costs'):
        refuse_false_bounds(replace(problem, extra_objectives=(term,)), optimum.trajectory)


def test_a_negative_weight_is_refused(simulation1: Scenario) -> None:
    problem, optimum = optimised("given time", simulation1.model_dump_json())
    term = replace(TERMS[0], name="energy as a gain", weight=lambda _: -1.0)
    with pytest.raises(UsageError, match='weight of objective "energy as a gain" is -1; it must be 0 or more'):
        refuse_false_bounds(replace(problem, extra_objectives=(term,)), optimum.trajectory)


def test_time_is_the_only_cost_of_duration() -> None:
    assert [term.name for term in TERMS if term.share is Share.DURATION] == ["time of flight"]
