"""A formation that turns with its course: its guess faces where it flies, and no side is searched twice."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import PlanningError
from gcs.plan.nlp.mesh_refinement import Optimum
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search import homotopy_classes
from gcs.plan.search.homotopy_classes import best_class, is_spare, only_turns
from gcs.plan.search.initial_guess import along, facing_along, straight_route
from gcs.plan.search.routes import Route, every_route
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import SHRINK, auto, fleet

ZONE = {"north_m": 40.0, "east_m": 0.5, "radius_m": 6.0}


@pytest.fixture
def problem(simulation1: Scenario) -> Problem:
    return flight_problem(
        fleet(
            simulation1,
            5,
            "row",
            formation={"frame": "course"},
            no_fly=[ZONE],
            end={"position_m": [80.0, 0.0, 5.0]},
            limits={"north_m": [-30.0, 110.0], "east_m": [-60.0, 60.0]},
            time={"flight_s": 60.0},
        )
    )


def test_the_guess_faces_along_the_course_and_rests_at_both_ends(problem: Problem) -> None:
    guess = along(problem, every_route(problem)[0])
    laid = facing_along(problem, guess.vehicle, guess)
    times = np.linspace(problem.start_s, problem.end_s, 301)
    states = laid.state(times)
    np.testing.assert_allclose(states[:, :12], guess.state(times)[:, :12], atol=0.05)
    course = np.arctan2(states[:, 4], states[:, 3]) - problem.course_at_start_rad
    away = np.angle(np.exp(1j * (course - states[:, 12])))
    cruise = (times > 15.0) & (times < 45.0)
    assert np.degrees(np.abs(away[cruise])).max() < 15.0
    assert np.degrees(np.ptp(states[:, 12])) > 10.0  # it turns
    np.testing.assert_allclose(states[0, 12:16], 0.0, atol=1e-3)
    np.testing.assert_allclose(states[-1, 13:16], 0.0, atol=1e-3)
    rate = np.gradient(states[:, 12], times)
    np.testing.assert_allclose(states[5:-5, 13], rate[5:-5], atol=2e-3)


def test_each_side_is_optimised_once(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """A route with room for every heading is needed only where a shorter one on its side fails."""
    routes = every_route(problem)
    spare = [is_spare(problem, routes, n) for n in range(len(routes))]
    assert len({route.sides for route in routes}) == spare.count(False) == 2
    assert True in spare
    flown: list[int] = []
    optimum = Optimum(along(problem, straight_route(problem)), problem.shape, 5.0, ())

    def optimised(problem: Problem, route: Route, on_round: object) -> Optimum:
        flown.append(next(n for n, known in enumerate(routes) if known is route))
        if flown[-1] == 0:
            raise PlanningError("no plan: this one fails", hint="")
        return optimum

    monkeypatch.setattr(homotopy_classes, "every_route", lambda _: routes)
    monkeypatch.setattr(homotopy_classes, "_optimised", optimised)
    _, alternatives = best_class(problem, lambda _: None)
    second = [n for n, route in enumerate(routes) if route.sides == routes[0].sides][1]
    assert flown == [n for n in range(len(routes)) if not spare[n] or n == second]
    skipped = [a.verdict == "passes on the same sides as a shorter route" for a in alternatives]
    assert skipped == [n not in flown for n in range(len(routes))]
    flown.clear()
    best_class(problem, lambda _: None, all_routes=True)
    assert flown == list(range(len(routes)))


def test_a_formation_that_may_shrink_tries_both_ways_on_one_side(simulation1: Scenario) -> None:
    may_shrink = flight_problem(fleet(simulation1, 5, "row", (auto(SHRINK),), formation={"frame": "course"}))
    assert not only_turns(may_shrink)
