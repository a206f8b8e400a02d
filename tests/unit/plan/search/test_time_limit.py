"""The time limit of planning holds for all routes together, within a solve too; what was found in time is kept."""

from __future__ import annotations

import math
from itertools import count

import pytest

import gcs
from gcs.errors import OutOfTime
from gcs.plan.nlp import ipopt
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.planner import make_plan
from gcs.plan.search import homotopy_classes
from gcs.plan.search.homotopy_classes import best_class
from gcs.plan.search.routes import survey
from gcs.scenario.schema.scenario import Scenario
from gcs.util.long_work import left_s, report, within
from tests.unit.plan.problems import alone, meadow
from tests.unit.plan.search.test_routes import DISK, beyond


def test_a_plan_without_time_is_refused_in_a_sentence_that_names_the_option(simulation1: Scenario) -> None:
    with pytest.raises(gcs.OutOfTime, match="no plan: the time limit has passed, while ") as late:
        gcs.make_plan(meadow(alone(simulation1)), limit_s=0.0)
    assert "--limit" in str(late.value.hint)
    assert left_s() == math.inf
    report("nobody waits any longer")


def test_a_solve_ends_at_the_iteration_in_which_the_time_is_over(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = count()
    monkeypatch.setattr(ipopt, "left_s", lambda: 2.5 - next(calls))
    with pytest.raises(OutOfTime, match="while solving, after 4 iterations"):
        make_plan(meadow(alone(simulation1)))


def test_the_map_of_a_route_ends_in_time_too(simulation1: Scenario) -> None:
    """For a formation that turns, it takes as long as the first solves."""
    problem = flight_problem(beyond(simulation1, no_fly=[{**DISK, "east_m": 44.0}]))
    with within(-1.0), pytest.raises(OutOfTime, match="while mapping the room of every vehicle"):
        survey(problem)


def test_an_inner_limit_cannot_give_more_time() -> None:
    with within(1.0), within(100.0):
        assert left_s() <= 1.0


def test_the_best_route_that_was_found_in_time_is_kept(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = flight_problem(beyond(simulation1, no_fly=[{**DISK, "east_m": 44.0}]))
    planned, tries = homotopy_classes._optimised, count()

    def first_only(*task: object) -> object:
        if next(tries):
            raise OutOfTime.because("solving")
        return planned(*task)  # type: ignore[arg-type]

    monkeypatch.setattr(homotopy_classes, "_optimised", first_only)
    best, ways = best_class(problem, lambda _: None, all_routes=True)
    assert len(ways) > 1 and ways[0].objective == best.objective
    assert all("the time limit" in way.verdict and way.objective is None for way in ways[1:])
