"""Emulated vehicles fly missions of timed legs as recorded autopilots did, and as other vehicles than was assumed.

The emulator and the ground station have the same navigator. So a flight is never compared with the navigator's own
prediction: it is compared with recordings (`tests/recorded/timed_legs`), or flown by a vehicle with another lag.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.navigator import NavigatorOrders
from gcs.autopilots.waypoint_models.predict import passing_times
from gcs.mission.waypoints.arrival_times import corrected_legs
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from sim_bridge.personality import by_name
from tests.unit.sim_bridge.timed_missions import Fleet, Flight
from tools.fit_navigator import MISSIONS, MODELS, RECORDINGS, Model, Recording, read_recording

POINTS = np.array([[10, 0, -20], [70, 0, -20], [110, 0, -20], [110, 50, -20], [140, 50, -26]], float)
SPEEDS = (5.0, 8.0, 3.0, 4.0)
# Arrival times at all waypoints (RMS, s), and the distance between both vehicles at equal times (mean, m). Vehicles at
# 5 m/s that differ by 0.4 s are 2 m apart.
GOALS = {"ardupilot": (0.4, 2.0), "px4": (1.5, 4.0)}
# Vehicles that the ground station does not know: the values that fit all recordings but one (tools/fit_navigator.py).
OTHERS = {"ardupilot": (0.16, 0.24), "px4": (2.138, 0.531)}
NAMES = pytest.mark.parametrize("name", ["ardupilot", "px4"])


def passed_s(flight: Flight, orders: NavigatorOrders) -> np.ndarray:
    """When the vehicle was nearest to each waypoint, (N,)."""
    ends = np.array([*flight.reached_s, flight.t_s[-1]])[: orders.count]
    return passing_times(flight.t_s, flight.position_ned_m, orders, ends)


def apart_m(flight: Flight, recording: Recording) -> np.ndarray:
    """How far the emulated vehicle is from where the recorded one was at the same time, at each recorded sample."""
    both = recording.t_s <= flight.t_s[-1]
    ours = [np.interp(recording.t_s[both], flight.t_s, flight.position_ned_m[:, axis]) for axis in range(3)]
    return np.linalg.norm(np.transpose(ours) - recording.position_ned_m[both], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_recorded_missions_are_flown_as_recorded(model: Model) -> None:
    recordings = [read_recording(RECORDINGS / model.folder, mission) for mission in MISSIONS]
    flights = Fleet(by_name(model.name), [recording.orders for recording in recordings]).fly()
    late_s, distance_m = GOALS[model.name]
    for recording, flight in zip(recordings, flights, strict=True):
        error_s = passed_s(flight, recording.orders) - recording.passed_s
        rms_s = float(np.sqrt(np.mean(error_s**2)))
        worst_s = error_s[np.abs(error_s).argmax()]
        away_m = apart_m(flight, recording)
        print(
            f"{model.name} {recording.name}: rms {rms_s:.2f} s, mean {error_s.mean():+.2f}, worst {worst_s:+.2f}; "
            f"apart {away_m.mean():.2f} m, at most {away_m.max():.2f}"
        )
        assert rms_s <= late_s, recording.name
        assert away_m.mean() <= distance_m, recording.name


@pytest.mark.slow
@NAMES
def test_a_corrected_mission_is_in_time_on_a_vehicle_with_another_lag(
    name: str, plan_of: Callable[[str], Plan]
) -> None:
    plan = plan_of("field/scenario.toml")
    legs = corrected_legs(plan, Autopilot.named(name))
    assert legs.speeds_mps is not None
    points = plan.motion(legs.t_s, slice(plan.leader, plan.leader + 1))[0][0][:, POSITION]
    orders = NavigatorOrders.through(points, legs.speeds_mps[0].tolist(), airborne_s=20.0)
    other = next(model for model in MODELS if model.name == name).make(OTHERS[name])
    assert other != Autopilot.named(name).navigator
    (flight,) = Fleet(by_name(name), [orders], other=other).fly()
    late_s = passed_s(flight, orders) - (legs.t_s[1:] - legs.left_s)
    print(f"{name}: late {late_s.round(2).tolist()}")
    assert np.abs(late_s[:-1]).max() <= 1.5  # the last counts from where the plan is near


@NAMES
def test_an_ideal_vehicle_is_on_time(name: str) -> None:
    orders = NavigatorOrders.through(POINTS, SPEEDS)
    (flight,) = Fleet(by_name(name), [orders], ideal=True).fly()
    asked_s = np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1) / SPEEDS)
    np.testing.assert_allclose(passed_s(flight, orders)[:-1], asked_s[:-1], atol=0.8)  # corners are rounded
