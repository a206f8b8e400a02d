"""The record of a flight from its telemetry, and what is read out of it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import FileFormatError
from gcs.flight.assessment.comparison import compare
from gcs.flight.assessment.judge import Truth
from gcs.flight.lateness import Lateness, lateness_s, skew_s
from gcs.flight.recording.record_table import build_record
from gcs.flight.recording.tlog import read_messages
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.physics.quadrotor import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan

T0, BOOT_S = 1_700_000_100.0, 1_700_000_000.0


def told(plan: Plan, late_s: dict[int, float]) -> list[Message]:
    """Vehicles that fly the plan, each so much too late, and tell it at 2 Hz."""
    messages = [
        Message("SYSTEM_TIME", {"time_unix_usec": round((BOOT_S + 1.0) * 1e6), "time_boot_ms": 1000}, sysid, 1)
        for sysid in plan.sysids
    ]
    messages += [
        Message("HEARTBEAT", {"autopilot": 3, "base_mode": 128 | 1, "custom_mode": 4}, s, 1) for s in plan.sysids
    ]
    for t_s in np.arange(0.0, 270.0, 0.5):
        for row, sysid in enumerate(plan.sysids):
            state = plan.states(np.array([t_s - late_s[sysid]]))[row, 0]
            x, y, z = state[POSITION] - plan.pads_ned_m[row]
            vx, vy, vz = state[VELOCITY]
            fields = {
                "time_boot_ms": round((T0 + t_s - BOOT_S) * 1e3),
                "x": x,
                "y": y,
                "z": z,
                "vx": vx,
                "vy": vy,
                "vz": vz,
            }
            messages.append(Message("LOCAL_POSITION_NED", fields, sysid, 1))
    return messages


def test_the_record_holds_what_was_told_beside_the_plan(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    late_s = dict.fromkeys(plan.sysids, 0.0)
    record = build_record(plan, T0, iter(told(plan, late_s)))
    assert record.num_rows == 540 * 6
    assert float(np.max(record.column("error_m").to_numpy())) < 1e-6
    assert record.column("armed").to_pylist() == [True] * record.num_rows
    assert set(record.column("mode").to_pylist()) == {4}


def test_a_jump_of_gnss_time_in_flight_moves_no_row(simulation1_plan: Plan) -> None:
    plan, messages = simulation1_plan, []
    for message in told(simulation1_plan, dict.fromkeys(simulation1_plan.sysids, 0.0)):
        messages.append(message)
        boot_ms = message.fields.get("time_boot_ms", 0)
        if message.sysid == 2 and boot_ms > 150_000:
            stamps = {"time_unix_usec": round((BOOT_S + boot_ms / 1e3 + 3600.0) * 1e6), "time_boot_ms": boot_ms}
            messages.append(Message("SYSTEM_TIME", stamps, 2, 1))
    record = build_record(plan, T0, messages)
    assert record.num_rows == 540 * 6
    assert float(np.max(record.column("error_m").to_numpy())) < 1e-6


def test_lateness_and_skew(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    late_s = {1: 0.02, 2: 0.02, 3: 0.05, 4: 0.02, 5: 0.0, 6: 0.02}
    record = build_record(plan, T0, iter(told(plan, late_s)))
    found = compare(plan, record, T0, None)
    assert {c.sysid: c.late_s for c in found} == pytest.approx(late_s, abs=1e-3)
    assert skew_s(c.late_s for c in found) == pytest.approx(0.05, abs=1e-3)
    assert all(np.isnan(c.plan_truth_m) for c in found)


def test_truth_beside_estimate_and_plan(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    record = build_record(plan, T0, iter(told(plan, dict.fromkeys(plan.sysids, 0.0))))
    t_s = np.arange(0.0, 274.0, 0.05)
    states = plan.states(t_s).copy()
    states[..., 0] += 0.3
    found = compare(plan, record, T0, Truth(plan.sysids, T0 + t_s, states))
    for c in found:
        assert c.plan_estimate_m == pytest.approx(0.0, abs=1e-6)
        assert c.estimate_truth_m == pytest.approx(0.3, abs=0.01)
        assert c.plan_truth_m == pytest.approx(0.3, abs=0.01)


def test_lateness_adds_up_as_it_is_told() -> None:
    rate, late = np.array([3.0, -1.0, 0.5]), Lateness()
    assert np.isnan(late.late_s)
    for n in range(10):
        planned = 0.1 * n * rate
        late.add(planned - 0.02 * rate, planned, rate)
        late.add(planned, planned + 5.0, np.zeros(3))  # at rest: says nothing
    assert late.late_s == pytest.approx(0.02)
    assert skew_s([0.02, np.nan, -0.01]) == pytest.approx(0.03)
    assert np.isnan(skew_s([np.nan]))


def test_the_record_holds_how_far_the_shape_was_off(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    messages = told(plan, dict.fromkeys(plan.sysids, 0.0))
    for message in messages:
        if message.name == "LOCAL_POSITION_NED":
            at_s = message.fields["time_boot_ms"] / 1e3 + BOOT_S - T0
            message.fields["y"] += 5.0  # all together: no error of the shape
            if message.sysid == 4 and 100.0 <= at_s < 120.0:
                message.fields["x"] += 3.0
    record = build_record(plan, T0, iter(messages))
    t_s, error = (record.column(name).to_numpy() for name in ("t_s", "formation_error_m"))
    assert np.nanmax(error[(t_s < 99.4) | (t_s > 120.1)]) < 0.05  # reports are half a second apart
    assert error[(t_s > 100.0) & (t_s < 119.0)] == pytest.approx(3.0 * 5 / 6, abs=0.05)
    silent = [m for m in messages if m.sysid != 4 or m.fields.get("time_boot_ms", 0) / 1e3 + BOOT_S - T0 < 150.0]
    record = build_record(plan, T0, iter(silent))
    t_s, error = (record.column(name).to_numpy() for name in ("t_s", "formation_error_m"))
    assert np.isnan(error[t_s > 150.0]).all()
    assert np.isfinite(error[(t_s > 1.0) & (t_s < 149.0)]).all()


def test_who_stands_is_neither_late_nor_early() -> None:
    still = np.zeros((10, 3))
    assert np.isnan(lateness_s(still, still, still))


def test_logs_are_read_up_to_where_they_were_cut(tmp_path: Path) -> None:
    codec = Codec(3, 1)
    beat = {"type": 2, "autopilot": 3, "base_mode": 1, "custom_mode": 4, "system_status": 4, "mavlink_version": 3}
    frames = [codec.encode(Message("HEARTBEAT", beat)) for _ in range(3)]
    path = tmp_path / "telemetry.tlog"
    path.write_bytes(b"".join(struct.pack(">Q", 1) + frame for frame in frames)[:-4])
    assert [m.name for m in read_messages(path)] == ["HEARTBEAT"] * 2
    path.write_bytes(b"no log at all, but long enough")
    with pytest.raises(FileFormatError, match="damaged 0 bytes"):
        list(read_messages(path))
    with pytest.raises(FileFormatError, match="No such file"):
        list(read_messages(tmp_path / "none.tlog"))
