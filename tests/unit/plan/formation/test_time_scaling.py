"""A change begins and ends gently, and takes exactly as long as its tightest limit asks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.plan.formation.shape import joined, stretched
from gcs.plan.formation.time_scaling import Budget, budget, least_duration, peak_derivatives, smooth_step
from gcs.plan.formation.transforms import rotation, shrinking, straight
from gcs.scenario.schema.scenario import Scenario

FREE = Budget(np.inf, np.inf, np.inf, np.inf)
# Peaks of the step's derivatives, from its factored forms: 140 r^3 (1-r)^3 and so on.
SPEED, ACCEL, JERK, SNAP = 35.0 / 16.0, 84.0 / 5.0**1.5, 52.5, 840.0


def test_the_step_is_at_rest_at_both_ends_up_to_its_jerk() -> None:
    step = smooth_step()
    assert step(0.0) == 0.0
    assert step(1.0) == 1.0
    for order in (1, 2, 3):
        np.testing.assert_allclose(step([0.0, 1.0], nu=order), 0.0, atol=1e-11)
    assert np.all(np.diff(step(np.linspace(0.0, 1.0, 301))) > 0.0)
    np.testing.assert_allclose(step([0.25], nu=1), 140 * 0.25**3 * 0.75**3)


def test_peaks_of_a_straight_move_are_those_of_the_step_times_its_length() -> None:
    move = straight(np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]))
    np.testing.assert_allclose(peak_derivatives(move), 5.0 * np.array([SPEED, ACCEL, JERK, SNAP]), rtol=1e-4)


@pytest.mark.parametrize(
    ("limits", "name", "peak", "order"),
    [
        ({"speed_mps": 0.5}, "speed", SPEED, 1),
        ({"accel_mps2": 0.5}, "acceleration", ACCEL, 2),
        ({"jerk_mps3": 0.5}, "turn rate", JERK, 3),
        ({"snap_mps4": 0.5}, "torque", SNAP, 4),
    ],
)
def test_one_limit_alone_sets_the_time(limits: dict[str, float], name: str, peak: float, order: int) -> None:
    move = straight(np.zeros((1, 3)), np.array([[0.0, 7.0, 0.0]]))
    seconds, limited_by = least_duration(move, replace(FREE, **limits))
    assert limited_by == name
    assert seconds == pytest.approx((7.0 * peak / 0.5) ** (1.0 / order), rel=1e-4)


def test_the_limit_on_vertical_speed_counts_for_the_part_of_a_move_that_is_vertical(simulation1: Scenario) -> None:
    move = straight(np.zeros((1, 3)), np.array([[3.0, 0.0, -4.0]]))
    seconds, limited_by = least_duration(move, replace(FREE, speed_mps=2.0, vertical_mps=1.0))
    assert limited_by == "vertical speed"
    assert seconds == pytest.approx(4.0 * SPEED, rel=1e-4)
    assert least_duration(move, replace(FREE, speed_mps=1.0, vertical_mps=1.0))[1] == "speed"
    assert budget(simulation1).vertical_mps == pytest.approx(0.9 * simulation1.limits.speed_ned_mps[2])


def test_the_tightest_limit_sets_the_time_and_is_reached(simulation1: Scenario) -> None:
    limits = budget(simulation1)
    bounds = np.array([limits.speed_mps, limits.accel_mps2, limits.jerk_mps3, limits.snap_mps4])
    names = ("speed", "acceleration", "turn rate", "torque")
    places = np.random.default_rng(1).normal(size=(9, 3)) * 4.0
    for move in (rotation(places, np.array([0.0, 0.3, 1.0]), 2.0), shrinking(places, 0.4), shrinking(places, 0.999)):
        seconds, limited_by = least_duration(move, limits)
        share = peak_derivatives(stretched(move, 5.0, 5.0 + seconds)) / bounds
        assert share.max() == pytest.approx(1.0, rel=1e-6)
        assert names[int(share.argmax())] == limited_by


def test_a_snap_that_jumps_at_a_joint_counts_on_both_sides() -> None:
    here, there = np.zeros((1, 3)), np.array([[0.0, 7.0, 0.0]])
    for first, second in ((9.0, 1.0), (1.0, 9.0)):
        both = joined(
            [stretched(straight(here, first * there), 0.0, 1.0), stretched(straight(here, there * second), 1.0, 2.0)]
        )
        assert peak_derivatives(both)[3] == pytest.approx(9.0 * 7.0 * SNAP, rel=1e-6)


def test_what_does_not_move_takes_no_time() -> None:
    places = np.random.default_rng(2).normal(size=(4, 3))
    assert least_duration(straight(places, places), Budget(1.0, 1.0, 1.0, 1.0)) == (0.0, "nothing")
    assert least_duration(shrinking(places, 1.0), Budget(1.0, 1.0, 1.0, 1.0))[0] == 0.0


def test_the_budget_is_the_scenarios_and_a_fifth_of_what_the_vehicle_can_turn(simulation1: Scenario) -> None:
    limits = budget(simulation1)
    vehicle = simulation1.vehicle
    assert limits.speed_mps == simulation1.formation.change_speed_mps
    assert limits.accel_mps2 == simulation1.formation.change_accel_mps2
    rate = min(simulation1.limits.rates_degps[:2]) * np.pi / 180.0
    assert limits.jerk_mps3 == pytest.approx(0.2 * vehicle.gravity_mps2 * rate)
    twist = 0.075 * 0.0501 / 0.0219
    assert limits.snap_mps4 == pytest.approx(0.2 * vehicle.gravity_mps2 * twist)


def test_more_vehicles_than_fit_at_once_are_all_seen() -> None:
    targets = np.zeros((700, 3))
    targets[650, 1] = 2.0
    assert peak_derivatives(straight(np.zeros((700, 3)), targets))[0] == pytest.approx(2.0 * SPEED, rel=1e-4)
