"""Drawn lines: what is off them, how far by default, and what the scenario says of one leg or of all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.plan.trajectory.leg_lines import LegLimits, LegLine, leg_lines, remaining_lines
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import flight_through

KEPT = LegLimits(2.0, 1.0, 0.5)


def line(*to_ned_m: float, yaw_rad: float = 0.0) -> LegLine:
    return LegLine(1, np.array([10.0, 20.0, -5.0]), np.array([10.0, 20.0, -5.0]) + to_ned_m, yaw_rad, KEPT)


def state(north_m: float, east_m: float, down_m: float, yaw_rad: float = 0.0) -> np.ndarray:
    at = np.zeros(12)
    at[:3], at[8] = np.add([10.0, 20.0, -5.0], [north_m, east_m, down_m]), yaw_rad
    return at


@pytest.mark.parametrize(
    ("to_ned_m", "place", "expected"),
    [
        ((30.0, 0.0, 0.0), (15.0, 2.0, -0.5), (2.0, 0.5)),
        ((30.0, 40.0, -10.0), (15.0, 20.0, -5.0), (0.0, 0.0)),  # half way along and half way up
        ((30.0, 40.0, -10.0), (15.0 - 0.8, 20.0 + 0.6, -6.0), (1.0, 1.0)),  # 1 m to one side, 1 m too high
        ((0.0, 0.0, -20.0), (0.6, 0.8, -7.0), (1.0, 0.0)),  # straight up: any height is on the line
        ((2.0, 0.0, -20.0), (1.0, 0.5, -10.0), (0.5, 0.0)),  # steep: beside it at the same height
    ],
)
def test_what_is_off_a_line(
    to_ned_m: tuple[float, ...], place: tuple[float, float, float], expected: tuple[float, float]
) -> None:
    beside_m, above_m, _ = line(*to_ned_m).off(state(*place))
    np.testing.assert_allclose([beside_m, above_m], expected, atol=1e-12)


def test_the_scaled_rows_are_one_at_the_limits() -> None:
    drawn = line(30.0, 40.0, -10.0, yaw_rad=1.0)
    at = state(15.0 - 1.6, 20.0 + 1.2, -6.0, yaw_rad=1.5)
    off = drawn.scaled_rows @ (np.append(at[:3], at[8]) - drawn.begin)
    np.testing.assert_allclose(np.abs(off), [2.0 / 2.0, 0.0, 1.0, 1.0], atol=1e-12)


def test_by_default_the_corridor_is_what_the_corner_needs(simulation1: Scenario) -> None:
    """At 4 m/s and 2 m/s^2 a right angle needs R (1 - cos 45 degrees) = 2.34 m: with ease and rest 4.1 m."""
    sharp: dict[str, Any] = {"position_m": [60.0, 20.0, 5.0], "speed_mps": 4.0}
    limits, end = {"accel_max_mps2": 2.0}, {"position_m": [60.0, 60.0, 5.0]}
    first, second = leg_lines(flight_through(simulation1, sharp, limits=limits, end=end))
    assert first.limits.corridor_m == second.limits.corridor_m == pytest.approx(4.1)
    assert first.limits.height_m == 1.0
    stop = {"position_m": [60.0, 20.0, 5.0], "hold_s": 2.0}  # there it turns on the spot
    assert leg_lines(flight_through(simulation1, stop, limits=limits, end=end))[0].limits.corridor_m == 1.0
    near = {**sharp, "radius_m": 7.0}  # the leader may pass as far from the point
    assert leg_lines(flight_through(simulation1, near, limits=limits, end=end))[0].limits.corridor_m == 7.0


def test_a_point_says_more_than_the_table_and_that_more_than_the_default(simulation1: Scenario) -> None:
    route = (
        {"position_m": [60.0, 20.0, 5.0], "corridor_m": 0.4, "height_tolerance_m": "free"},
        {"position_m": [60.0, 60.0, 5.0]},
    )
    legs = {"corridor_m": "free", "height_tolerance_m": 0.2}
    own, table, last = leg_lines(flight_through(simulation1, *route, legs=legs))
    assert (own.limits.corridor_m, own.limits.height_m) == (0.4, np.inf)
    assert table.limits == last.limits == LegLimits(np.inf, 0.2, table.limits.yaw_rad)
    assert own.set_by_scenario == table.set_by_scenario == (True, True)
    assert own.opened(beside=True, above=True).limits == own.limits  # what is said stays


def test_the_yaw_is_kept_between_two_equal_headings(simulation1: Scenario) -> None:
    route = [
        {"position_m": [60.0, 20.0, 5.0], "heading_deg": 370.0},
        {"position_m": [60.0, 60.0, 5.0], "heading_deg": 10.0},
    ]
    start, between, end = leg_lines(flight_through(simulation1, *route))
    assert np.isinf([start.limits.yaw_rad, end.limits.yaw_rad]).all()
    assert between.limits.yaw_rad == pytest.approx(np.radians(5.0))
    assert between.yaw_ned_rad == pytest.approx(np.radians(10.0))


def test_who_begins_in_the_air_flies_the_first_leg_freely(simulation1: Scenario) -> None:
    route = {"position_m": [60.0, 20.0, 5.0]}, {"position_m": [60.0, 60.0, 5.0]}
    every = leg_lines(flight_through(simulation1, *route, legs={"corridor_m": 0.5}))
    first, last = remaining_lines(every, 2)
    assert first.limits.is_free
    assert first.within(KEPT).limits.corridor_m == 2.0
    assert last == every[-1]
