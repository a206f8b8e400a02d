"""Setpoints as messages: each vehicle's own frame and clock, rest at both ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.flight.contingency.manoeuvres import MotionReference, PlanReference
from gcs.flight.execution.setpoint_schedule import Grid, Scheduler, Streamed, due_messages, wait_s
from gcs.frames import LocalFrame
from gcs.link.protocols.clock import VehicleClock
from gcs.link.wire.message import Message, Station
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.returns.routed_motion import PiecewiseMotion
from gcs.plan.trajectory.plan import Plan

T0, BOOT_S = 1_700_000_100.0, 1_700_000_000.0  # GNSS time of T0 and of the vehicle's start

AT_REST = MotionReference(PiecewiseMotion(np.zeros((1, 1)), np.zeros((1, 1, 3)), np.zeros((1, 1, 3))), 0.0, 0.0)


def clock_at(now_s: float, boot_s: float) -> VehicleClock:
    clock = VehicleClock()
    fields = {"time_unix_usec": round((BOOT_S + boot_s) * 1e6), "time_boot_ms": round(boot_s * 1e3)}
    clock.receive(Message("SYSTEM_TIME", fields, 3, 1), now_s)
    return clock


def test_a_message_says_the_plan_in_the_vehicles_own_frame_and_clock(simulation1_plan: Plan) -> None:
    plan, row = simulation1_plan, 2
    stream = build_stream(plan, 50.0)
    grid = Grid.of(stream.t_s, 50.0)
    scheduler = Scheduler(grid, T0)
    k = int(np.searchsorted(stream.t_s, 20.0))
    scheduler.start(3, k, len(grid.t_s))
    counts = np.array([1.003, 0.998, 1.0])
    frame = LocalFrame(plan.pads_ned_m[row], counts)
    vehicle = Streamed(Station(3, 1), clock_at(7.0, 120.0), frame, PlanReference(stream, row))
    (message,) = due_messages(scheduler, vehicle, 7.0)
    said = message.fields
    assert said["time_boot_ms"] == 120_000
    assert (said["target_system"], said["target_component"]) == (3, 1)
    assert said["type_mask"] == 0x800  # everything but the yaw rate
    place = np.array([said["x"], said["y"], said["z"]]) / counts + plan.pads_ned_m[row]
    np.testing.assert_allclose(place, stream.position_ned_m[row, k], atol=1e-9)
    assert [said["vx"], said["vy"], said["vz"]] == (stream.velocity_ned_mps[row, k] * counts).tolist()
    assert [said["afx"], said["afy"], said["afz"]] == (stream.acceleration_ned_mps2[row, k] * counts).tolist()
    assert said["yaw"] == stream.yaw_ned_rad[row, k]
    assert due_messages(scheduler, vehicle, 7.0) == []


def test_the_next_deadline_in_local_time() -> None:
    grid = Grid.of(np.arange(0.0, 10.0, 0.02), 50.0)
    scheduler = Scheduler(grid, T0)
    scheduler.start(3, 0, None)
    vehicle = Streamed(Station(3, 1), clock_at(7.0, 99.99), LocalFrame(), AT_REST)
    assert wait_s(scheduler, [vehicle], 7.0, 1.0) == pytest.approx(0.01, abs=1e-6)
    assert wait_s(scheduler, [vehicle], 7.0, 0.004) == 0.004
    scheduler.due(3, T0)
    assert wait_s(scheduler, [vehicle], 7.0, 1.0) == pytest.approx(0.03, abs=1e-6)


def test_before_and_after_the_plan_a_vehicle_stands_at_its_ends(simulation1_plan: Plan) -> None:
    stream = build_stream(simulation1_plan, 25.0)
    course = PlanReference(stream, 4)
    for k, end in ((-30, 0), (len(stream.t_s) + 30, -1)):
        values = course.at(k, math.nan)
        assert list(values[:3]) == stream.position_ned_m[4, end].tolist()
        assert list(values[3:9]) == [0.0] * 6
        assert values[9] == stream.yaw_ned_rad[4, end]


def test_streams_end_at_rest(simulation1_plan: Plan) -> None:
    stream = build_stream(simulation1_plan, 25.0)
    for row in range(6):
        assert list(PlanReference(stream, row).at(len(stream.t_s) - 1, math.nan)[3:9]) == [0.0] * 6


def test_a_vehicle_whose_time_is_unknown_is_sent_nothing() -> None:
    scheduler = Scheduler(Grid((0.0, 0.1), 0.1), T0)
    scheduler.start(3, 0, None)
    vehicle = Streamed(Station(3, 1), VehicleClock(), LocalFrame(), AT_REST)
    assert due_messages(scheduler, vehicle, 1e9) == []


def test_while_a_vehicle_is_not_heard_its_setpoints_go_on_by_the_time_of_the_others() -> None:
    """At 10 Hz from its last report on; the clock alone would stop after 0.5 s."""

    def sent(unheard_s: float, silent_s: float, others_last_s: float) -> int:
        now_s = 7.0
        vehicle = Streamed(
            Station(3, 1),
            clock_at(7.0, 100.0),
            LocalFrame(),
            AT_REST,
            unheard_s,
            lambda: T0 + min(now_s - 7.0, others_last_s),
        )
        scheduler = Scheduler(Grid.of(np.arange(0.0, 60.0, 0.1), 10.0), T0)
        scheduler.start(3, 0, None)
        count = 0
        for now_s in (7.0 + 0.05 * n for n in range(round(silent_s / 0.05))):
            count += len(due_messages(scheduler, vehicle, now_s))
        return count

    assert sent(0.0, 8.0, 60.0) <= 7
    assert 78 <= sent(10.0, 8.0, 60.0) <= 82
    assert 98 <= sent(10.0, 20.0, 60.0) <= 102, "then it counts as lost"
    assert 38 <= sent(10.0, 8.0, 4.0) <= 42, "nobody is heard: the computer, or all vehicles, may stand still"
