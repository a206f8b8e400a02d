"""Rows that bound the times at points and at the end, by the durations of the legs before them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gcs.plan.formation.timeline import made_changes
from gcs.plan.nlp.route_phases import LegTimes, first_mesh, leg_times
from gcs.plan.ocp.problem import FreeTime, Problem, flight_problem
from gcs.plan.trajectory.constraint_id import ConstraintId
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import alone, meadow
from tests.unit.plan.route_flights import CORNER, FAR, flight_through

POINT_S = 25.0, 45.0


def texts(rows: tuple[tuple[ConstraintId, float], ...]) -> tuple[tuple[str, float], ...]:
    return tuple((str(constraint), t_s) for constraint, t_s in rows)


def timed(scenario: Scenario, start_s: float = 10.0, **changes: Any) -> tuple[Problem, LegTimes]:
    """From 10 to 60 s, 4 s of them on hold at the first point: legs of 15, 16 and 15 s."""
    flight = flight_through(scenario, {**CORNER, "hold_s": 4.0, "by_s": 30.0}, {**FAR, "after_s": 40.0, "name": "gate"})
    problem = replace(flight_problem(flight), start_s=start_s, end_s=60.0, point_s=POINT_S, **changes)
    legs = leg_times(problem, first_mesh(problem, 9.0, 6.0, 2))
    assert legs is not None
    return problem, legs


def test_times_at_points_count_the_legs_before_them_and_not_the_holds(simulation1: Scenario) -> None:
    _, legs = timed(simulation1)
    share = np.array([15.0, 16.0, 15.0]) / 50.0
    np.testing.assert_allclose(legs.rows, np.tril(np.ones((3, 3))) * share)
    # No later than 20 s after the start; no earlier than 30 s after it, less the hold; and at the end after 46 s.
    np.testing.assert_allclose(legs.rows_low, [-np.inf, (30.0 - 4.0) / 50.0, 46.0 / 50.0])
    np.testing.assert_allclose(legs.rows_high, [20.0 / 50.0, np.inf, 46.0 / 50.0])
    assert texts(legs.row_ids) == (
        ("time of point 1", 25.0),
        ('time of point 2 ("gate")', 45.0),
        ("time of flight", 60.0),
    )
    np.testing.assert_allclose(legs.rows @ np.ones(3), np.array([15.0, 31.0, 46.0]) / 50.0)
    assert (legs.low.tolist(), legs.high.tolist()) == ([0.05] * 3, [20.0] * 3)
    assert tuple(map(str, legs.ids)) == tuple(f"limit of the duration of leg {leg}" for leg in (1, 2, 3))


def test_a_free_end_has_both_its_bounds(simulation1: Scenario) -> None:
    _, legs = timed(simulation1, free_time=FreeTime(40.0, 90.0, 1.0, 50.0))
    np.testing.assert_allclose([legs.rows_low[-1], legs.rows_high[-1]], [36.0 / 50.0, 86.0 / 50.0])


def test_a_point_without_a_time_has_no_row(simulation1: Scenario) -> None:
    flight = flight_through(simulation1, CORNER, {**FAR, "at_s": 44.0})
    problem = replace(flight_problem(flight), point_s=POINT_S)
    legs = leg_times(problem, first_mesh(problem, 9.0, 6.0, 2))
    assert legs is not None
    assert [name for name, _ in texts(legs.row_ids)] == ["time of point 2", "time of flight"]
    assert legs.rows_low[0] == legs.rows_high[0] == 44.0 / 60.0


def test_one_leg_is_stretched_where_its_time_is_free(simulation1: Scenario) -> None:
    problem = flight_problem(meadow(alone(simulation1)))
    mesh = first_mesh(problem, 9.0, 1.0, 5)
    assert leg_times(problem, mesh) is None
    legs = leg_times(replace(problem, free_time=FreeTime(15.0, 50.0, 1.0, 20.0)), mesh)
    assert legs is not None
    assert (legs.low.tolist(), legs.high.tolist()) == ([0.75], [2.5])
    assert (*map(str, legs.ids), legs.rows.shape, legs.row_ids) == ("limit of the time of flight", (0, 1), ())
    assert legs.rows_low.size == legs.rows_high.size == 0


def test_the_legs_between_two_changes_last_as_long_as_the_first_one_takes(simulation1: Scenario) -> None:
    """Else the flight would be optimal, and its second change begin before the first has ended."""
    shapes = [
        {"name": "line", "generator": "line", "spacing_m": 6.0},
        {"name": "column", "generator": "column", "spacing_m": 6.0},
    ]
    formation = {"vehicle": [], "count": 3, "start_shape": "line", "shape": shapes}
    route = {**CORNER, "shape": "column", "hold_s": 4.0}, {**FAR, "shape": "line"}
    flight = flight_through(simulation1, *route, formation=formation)
    problem = replace(flight_problem(flight), point_s=POINT_S)
    legs = leg_times(problem, first_mesh(problem, 9.0, 6.0, 2))
    assert legs is not None
    takes_s = [made.duration_s for made in made_changes(flight)]
    assert takes_s[0] > 5.0
    between, last = legs.rows_low[-2:] * problem.duration_s
    np.testing.assert_allclose([between + 4.0, last], np.add(takes_s, 0.02))  # the hold counts too
    np.testing.assert_allclose(legs.rows[-2:] @ np.ones(3) * problem.duration_s, [45.0 - 29.0, 60.0 - 45.0])
    assert [name for name, _ in texts(legs.row_ids)][-1] == "time that change 2 of the shape takes"
