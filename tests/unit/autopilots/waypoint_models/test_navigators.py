"""Both navigators on small missions: known arrival times, and properties of every flight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.calibration import ARDUPILOT, PX4
from gcs.autopilots.waypoint_models.navigator import Ability, NavigatorOrders
from gcs.autopilots.waypoint_models.predict import NEAR_M, predict
from gcs.errors import VerificationError

BOTH = pytest.mark.parametrize("navigator", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])
# Straight on and faster, a corner and slower, a corner that climbs, a corner.
POINTS = np.array([[0, 0, -20], [60, 0, -20], [100, 0, -20], [100, 50, -20], [130, 50, -26], [130, 90, -26]], float)
SPEEDS = (5.0, 8.0, 3.0, 4.0, 6.0)
PLANNED_S = np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1) / SPEEDS)


@pytest.mark.parametrize(
    ("name", "airborne_s", "passed_s"),
    [
        ("ardupilot", math.inf, [14.7, 23.0, 31.4, 39.4, 47.9]),
        ("ardupilot", 0.0, [14.7, 23.0, 31.4, 39.4, 47.9]),
        ("px4", math.inf, [14.9, 22.4, 42.3, 53.0, 63.0]),
        ("px4", 0.0, [15.1, 23.5, 43.4, 54.0, 64.0]),
    ],
)
def test_arrivals_of_a_small_mission(name, airborne_s, passed_s):
    prediction = predict(
        Autopilot.named(name).navigator, NavigatorOrders.through(POINTS, SPEEDS, airborne_s=airborne_s)
    )
    np.testing.assert_allclose(prediction.passed_s, passed_s, atol=0.15)


def test_ardupilot_slows_down_late_and_px4_brakes_at_corners():
    """On the same small mission neither has the times that follow from lengths and speeds."""
    ardupilot, px4 = (
        predict(navigator, NavigatorOrders.through(POINTS, SPEEDS)).passed_s for navigator in (ARDUPILOT, PX4)
    )
    third_leg_s = np.diff(PLANNED_S)[1]
    assert np.diff(ardupilot)[1] < 0.6 * third_leg_s
    assert np.diff(px4)[1] > 1.1 * third_leg_s


@BOTH
def test_after_a_hold_it_starts_from_rest(navigator):
    free = predict(navigator, NavigatorOrders.through(POINTS, SPEEDS))
    held = predict(navigator, NavigatorOrders.through(POINTS, SPEEDS, (0.0, 0.0, 4.0, 0.0, 0.0)))
    np.testing.assert_array_equal(held.passed_s[:2], free.passed_s[:2])
    assert held.completed_s[2] >= held.passed_s[2] + 4.0
    at = np.searchsorted(held.t_s, held.completed_s[2])
    assert np.linalg.norm(held.velocity_ned_mps[at]) < 0.3
    assert held.passed_s[3] > free.passed_s[3] + 3.5


legs = st.lists(
    st.tuples(st.floats(12.0, 80.0), st.floats(-2.5, 2.5), st.floats(-4.0, 4.0), st.floats(1.0, 8.0)),
    min_size=1,
    max_size=4,
)


@BOTH
@given(legs)
@settings(max_examples=12, deadline=None)
def test_a_flight_is_smooth_goes_forward_and_keeps_the_speed_limit(navigator, legs):
    points, heading = [np.array([0.0, 0.0, -40.0])], 0.0
    for length, turn, climb, _ in legs:
        heading += turn
        points.append(points[-1] + [length * math.cos(heading), length * math.sin(heading), -climb])
    speeds = [speed for *_, speed in legs]
    flown = predict(navigator, NavigatorOrders.through(np.array(points), speeds))
    step_s = np.diff(flown.t_s)
    moved = np.diff(flown.position_ned_m, axis=0) / step_s[:, None]
    middle = 0.5 * (flown.velocity_ned_mps[1:] + flown.velocity_ned_mps[:-1])
    np.testing.assert_allclose(moved, middle, atol=1e-9)
    assert np.abs(np.diff(flown.velocity_ned_mps, axis=0)).max() < 12.0 * step_s.max()
    assert np.hypot(*flown.velocity_ned_mps[:, :2].T).max() < 1.1 * max(speeds) + 0.3
    # Overlapping legs, and a change of speed that is not made, can shorten a leg; waypoints keep their order.
    assert np.all(np.diff(flown.passed_s) > 0.0)
    assert np.all(np.diff(flown.completed_s) > 0.0)
    for k, (point, passed_s) in enumerate(zip(points[1:], flown.passed_s, strict=True)):
        at = flown.position_ned_m[np.searchsorted(flown.t_s, passed_s)]
        assert np.linalg.norm(at - point) <= NEAR_M + 0.5, k
    for k in range(len(legs)):
        begin_s = flown.passed_s[k - 1] if k else 0.0
        leg = flown.position_ned_m[(flown.t_s >= begin_s) & (flown.t_s <= flown.passed_s[k])]
        direction = (points[k + 1] - points[k]) / np.linalg.norm(points[k + 1] - points[k])
        assert np.diff(leg @ direction).min() > -0.02, f"leg {k} is flown back"


@BOTH
def test_the_ability_of_a_vehicle_limits_its_flight(navigator):
    ability = Ability(horizontal_mps2=0.8, horizontal_mps3=0.5, horizontal_mps4=0.4, horizontal_mps=4.0)
    gentle = predict(navigator.within(ability), NavigatorOrders.through(POINTS, SPEEDS))
    strong = predict(navigator, NavigatorOrders.through(POINTS, SPEEDS))
    acceleration = np.diff(gentle.velocity_ned_mps[:, :2], axis=0) / np.diff(gentle.t_s)[:, None]
    assert np.linalg.norm(acceleration, axis=1).max() < 1.6  # two legs overlap at corners
    assert np.hypot(*gentle.velocity_ned_mps[:, :2].T).max() < 4.4
    assert gentle.passed_s[-1] > strong.passed_s[-1] + 3.0
    assert navigator.within(Ability()) == navigator


def test_px4_brakes_before_level_waypoints_while_home_is_corrected():
    straight = np.array([[0.0, 0.0, -20.0], [60.0, 0.0, -20.0], [120.0, 0.0, -20.0], [180.0, 0.0, -20.0]])
    settled = predict(PX4, NavigatorOrders.through(straight, (5.0,) * 3)).passed_s
    unsettled = predict(PX4, NavigatorOrders.through(straight, (5.0,) * 3, airborne_s=20.0)).passed_s
    assert np.all(np.diff(unsettled - settled)[:1] > 0.4)
    climbing = straight - [[0, 0, 0], [0, 0, 5], [0, 0, 10], [0, 0, 15]]
    late_s = [
        predict(PX4, NavigatorOrders.through(climbing, (5.0,) * 3, airborne_s=a)).passed_s[1] for a in (20.0, math.inf)
    ]
    assert abs(late_s[0] - late_s[1]) < 0.2


@BOTH
def test_waypoints_on_the_spot_are_completed_at_once(navigator):
    points = np.array([[0.0, 0.0, -20.0]] * 2 + [[30.0, 0.0, -20.0]] * 2)
    flown = predict(navigator, NavigatorOrders.through(points, (5.0, 5.0, 5.0)))
    assert flown.completed_s[0] < 1.5
    assert flown.completed_s[2] - flown.completed_s[1] < 3.0


def test_orders_are_checked():
    with pytest.raises(ValueError, match="speeds must be"):
        NavigatorOrders.through(POINTS, (5.0, 0.0, 3.0, 4.0, 6.0))
    with pytest.raises(ValueError, match="one speed"):
        NavigatorOrders.through(POINTS, (5.0,))


def test_a_flight_without_end_is_an_error():
    stuck = ARDUPILOT.within(Ability(horizontal_mps=1e-4))
    with pytest.raises(VerificationError, match="waypoint 1 of 1"):
        predict(stuck, NavigatorOrders.through(POINTS[:2], (8.0,)))
