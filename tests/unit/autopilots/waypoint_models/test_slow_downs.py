"""Slow-downs of a leg that has begun, as ArduCopter 4.5.6 flew them: from rest along one leg, then along another."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.autopilots.waypoint_models.calibration import ARDUPILOT, PX4
from gcs.autopilots.waypoint_models.navigator import Navigator, NavigatorOrders
from gcs.autopilots.waypoint_models.predict import Prediction, predict

APPROACH_M = 20.0
SHARES = (0.1, 0.9)  # of the second leg, between which it is timed
# Speeds asked for before and on the second leg, m/s; its length, m; its time, s. Swept on ArduPilot's simulator.
SWEPT = (
    (2.3, 1.04, 16.0, 9.26),  # the room is less than the whole slow-down takes: a part of it is made
    (2.3, 1.04, 20.0, 12.86),
    (2.3, 1.5, 16.0, 7.46),
    (2.5, 1.04, 17.0, 5.50),  # never
    (2.5, 1.04, 18.0, 10.03),
    (2.5, 2.0, 18.0, 6.75),
    (2.7, 1.04, 19.0, 5.70),
    (2.7, 1.04, 20.0, 10.71),
    (2.7, 1.5, 20.0, 8.67),
    (2.7, 2.0, 19.0, 5.71),
    (3.0, 1.5, 22.0, 5.95),
    (3.0, 1.5, 25.0, 10.91),
)


def timed_s(before_mps: float, asked_mps: float, length_m: float, *, climb_m: float = 0.0) -> float:
    points = np.array([[0.0, 0.0, -30.0], [APPROACH_M, 0.0, -30.0], [APPROACH_M + length_m, 0.0, -30.0 - climb_m]])
    flown = predict(ARDUPILOT, NavigatorOrders.through(points, [before_mps, asked_mps], [0.0, 1.0]))
    north_m = np.maximum.accumulate(flown.position_ned_m[:, 0])
    begin_s, end_s = np.interp([APPROACH_M + share * length_m for share in SHARES], north_m, flown.t_s)
    return float(end_s - begin_s)


@pytest.mark.parametrize(("before_mps", "asked_mps", "length_m", "recorded_s"), SWEPT)
def test_a_slow_down_takes_as_long_as_it_was_flown(
    before_mps: float, asked_mps: float, length_m: float, recorded_s: float
) -> None:
    assert timed_s(before_mps, asked_mps, length_m) == pytest.approx(recorded_s, abs=0.05)


def test_of_two_vehicles_that_came_within_a_metre_one_slowed_down() -> None:
    """Asked for 1.04 m/s on 18.3 m that climb by 2.15 m: after 2.73 m/s flown in 6.1 s, after 2.50 m/s in 11.5 s."""
    fast_s, slow_s = (timed_s(before, 1.036, 18.34, climb_m=2.15) for before in (2.729, 2.497))
    assert slow_s - fast_s == pytest.approx(11.5 - 6.1, abs=0.4)


def flights_of_all_reactions(navigator: Navigator, orders: NavigatorOrders) -> tuple[Prediction, list[Prediction]]:
    return predict(navigator, orders), [predict(each, orders) for each in navigator.reactions]


@pytest.mark.parametrize(("asked_mps", "length_m"), [row[1:3] for row in SWEPT])
def test_a_flight_without_doubt_is_flown_alike_by_all_reactions(asked_mps: float, length_m: float) -> None:
    """A slow-down is in doubt just where one of them makes it and the other does not."""
    points = np.array([[0.0, 0.0, -30.0], [APPROACH_M, 0.0, -30.0], [APPROACH_M + length_m, 0.0, -30.0]])
    orders = NavigatorOrders.through(points, [2.5, asked_mps], [0.0, 1.0])
    flown, others = flights_of_all_reactions(ARDUPILOT, orders)
    alike = all(np.array_equal(flown.position_ned_m, each.position_ned_m) for each in others if not flown.doubtful)
    assert alike
    assert flown.doubtful == (others[0].passed_s[-1] > others[1].passed_s[-1] + 0.1)


@pytest.mark.parametrize(("airborne_s", "doubtful"), [(10.0, True), (200.0, False)])
def test_px4_is_in_doubt_while_homes_height_settles(airborne_s: float, doubtful: bool) -> None:
    points = np.array([[0.0, 0.0, -30.0], [40.0, 0.0, -30.0], [80.0, 10.0, -30.0]])
    orders = NavigatorOrders.through(points, [4.0, 4.0], airborne_s=airborne_s)
    flown, others = flights_of_all_reactions(PX4, orders)
    assert flown.doubtful is doubtful
    assert np.array_equal(others[0].passed_s, others[1].passed_s) is not doubtful
