"""Drawn lines: what is off them, how far by default, and what the scenario says of one leg or of all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.plan.trajectory.leg_lines import LegLimits, LegLine, leg_lines, remaining_lines
from gcs.scenario.environment.terrain import ground_envelope_m, ground_height_m
from gcs.scenario.schema.scenario import Mountains, Ripple, Scenario, Terrain
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
    np.testing.assert_allclose(np.abs(in_program(drawn, at)), [2.0 / 2.0, 0.0, 1.0, 1.0], atol=1e-12)


def in_program(drawn: LegLine, at: np.ndarray, ground_m: float = 0.0) -> np.ndarray:
    """What the program computes for one state, over a smooth ground of this height: kept where all are within 1."""
    begin, rows, follows = np.split(drawn.parameters, [4, 20])
    place = np.append(at[:3] + np.array([0.0, 0.0, follows[0] * ground_m]), at[8])
    return np.asarray(rows.reshape(4, 4, order="F") @ (place - begin))


HILL = Terrain(
    mountains=Mountains(
        north_m=(25.0, 40.0), east_m=(30.0, 55.0), height_m=(9.0, -4.0), spread_north_m=(20.0, 9.0),
        spread_east_m=(15.0, 8.0),
    )
)  # fmt: skip


def test_a_line_above_the_ground_is_its_height_above_every_place_below() -> None:
    begin, end = np.array([10.0, 20.0, 0.0]), np.array([40.0, 60.0, 0.0])
    for place, above_m in ((begin, 12.0), (end, 17.0)):
        place[2] = -ground_height_m(HILL, place[0], place[1]) - above_m
    drawn = LegLine(1, begin, end, 0.0, KEPT, ground=HILL)
    places = drawn.places(np.array([0.0, 0.3, 1.0]))
    np.testing.assert_allclose(places[[0, 2]], [begin, end], atol=1e-12)
    above_m = -places[:, 2] - ground_height_m(HILL, places[:, 0], places[:, 1])
    np.testing.assert_allclose(above_m, [12.0, 13.5, 17.0], atol=1e-12)
    states = np.zeros((3, 12))
    states[:, :3] = places + np.array([-0.48, 0.36, 0.0])  # 0.6 m beside, where the ground is another
    states[:, 2] = -ground_height_m(HILL, states[:, 0], states[:, 1]) - above_m - 0.7
    beside_m, off_m, _ = drawn.off(states)
    np.testing.assert_allclose(beside_m, 0.6, atol=1e-12)
    np.testing.assert_allclose(off_m, 0.7, atol=1e-12)


def test_the_program_keeps_within_the_limit_whatever_the_envelope_hides() -> None:
    """With a ripple the smooth ground is above the true one by up to its peak; both ends of that must be within."""
    ripple = Ripple(a=0.0, b=0.1, c=0.0, d=0.0, e=0.0, f=0.0, g=0.0)
    rippled = Terrain(ripple=ripple, mountains=HILL.mountains)
    begin, end = np.array([10.0, 20.0, -30.0]), np.array([40.0, 60.0, -35.0])
    drawn = LegLine(1, begin, end, 0.0, LegLimits(2.0, 3.0, 0.5), ground=rippled)
    assert 0.5 < drawn.envelope_gap_m < 1.2 and not drawn.is_too_rough
    assert LegLine(1, begin, end, 0.0, LegLimits(2.0, 0.5, 0.5), ground=rippled).is_too_rough
    for share in np.linspace(0.0, 1.0, 60):
        (place,) = drawn.places(np.array([share]))
        smooth_m = float(ground_envelope_m(rippled, place[0], place[1]))
        for off_m in np.linspace(-4.0, 4.0, 81):
            at = np.zeros(12)
            at[:3] = place + np.array([0.0, 0.0, off_m])
            if np.abs(in_program(drawn, at, smooth_m)).max() <= 1.0:
                assert abs(off_m) <= 3.0


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
