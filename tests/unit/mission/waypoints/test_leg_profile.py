"""Due times, holds and speeds of legs, and the times at which a flight passes them, by numbers worked by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.autopilots.waypoint_models.predict import Prediction
from gcs.mission.machine_independent import ORDER_GRID
from gcs.mission.waypoints.leg_profile import SHARES, LegProfile, NavigatorLimits, leg_profile
from gcs.types import Array

THIRDS = np.array(SHARES)
LIMITS = NavigatorLimits(np.array([6.0, 6.0, 1.5]), slowest_mps=0.5, fastest_mps=8.0)


def northwards(t_s: Array, knots_s: list[float], north_m: list[float]) -> Array:
    """Places (M, 3), 10 m up, between knots at constant speeds."""
    north = np.interp(t_s, knots_s, north_m)
    return np.stack([north, 0.0 * north, 0.0 * north - 10.0], axis=1)


def near(values: object) -> Any:
    """To the grid of orders."""
    return pytest.approx(values, abs=0.6 * ORDER_GRID)


def test_shares_are_due_when_the_samples_pass_them_and_not_evenly() -> None:
    """From 5 s on: 30 m of which the last third takes longest, then 40 m at one speed up to 2 m before the end."""
    t_s = np.arange(5.0, 45.05, 0.1)
    places = northwards(t_s, [5.0, 10.0, 25.0, 45.0], [0.0, 20.0, 30.0, 70.0])
    made, legs = leg_profile(t_s, places, [0, 200, 400], LIMITS, 3.0)
    assert legs == [0, 1]
    np.testing.assert_allclose(made.points_ned_m[:, 0], [0.0, 30.0, 70.0], atol=ORDER_GRID)
    assert made.due_s[0].tolist() == near([2.5, 5.0, 20.0])
    # At the last waypoint a vehicle has arrived within 2 m, 1 s before the end.
    assert made.due_s[1].tolist() == near([20.0 + 20.0 / 3.0, 20.0 + 40.0 / 3.0, 39.0])
    assert made.holds_s.tolist() == [0.0, 0.0]
    assert (made.slowest_mps, made.airborne_s) == (0.5, 3.0)
    assert made.lengths_m.tolist() == near([30.0, 40.0])
    assert made.planned_mps.tolist() == pytest.approx([1.5, 40.0 / 19.0], rel=1e-3)
    assert np.array_equal(made.due_s, np.round(made.due_s / ORDER_GRID) * ORDER_GRID)


def test_a_hold_takes_the_place_of_legs_without_a_length() -> None:
    """20 m in 10 s, a rest of 10 s that two waypoints divide, and 20 m more in 20 s."""
    t_s = np.arange(2.0, 42.05, 0.1)
    places = northwards(t_s, [2.0, 12.0, 22.0, 42.0], [0.0, 20.0, 20.0, 40.0])
    waypoints = [0, 100, 140, 200, 400]
    made, legs = leg_profile(t_s, places, waypoints, LIMITS, 3.0)
    assert legs == [0, 3]
    assert made.holds_s.tolist() == pytest.approx([10.0, 0.0])
    assert made.due_s[:, -1].tolist() == near([10.0, 38.0])  # 2 m before the end at 1 m/s
    assert made.planned_mps.tolist() == pytest.approx([2.0, 20.0 / 18.0], rel=2e-3)
    # The delay of an autopilot that begins it 3 m before the point: 1.5 s earlier at 2 m/s, and as much longer.
    early, _ = leg_profile(t_s, places, waypoints, replace(LIMITS, delay_begins_m=3.0), 3.0)
    assert early.holds_s.tolist() == pytest.approx([11.5, 0.0], abs=0.11)
    assert early.due_s[0].tolist() == near([10.0 / 3.0, 20.0 / 3.0, 20.0 - early.holds_s[0]])
    # One that begins it 15 m before: no share of the leg is due after that.
    soon, _ = leg_profile(t_s, places, waypoints, replace(LIMITS, delay_begins_m=15.0), 3.0)
    assert soon.holds_s[0] == pytest.approx(17.5, abs=0.11)
    assert soon.due_s[0].tolist() == near([20.0 - soon.holds_s[0]] * 3)


def test_a_rest_before_the_first_leg_is_flown_before_time_0() -> None:
    t_s = np.arange(2.0, 32.05, 0.1)
    places = northwards(t_s, [2.0, 12.0, 32.0], [5.0, 5.0, 45.0])
    made, legs = leg_profile(t_s, places, [0, 40, 100, 300], LIMITS, 3.0)
    assert legs == [2]
    assert made.airborne_s == pytest.approx(13.0)
    assert made.due_s[0].tolist() == near([20.0 / 3.0, 40.0 / 3.0, 19.0])
    assert made.holds_s.tolist() == [0.0]


def test_a_rest_at_the_end_is_a_leg_that_is_due_at_once() -> None:
    """The last waypoint is always flown to; the vehicle is there from the beginning of the leg."""
    t_s = np.arange(0.0, 30.05, 0.1)
    places = northwards(t_s, [0.0, 20.0, 30.0], [0.0, 40.0, 40.0])
    made, legs = leg_profile(t_s, places, [0, 200, 300], LIMITS, 3.0)
    assert legs == [0, 1]
    assert made.due_s[1].tolist() == near([20.0] * 3)
    assert made.planned_mps[1] == 0.5


@pytest.mark.parametrize(
    ("way", "fastest"),
    [
        ([30.0, 0.0, 0.0], 6.0),
        ([0.0, -30.0, 0.0], 6.0),
        ([30.0, 30.0, 0.0], 8.0),  # 6 along both axes would be 8.5
        ([4.0, 0.0, 3.0], 2.5),  # 1.5 m/s down
        ([4.0, 0.0, -3.0], 2.5),
    ],
)
def test_no_axis_is_faster_than_its_limit(way: list[float], fastest: float) -> None:
    t_s = np.arange(0.0, 20.05, 0.1)
    places = t_s[:, None] / 20.0 * np.array(way)
    made, _ = leg_profile(t_s, places, [0, 200], LIMITS, 3.0)
    assert made.fastest_mps.tolist() == pytest.approx([fastest], rel=1e-3)
    crawling, _ = leg_profile(t_s, places, [0, 200], replace(LIMITS, speed_ned_mps=LIMITS.speed_ned_mps * 0.01), 3.0)
    assert crawling.fastest_mps.tolist() == [0.5]


def profile(points: list[list[float]], holds_s: list[float]) -> LegProfile:
    count = len(holds_s)
    due_s = np.arange(1.0, count + 1.0)[:, None] * 10.0 * THIRDS
    return LegProfile(np.array(points), due_s, np.array(holds_s), 0.5, np.full(count, 8.0))


def test_planned_speeds_count_from_the_end_of_a_hold_and_keep_to_their_limits() -> None:
    made = profile([[0, 0, 0], [0, 30, 0], [0, 30, -20], [0, 31, -20], [90, 31, -20]], [0.0, 4.0, 0.0, 0.0])
    assert made.lengths_m.tolist() == [30.0, 20.0, 1.0, 90.0]
    # 10 s each, the third 6 s after a hold
    np.testing.assert_allclose(made.due_s[:, -1], [10.0, 20.0, 30.0, 40.0])
    assert made.planned_mps.tolist() == pytest.approx([3.0, 2.0, 0.5, 8.0])
    assert made.airborne_s == math.inf
    orders = made.orders(np.array([1.0, 2.0, 3.0, 4.0]))
    assert orders.count == 4
    assert list(orders.speeds_mps) == [1.0, 2.0, 3.0, 4.0]
    assert list(orders.holds_s) == [0.0, 4.0, 0.0, 0.0]


def flight(t_s: Array, places: Array, passed_s: list[float], completed_s: list[float]) -> Prediction:
    ends = np.array(passed_s), np.array(completed_s), np.ones(len(completed_s))
    return Prediction(t_s, places, np.gradient(places, t_s, axis=0), *ends)


def test_shares_are_passed_between_the_steps_of_a_flight() -> None:
    """Two legs at 2 and 3 m/s; steps of 0.1 s meet no share, nor the waypoint at 10.05 s."""
    t_s = np.arange(0.0, 20.15, 0.1)
    places = northwards(t_s, [0.0, 10.05, 20.05], [0.0, 20.1, 50.1])
    made = profile([[0, 0, -10], [20.1, 0, -10], [50.1, 0, -10]], [0.0, 0.0])
    passed_s = made.passed_s(flight(t_s, places, [10.0, 20.1], [10.4, 20.1]))
    np.testing.assert_allclose(passed_s[0], 10.05 * THIRDS, atol=0.02)
    np.testing.assert_allclose(passed_s[1], [*(10.05 + 10.0 * THIRDS[:2]), 20.1], atol=0.02)


def test_a_corner_is_passed_where_its_waypoint_is_beside_the_way() -> None:
    """At 4 m/s, 0.12 m before the waypoint at the step that is nearest to it: 30 ms later, and no more than a step."""
    t_s = np.arange(0.0, 10.05, 0.1)
    for aside_m, later_s in ((0.12, 0.03), (-0.2, -0.05), (3.0, 0.1), (-3.0, -0.1)):
        places = northwards(t_s, [0.0, 10.0], [0.0, 40.0])
        made = profile([[0, 0, -10], [20.0 + aside_m, 1.0, -10], [40.0, 0, -10]], [0.0, 0.0])
        assert made.passed_s(flight(t_s, places, [5.0, 10.0], [5.2, 10.0]))[0, -1] == pytest.approx(5.0 + later_s)


def test_a_hold_is_reached_when_its_delay_begins_and_left_when_it_is_completed() -> None:
    t_s = np.arange(0.0, 30.05, 0.1)
    places = northwards(t_s, [0.0, 10.0, 18.0, 28.0, 30.0], [0.0, 20.0, 20.0, 40.0, 40.0])
    made = profile([[0, 0, -10], [20, 0, -10], [40, 0, -10]], [7.0, 0.0])
    passed_s = made.passed_s(flight(t_s, places, [9.0, 27.0], [18.0, 27.0]))
    np.testing.assert_allclose(passed_s[0], [10.0 / 3.0, 20.0 / 3.0, 11.0], atol=1e-9)
    np.testing.assert_allclose(passed_s[1], [18.0 + 10.0 / 3.0, 18.0 + 20.0 / 3.0, 27.0], atol=1e-9)


def test_a_vehicle_that_swings_back_has_passed_what_it_passed() -> None:
    t_s = np.arange(0.0, 12.05, 0.1)
    places = northwards(t_s, [0.0, 4.0, 6.0, 12.0], [0.0, 16.0, 8.0, 30.0])
    made = profile([[0, 0, -10], [30, 0, -10]], [0.0])
    np.testing.assert_allclose(made.passed_s(flight(t_s, places, [12.0], [12.0]))[0, 0], 2.5)


@pytest.mark.parametrize("hold_s", [0.5, 4.0])
def test_a_leg_begins_when_the_hold_before_it_has_ended(hold_s: float) -> None:
    """20 m at 2 m/s, a hold in which it is blown 12 m ahead and comes back, and 30 m at 3 m/s."""
    t_s = np.arange(0.0, 25.05, 0.1)
    leaves_s = 10.3 + hold_s
    places = northwards(t_s, [0.0, 10.0, leaves_s - 0.2, leaves_s, leaves_s + 10.0], [0.0, 20.0, 32.0, 20.0, 50.0])
    made = profile([[0, 0, -10], [20, 0, -10], [50, 0, -10]], [hold_s, 0.0])
    passed_s = made.passed_s(flight(t_s, places, [9.5, leaves_s + 10.0], [leaves_s, leaves_s + 10.0]))
    assert passed_s[0, -1] == pytest.approx(10.3)
    np.testing.assert_allclose(passed_s[1], leaves_s + 10.0 * THIRDS, atol=0.02)


@pytest.mark.parametrize("begin_s", [0.0, 5.0])
def test_the_time_of_passing_is_refined_within_one_step(begin_s: float) -> None:
    """The autopilot goes on to the next leg 1 m or 10 cm before the point that it would pass, and 0.5 s after it."""
    t_s = begin_s + np.arange(0.0, 20.15, 0.1)
    places = northwards(t_s, [begin_s, begin_s + 20.05], [0.0, 40.1])
    made = profile([[0, 0, -10], [20.1, 0, -10], [40.1, 0, -10]], [0.0, 0.0])
    for goes_on_s, passed_s in ((9.5, 9.6), (10.0, 10.05), (10.5, 10.4)):
        times_s = [begin_s + goes_on_s, begin_s + 20.05]
        assert made.passed_s(flight(t_s, places, times_s, times_s))[0, -1] == pytest.approx(begin_s + passed_s)
