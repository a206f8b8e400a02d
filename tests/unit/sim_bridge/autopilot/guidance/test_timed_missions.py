"""Emulated vehicles fly missions of timed legs as their originals do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.autopilots.navigation.navigator import NavigatorOrders
from gcs.autopilots.navigation.predict import passing_times, predict
from gcs.autopilots.traits import Autopilot
from gcs.mission.waypoints.arrival_times import corrected_legs
from gcs.physics.quadrotor import POSITION
from gcs.plan.trajectory.plan import Plan
from sim_bridge.personality import by_name
from tests.unit.sim_bridge.timed_missions import Fleet, Flight
from tools.fit_navigator import MODELS, RECORDINGS, read_recording

POINTS = np.array([[10, 0, -20], [70, 0, -20], [110, 0, -20], [110, 50, -20], [140, 50, -26]], float)
SPEEDS = (5.0, 8.0, 3.0, 4.0)
GOAL_S = 3.0
NAMES = pytest.mark.parametrize("name", ["ardupilot", "px4"])


def passed_s(flight: Flight, orders: NavigatorOrders) -> np.ndarray:
    """When the vehicle was nearest to each waypoint, (N,)."""
    ends = np.array([*flight.reached_s, flight.t_s[-1]])[: orders.count]
    return passing_times(flight.t_s, flight.position_ned_m, orders, ends)


@NAMES
def test_a_flight_is_what_the_model_predicts(name: str) -> None:
    orders = NavigatorOrders.through(POINTS, SPEEDS, airborne_s=20.0)
    (flight,) = Fleet(by_name(name), [orders]).fly()
    predicted = predict(Autopilot.named(name).navigator, orders)
    np.testing.assert_allclose(passed_s(flight, orders), predicted.passed_s, atol=0.5)
    np.testing.assert_allclose(flight.reached_s, predicted.completed_s[: len(flight.reached_s)], atol=0.5)


@pytest.mark.slow
@NAMES
def test_a_corrected_mission_is_flown_in_time(name: str, plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("field/scenario.toml")
    legs = corrected_legs(plan, Autopilot.named(name))
    assert legs.speeds_mps is not None
    points = plan.motion(legs.t_s, slice(plan.leader, plan.leader + 1))[0][0][:, POSITION]
    orders = NavigatorOrders.through(points, legs.speeds_mps[0].tolist(), airborne_s=20.0)
    (flight,) = Fleet(by_name(name), [orders]).fly()
    late_s = passed_s(flight, orders) - (legs.t_s[1:] - legs.left_s)
    print(f"{name}: late {late_s.round(2).tolist()}")
    assert np.abs(late_s[:-1]).max() <= 1.0  # the last counts from where the plan is near


@NAMES
def test_an_ideal_vehicle_is_on_time(name: str) -> None:
    orders = NavigatorOrders.through(POINTS, SPEEDS)
    (flight,) = Fleet(by_name(name), [orders], ideal=True).fly()
    asked_s = np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1) / SPEEDS)
    np.testing.assert_allclose(passed_s(flight, orders)[:-1], asked_s[:-1], atol=0.8)  # corners are rounded


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_recorded_missions_are_flown_as_recorded(model) -> None:
    folder = RECORDINGS / model.folder
    if not all((folder / f"timed_legs_{mission}.jsonl.gz").exists() for mission in "abc"):
        pytest.skip(f"no recordings timed_legs_a, _b, _c of {folder.name}")
    recordings = [read_recording(folder, mission) for mission in "abc"]
    flights = Fleet(by_name(model.name), [recording.orders for recording in recordings]).fly()
    for recording, flight in zip(recordings, flights, strict=True):
        error_s = passed_s(flight, recording.orders) - recording.passed_s
        rms_s = float(np.sqrt(np.mean(error_s**2)))
        worst_s = error_s[np.abs(error_s).argmax()]
        print(f"{model.name} {recording.name}: rms {rms_s:.2f} s, mean {error_s.mean():+.2f}, worst {worst_s:+.2f}")
        assert rms_s <= GOAL_S, recording.name
