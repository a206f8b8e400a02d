"""The record of a flight from its telemetry, and what is read out of it."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.autopilots.local_frame import local_frame
from gcs.cli.main import run
from gcs.errors import FileFormatError
from gcs.flight.assessment import judge
from gcs.flight.assessment.comparison import compare
from gcs.flight.assessment.judge import Truth
from gcs.flight.monitoring.lateness import Lateness, lateness_s, skew_s
from gcs.flight.monitoring.progress import PlanTime
from gcs.flight.recording.record_table import FlightReports, build_record, load_record
from gcs.flight.recording.tlog import Gap, LoggedFrame, scan
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from tests.real_flights import Flight, unpacked
from tests.unit.docs.test_readme import BLOCKS

T0, BOOT_S = 1_700_000_100.0, 1_700_000_000.0


def told(plan: Plan, late_s: dict[int, float]) -> list[Message]:
    """Vehicles that fly the plan, each so much too late, and tell it at 2 Hz."""
    messages = [
        Message("SYSTEM_TIME", {"time_unix_usec": round((BOOT_S + 1.0) * 1e6), "time_boot_ms": 1000}, sysid, 1)
        for sysid in plan.sysids
    ]
    beat = {"type": 2, "autopilot": 3, "base_mode": 128 | 1, "custom_mode": 4}
    messages += [Message("HEARTBEAT", beat, sysid, 1) for sysid in plan.sysids]
    for t_s in np.arange(0.0, 270.0, 0.5):
        for row, sysid in enumerate(plan.sysids):
            state = plan.states(np.array([t_s - late_s[sysid]]))[row, 0]
            frame = local_frame(3, local_origin(plan.scenario), plan.pads_ned_m[row])
            x, y, z = frame.own_m(state[POSITION])
            vx, vy, vz = state[VELOCITY] * frame.counts
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
    record = build_record(plan, PlanTime.of(T0), iter(told(plan, late_s)))
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
    record = build_record(plan, PlanTime.of(T0), messages)
    assert record.num_rows == 540 * 6
    assert float(np.max(record.column("error_m").to_numpy())) < 1e-6


def test_a_gimbal_with_a_clock_of_its_own_moves_no_row(simulation1_plan: Plan) -> None:
    plan, messages = simulation1_plan, []
    for message in told(plan, dict.fromkeys(plan.sysids, 0.0)):
        messages.append(message)
        if message.sysid == 2 and message.name == "LOCAL_POSITION_NED":
            beat = {"type": 26, "autopilot": 0, "base_mode": 0, "custom_mode": 9}
            messages.append(Message("HEARTBEAT", beat, 2, 154))
            for n in range(4):  # it was switched on a minute later, and reports more often
                boot_ms = message.fields["time_boot_ms"] - 60_000 + n
                messages.append(Message("GIMBAL_DEVICE_ATTITUDE_STATUS", {"time_boot_ms": boot_ms}, 2, 154))
            messages.append(Message("LOCAL_POSITION_NED", message.fields | {"x": 900.0}, 2, 154))
    record = build_record(plan, PlanTime.of(T0), messages)
    assert record.num_rows == 540 * 6
    assert float(np.max(record.column("error_m").to_numpy())) < 1e-6
    assert record.column("armed").to_pylist() == [True] * record.num_rows
    assert set(record.column("mode").to_pylist()) == {4}


def test_lateness_and_skew(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    late_s = {1: 0.02, 2: 0.02, 3: 0.05, 4: 0.02, 5: 0.0, 6: 0.02}
    record = build_record(plan, PlanTime.of(T0), iter(told(plan, late_s)))
    found = compare(plan, record, None, PlanTime.of(T0))
    assert {c.sysid: c.late_s for c in found} == pytest.approx(late_s, abs=1e-3)
    assert skew_s(c.late_s for c in found) == pytest.approx(0.05, abs=1e-3)
    assert all(np.isnan(c.plan_truth_m) for c in found)


def test_truth_beside_estimate_and_plan(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    record = build_record(plan, PlanTime.of(T0), iter(told(plan, dict.fromkeys(plan.sysids, 0.0))))
    t_s = np.arange(0.0, 274.0, 0.05)
    states = plan.states(t_s).copy()
    states[..., 0] += 0.3
    found = compare(plan, record, Truth(plan.sysids, T0 + t_s, states), PlanTime.of(T0))
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
    record = build_record(plan, PlanTime.of(T0), iter(messages))
    t_s, error = (record.column(name).to_numpy() for name in ("t_s", "formation_error_m"))
    assert np.nanmax(error[(t_s < 99.4) | (t_s > 120.1)]) < 0.05  # reports are half a second apart
    assert error[(t_s > 100.0) & (t_s < 119.0)] == pytest.approx(3.0 * 5 / 6, abs=0.05)
    silent = [m for m in messages if m.sysid != 4 or m.fields.get("time_boot_ms", 0) / 1e3 + BOOT_S - T0 < 150.0]
    record = build_record(plan, PlanTime.of(T0), iter(silent))
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
    *whole, rest = scan(path)
    assert [one.message.name for one in whole if isinstance(one, LoggedFrame) and one.message] == ["HEARTBEAT"] * 2
    assert isinstance(rest, Gap)
    assert rest.cut
    path.write_bytes(b"no log at all, but long enough")
    (damage,) = scan(path)
    assert isinstance(damage, Gap)
    assert (damage.at, damage.cut) == (0, False)
    with pytest.raises(FileFormatError, match="No such file"):
        list(scan(tmp_path / "none.tlog"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded flight with its report; its true states are made up: half a metre above the plan."""
    found = unpacked("arducopter-4.5.6-stream", tmp_path_factory.mktemp("flight"))
    assert run(["report", str(found)]) == 0
    flight = Flight(found)
    plan, t_s = flight.plan, np.arange(0.0, 20.0, 0.5)
    states = plan.states(t_s)
    states[..., 2] -= 0.5
    count = len(plan.sysids), len(t_s)
    with (found / "truth.npz").open("wb") as file:
        np.savez(
            file,
            t_s=t_s,
            t_unix_s=t_s + flight.t0_unix_s,
            state=states,
            control=np.zeros((*count, 4)),
            armed=np.ones(count, dtype=bool),
            flying=np.ones(count, dtype=bool),
            mode=np.zeros(count, dtype=np.int64),
            sysid=np.array(plan.sysids),
            boot_offset_s=np.zeros(len(plan.sysids)),
        )
    return found


def test_the_program_of_the_page_runs_on_a_flight(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = (b for b in BLOCKS["docs/python.md"] if "load_record" in b.code)
    code, count = re.subn(r'Path\("flights/[^"]+"\)', f"Path({str(folder)!r})", block.code)
    assert count == 1
    exec(compile(code, "docs/python.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[:-1]] == [f"vehicle {n}" for n in range(1, 7)]
    assert re.fullmatch(r"truly at least \d+\.\d\d m from no-fly zones", lines[-1])


def test_columns_by_name(folder: Path) -> None:
    reports = load_record(folder)
    assert reports.sysids == (1, 2, 3, 4, 5, 6)
    one = reports.of(3)
    assert set(one.sysid.tolist()) == {3}
    assert np.array_equal(one.position_ned_m[:, 0], one.column("north_m"))
    assert np.array_equal(one.planned_velocity_ned_mps[:, 2], one.column("planned_v_down_mps"), equal_nan=True)
    assert one.error_m == pytest.approx(
        np.linalg.norm(one.position_ned_m - one.planned_position_ned_m, axis=1), nan_ok=True
    )
    assert one.velocity_ned_mps.shape == one.position_ned_m.shape == (len(one.t_s), 3)
    assert len(one.formation_error_m) == len(one.t_s)
    with pytest.raises(KeyError, match="vehicle 9 has no row; those with one are 1, 2, 3"):
        reports.of(9)
    with pytest.raises(KeyError, match="'north' is no column; there are t_s, unix_s, sysid"):
        reports.column("north")


def test_true_states_by_name(folder: Path) -> None:
    truth, flight = gcs.load_truth(folder), Flight(folder)
    t_s = truth.t_s(flight.t0_unix_s)
    assert t_s == pytest.approx(np.arange(0.0, 20.0, 0.5), abs=1e-6)
    planned = flight.plan.states(np.arange(0.0, 20.0, 0.5))[..., POSITION]
    assert truth.named.height_m == pytest.approx(-planned[..., 2] + 0.5)
    assert np.array_equal(gcs.load_truth(str(folder / "truth.npz")).states, truth.states)


def test_a_folder_without_a_report_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError) as caught:
        load_record(tmp_path)
    assert caught.value.hint == "write it with `gcs report FOLDER`"


def test_the_page_has_every_column_and_accessor(folder: Path, repo_root: Path) -> None:
    page = (repo_root / "docs" / "python.md").read_text(encoding="utf-8")
    tables = [line for line in page.splitlines() if line.startswith("|")]
    named = set(re.findall(r"`(\w+)`", "\n".join(line.split("|")[1] for line in tables)))
    assert named == set(load_record(folder).table.column_names) | set(judge._TRUTH)
    for kind in (FlightReports, judge.Truth):
        for name, thing in vars(kind).items():
            assert not isinstance(thing, property) or f"`{name}`" in page, name
