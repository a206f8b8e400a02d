"""Where a flight along drawn lines fails, the lines near the failure give way first, then all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gcs.errors import PlanningError
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search import homotopy_classes
from gcs.plan.search.initial_guess import straight_route
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import with_keys


@pytest.fixture(scope="module")
def problem(simulation1: Scenario) -> Problem:
    drawn = with_keys(
        simulation1,
        no_fly=(),
        route=[{"position_m": [20.0 * n, 8.0 + 4.0 * (n % 2), 15.0]} for n in range(1, 6)],
        legs={"corridor_m": None, "height_tolerance_m": None},
    )
    return flight_problem(drawn)


@pytest.mark.parametrize(
    ("legs", "fails", "opened"),
    [
        ((3,), 1, [[], [2, 3, 4]]),
        ((3,), 2, [[], [2, 3, 4], [0, 1, 2, 3, 4, 5]]),
        ((), 1, [[], [0, 1, 2, 3, 4, 5]]),  # the solver does not say where
        ((0, 5), 1, [[], [0, 1, 4, 5]]),
    ],
)
def test_the_legs_near_a_failure_give_way_first(
    problem: Problem, legs: tuple[int, ...], fails: int, opened: list[list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[list[int]] = []

    def optimised(one: Problem, *_: Any) -> str:
        tried.append([n for n, line in enumerate(one.lines) if np.isinf(line.limits.corridor_m)])
        if len(tried) <= fails:
            raise PlanningError.because("a test", hint="none", legs=legs)
        return "found"

    unchanged: Callable[..., Problem] = lambda one, *_: one  # noqa: E731
    monkeypatch.setattr(homotopy_classes, "optimise_on_schedule", optimised)
    monkeypatch.setattr(homotopy_classes, "on_time", unchanged)
    monkeypatch.setattr(homotopy_classes, "along", lambda *_: None)
    monkeypatch.setattr(homotopy_classes, "open_where_blocked", unchanged)
    found: Any = homotopy_classes._optimised(problem, straight_route(problem), lambda _: None)
    assert found == "found"
    assert tried == opened
