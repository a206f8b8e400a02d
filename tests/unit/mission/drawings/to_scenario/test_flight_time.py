"""The time of a route: in closed form for straight ones."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.mission.drawings.to_scenario.flight_time import flight_time_s, is_passed_at_speed, turns_rad

STRAIGHT = np.array([[0.0, 0.0, 10.0], [300.0, 0.0, 10.0], [600.0, 0.0, 10.0]])


def test_a_straight_route_takes_its_length_over_its_speed_and_one_start_and_stop() -> None:
    assert flight_time_s(STRAIGHT, np.array([4.0, 4.0]), 1.2, np.zeros(3)) == 155.0  # 150 s and 4 s


def test_a_hold_costs_its_time_and_a_stop() -> None:
    assert flight_time_s(STRAIGHT, np.array([4.0, 4.0]), 1.2, np.array([0.0, 20.0, 0.0])) == 180.0  # 154 + 20 + 4


def test_each_leg_has_its_own_speed() -> None:
    assert flight_time_s(STRAIGHT, np.array([4.0, 2.0]), 1.2, np.zeros(3)) == 230.0  # 75 + 150 + 3


def test_a_climb_takes_the_time_of_its_height() -> None:
    climb = np.array([[0.0, 0.0, 10.0], [1.0, 0.0, 130.0]])
    assert flight_time_s(climb, np.array([4.0]), 1.2, np.zeros(2)) == 105.0  # 100 + 4


def test_turns_are_the_angles_between_legs() -> None:
    square = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [10.0, 0.0, 0.0], [10.0, -5.0, 0.0]])
    assert np.degrees(turns_rad(square)) == pytest.approx([90.0, 180.0, 0.0], abs=1e-5)
    assert is_passed_at_speed(np.radians(29.0)) and not is_passed_at_speed(np.radians(31.0))
