"""First times at the points: inside every window, else at one speed; and the leg that has too little time, by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gcs.errors import Infeasible
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.search.initial_guess import straight_route
from gcs.plan.search.leg_guess import check_legs, first_times, least_legs_s, on_time
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import CORNER, FAR, flight_through

# Legs of 50 m, 40 m and 50 m, each along one axis; at 5 m/s they need 10 s, 8 s and 10 s.


@pytest.fixture(scope="module")
def bare(simulation1: Scenario) -> Problem:
    return flight_problem(flight_through(simulation1, CORNER, FAR))


@pytest.fixture(scope="module")
def held(simulation1: Scenario) -> Problem:
    return flight_problem(flight_through(simulation1, {**CORNER, "hold_s": 6.0}, FAR))


def windowed(problem: Problem, *windows: tuple[float, float]) -> Problem:
    """The problem with an earliest and a latest time at each point."""
    points = tuple(
        replace(point, earliest_s=low, latest_s=high)
        for point, (low, high) in zip(problem.points, windows, strict=True)
    )
    return replace(problem, points=points)


def test_without_windows_every_leg_has_one_speed_but_for_its_stops(bare: Problem) -> None:
    first_s, second_s = first_times(bare, np.array([50.0, 40.0, 50.0]))
    assert first_s == pytest.approx(60.0 - second_s)  # two equal legs, each with one end at rest
    speed_mps = 140.0 / 60.0
    wanted_s = np.array([50.0 / speed_mps + 2.0, 40.0 / speed_mps, 50.0 / speed_mps + 2.0])
    np.testing.assert_allclose([first_s, second_s], np.cumsum(wanted_s * 60.0 / wanted_s.sum())[:2])


def test_a_hold_takes_its_time_between_two_legs(held: Problem) -> None:
    first_s, second_s = first_times(held, np.array([50.0, 40.0, 50.0]))
    legs_s = [b - a for a, b in replace(held, point_s=(first_s, second_s)).legs_s]
    assert sum(legs_s) == pytest.approx(54.0)
    # Legs of 50 m with two stops and with one differ by the time of a stop alone.
    assert legs_s[0] - legs_s[2] == pytest.approx(2.0 * sum(legs_s) / (54.0 + 4 * 2.0))
    assert least_legs_s(held) == pytest.approx(10.0 + 8.0 + 10.0 + 6.0)


def test_ends_at_rest_take_the_time_of_their_acceleration(held: Problem) -> None:
    limits = held.scenario.limits.model_copy(update={"accel_max_mps2": 2.0})
    slow = replace(held, scenario=held.scenario.model_copy(update={"limits": limits}))
    # 5 m/s at 2 m/s2: 2.5 s more for two ends at rest, 1.25 s for one; the last leg ends at rest, the second begins so.
    assert least_legs_s(slow) == pytest.approx(12.5 + 9.25 + 11.25 + 6.0)
    gentle = held.scenario.limits.model_copy(update={"accel_max_mps2": 0.1})
    creeping = replace(held, scenario=held.scenario.model_copy(update={"limits": gentle}))
    # Never at 5 m/s: half the way is accelerated, half braked; with one end at rest all of it is one ramp.
    least_s = 2.0 * np.sqrt(50.0 / 0.1) + np.sqrt(2.0 * 40.0 / 0.1) + np.sqrt(2.0 * 50.0 / 0.1)
    assert least_legs_s(creeping) == pytest.approx(least_s + 6.0)
    with pytest.raises(Infeasible, match=r"leg 1 \(start to point 1\) needs 12.5 s at 5 m/s \S+ and 2 m/s2"):
        check_legs(windowed(slow, (-np.inf, 12.0), (-np.inf, np.inf)))


@settings(deadline=None)
@given(st.data())
def test_first_times_keep_every_window_that_can_be_kept(held: Problem, data: st.DataObject) -> None:
    """Windows around some flight that keeps the speed limits; so there is one."""
    spare = data.draw(st.lists(st.floats(0.0, 10.0), min_size=3, max_size=3).filter(lambda s: sum(s) > 0.1))
    legs_s = np.array([10.0, 8.0, 10.0]) + np.array(spare) * 26.0 / sum(spare)
    arrivals_s = np.array([legs_s[0], legs_s[0] + 6.0 + legs_s[1]])
    windows = []
    for arrival_s in arrivals_s:
        before, after = (data.draw(st.one_of(st.floats(0.0, 15.0), st.just(np.inf))) for _ in range(2))
        windows.append((arrival_s - before, arrival_s + after))
    found = windowed(held, *windows)
    times_s = first_times(found, np.array([50.0, 40.0, 50.0]))
    for time_s, (low_s, high_s) in zip(times_s, windows, strict=True):
        assert low_s - 1e-6 <= time_s <= high_s + 1e-6
    for (start_s, end_s), least_s in zip(replace(found, point_s=times_s).legs_s, (10.0, 8.0, 10.0), strict=True):
        assert end_s - start_s >= least_s - 1e-6


@settings(deadline=None)
@given(st.floats(9.0, 30.0), st.floats(9.0, 50.0))
def test_what_is_refused_is_exactly_what_the_speed_limits_cannot_fly(
    bare: Problem, first: float, second: float
) -> None:
    assume(min(abs(first - 10.0), abs(second - max(first, 10.0) - 8.0), abs(second - 50.0)) > 1e-3)
    flyable = first > 10.0 and second > first + 8.0 and second < 50.0
    tight = windowed(bare, (first, first), (second, second))
    if flyable:
        check_legs(tight)
        assert first_times(tight, np.array([50.0, 40.0, 50.0])) == pytest.approx((first, second))
    else:
        with pytest.raises(Infeasible, match=r"leg [123] "):
            check_legs(tight)


def test_a_leg_with_too_little_time_is_told_with_its_numbers(simulation1: Scenario) -> None:
    points = [{"position_m": [10.0, east_m, 5.0]} for east_m in (-20.0, 20.0, -20.0)]
    points.append({"position_m": [10.0, 135.0, 5.0], "by_s": 48.0, "name": "gate"})
    scenario = flight_through(simulation1, *points, time={"flight_s": 90.0})
    with pytest.raises(Infeasible) as told:
        check_legs(flight_problem(scenario))
    assert told.value.message == (
        'no plan: leg 4 (point 3 to point 4 ("gate")) needs 31 s at 5 m/s east, by_s of point 4 ("gate") leaves 24 s'
    )
    assert told.value.hint == 'set by_s of point 4 ("gate") to 56.6 or more, or raise [limits] speed_ned_mps'


def test_the_time_of_flight_is_what_the_last_leg_has(bare: Problem) -> None:
    with pytest.raises(Infeasible) as told:
        check_legs(windowed(bare, (45.0, 55.0), (-np.inf, np.inf)))
    assert told.value.message == (
        "no plan: leg 3 (point 2 to end) needs 10 s at 5 m/s north, [time] flight_s leaves 7 s"
    )
    assert told.value.hint == "set [time] flight_s to 63.5 or more, or raise [limits] speed_ned_mps"


def test_a_point_that_is_passed_by_shortens_both_of_its_legs(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, {**CORNER, "radius_m": 5.0}, FAR))
    assert least_legs_s(problem) == pytest.approx(9.0 + 7.0 + 10.0)


def test_times_follow_the_length_of_the_route(bare: Problem) -> None:
    timed = on_time(bare, straight_route(bare))
    assert timed.point_s == first_times(bare, np.array([50.0, 40.0, 50.0]))
    assert timed.leg_at(1.0) == "leg 1 (start to point 1)"
    assert timed.leg_at(30.0) == "leg 2 (point 1 to point 2)"
    assert timed.leg_at(59.0) == "leg 3 (point 2 to end)"
