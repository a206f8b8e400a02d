"""Setpoint streams: their ticks, their values, their end; the two files that hold them, and what readers refuse."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gcs.errors import FileFormatError
from gcs.frames import Origin
from gcs.mission.export.setpoint_stream import build_stream, of_vehicle
from gcs.mission.formats.tables.setpoint_table import COLUMNS, StreamFile, read_setpoints, write_setpoints
from gcs.mission.formats.tables.setpoints_parquet import read_setpoints_parquet, write_setpoints_parquet
from gcs.mission.model import SetpointStream
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin


@pytest.mark.parametrize("rate_hz", [3.0, 10.0, 25.0, 30.0])
def test_ticks_are_whole_milliseconds_with_one_at_T0(simulation1_plan: Plan, rate_hz: float) -> None:
    t_s = build_stream(simulation1_plan, rate_hz).t_s
    assert np.array_equal(np.rint(t_s * 1000) / 1000, t_s)
    assert 0.0 in t_s
    steps = np.diff(t_s)
    assert np.abs(steps[:-1] - 1 / rate_hz).max() <= 0.001 + 1e-9
    assert 0 < steps[-1] <= 1 / rate_hz + 0.001
    assert simulation1_plan.phase("takeoff").end_s <= t_s[0] < simulation1_plan.phase("takeoff").end_s + 1 / rate_hz
    assert t_s[-1] == simulation1_plan.phase("landing").start_s


def test_values_are_the_plans_to_a_micrometre_and_consistent(simulation1_plan: Plan) -> None:
    stream = build_stream(simulation1_plan, 25.0)
    states = simulation1_plan.states(stream.t_s)
    assert np.allclose(stream.position_ned_m, states[..., POSITION], atol=6e-7, rtol=0)
    assert np.allclose(stream.velocity_ned_mps[:, :-1], states[:, :-1, VELOCITY], atol=6e-7, rtol=0)
    assert np.allclose(stream.yaw_ned_rad, states[..., 8], atol=6e-7, rtol=0)
    # Velocity is what position does between ticks (trapezoid rule), acceleration what velocity does; at the joints
    # of the plan the acceleration may jump.
    joints = np.searchsorted(stream.t_s, simulation1_plan.joints_s)
    smooth = np.setdiff1d(np.arange(len(stream.t_s) - 1), np.concatenate([joints - 1, joints]))
    step = np.diff(stream.t_s)[None, :, None]
    for value, rate in (
        (stream.position_ned_m, stream.velocity_ned_mps),
        (stream.velocity_ned_mps, stream.acceleration_ned_mps2),
    ):
        change = np.diff(value, axis=1) - 0.5 * (rate[:, 1:] + rate[:, :-1]) * step
        assert np.abs(change[:, smooth]).max() < 1e-4


def test_the_stream_ends_at_rest(simulation1_plan: Plan) -> None:
    stream = build_stream(simulation1_plan, 25.0)
    assert not stream.velocity_ned_mps[:, -1].any()
    assert not stream.acceleration_ned_mps2[:, -1].any()


PARTS = ("t_s", "position_ned_m", "velocity_ned_mps", "acceleration_ned_mps2", "yaw_ned_rad")


@pytest.mark.parametrize(
    ("write", "read"),
    [(write_setpoints, read_setpoints), (write_setpoints_parquet, read_setpoints_parquet)],
    ids=["csv", "parquet"],
)
def test_the_whole_stream_survives_the_file(
    simulation1_plan: Plan, write: Callable[[StreamFile], bytes], read: Callable[[bytes, str], StreamFile]
) -> None:
    stream = build_stream(simulation1_plan, 5.0)
    origin = local_origin(simulation1_plan.scenario)
    for part in (stream, of_vehicle(stream, 3)):
        data = write(StreamFile(part, simulation1_plan.hash, origin))
        assert write(StreamFile(part, simulation1_plan.hash, origin)) == data
        back = read(data, "x")
        assert (back.plan_hash, back.origin) == (simulation1_plan.hash, origin)
        assert back.stream.sysids == part.sysids
        for name in PARTS:
            assert np.array_equal(getattr(back.stream, name), getattr(part, name))
    bare = read(write(StreamFile(stream)), "x")
    assert (bare.plan_hash, bare.origin) == ("", None)


def test_a_few_vehicles_are_the_same_as_among_all(simulation1_plan: Plan) -> None:
    whole, part = build_stream(simulation1_plan, 5.0), build_stream(simulation1_plan, 5.0, rows=slice(2, 4))
    assert part.sysids == whole.sysids[2:4]
    for name in PARTS[1:]:
        assert np.array_equal(getattr(part, name), getattr(whole, name)[2:4])


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 2000.0, np.nan])
def test_a_rate_without_ticks(simulation1_plan: Plan, rate_hz: float) -> None:
    with pytest.raises(ValueError, match="Hz"):
        build_stream(simulation1_plan, rate_hz)


STREAM = SetpointStream((3, 1), np.array([-0.04, 0.0]), *[np.ones((2, 2, 3))] * 3, np.zeros((2, 2)))
WHOLE = write_setpoints(StreamFile(STREAM, "abc", Origin(47.0, 8.5, 488.25))).decode().splitlines()
COMMENTS = sum(line.startswith("#") for line in WHOLE)
LINES = WHOLE[COMMENTS:]  # any program may lose the comments


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ([], "line 1 is not the header"),
        (LINES[1:], "line 1 is not the header"),
        (LINES[:1], "no rows"),
        (LINES[:-1], "rows are not a multiple"),
        ([*LINES[:3], LINES[4], LINES[3]], "in this order"),
        ([LINES[0], *LINES[3:], *LINES[1:3]], "times do not increase"),
        ([LINES[0], LINES[1], LINES[1]], "distinct system ids"),
        ([LINES[0], LINES[1].replace(",3,", ",10001,")], "distinct system ids"),
        ([LINES[0], LINES[1].replace(",3,", ",3.5,")], "distinct system ids"),
        ([LINES[0], LINES[1].replace("-0.04", "-0.0401")], "whole milliseconds"),
        ([LINES[0], LINES[1].replace(",1,", ",nan,", 1)], "finite"),
        ([LINES[0], LINES[1].replace(",1,", ",1e999,", 1)], "finite"),
        ([*LINES[:2], LINES[1].replace(",1,", ",one,", 1)], "line 3: .*one"),
        ([LINES[0], LINES[1] + ",7"], "line 2: .*columns"),
        ([*WHOLE[:-1], WHOLE[-1] + ",7"], f"line {len(WHOLE)}: .*columns"),
        (WHOLE[:-2], "4 rows announced, found 2"),
        ([line.replace("m/s2", "ft/s2") for line in WHOLE], "units are"),
        ([line.replace("47.0", "north") for line in WHOLE], "north"),
        ([line.replace("47.0 ", "") for line in WHOLE], "three numbers"),
    ],
)
def test_a_mistake_is_named(lines: list[str], reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason) as caught:
        read_setpoints("\n".join(lines), "s.setpoints")
    assert caught.value.message.startswith("s.setpoints: ")


def test_the_comments_say_what_the_table_is() -> None:
    assert WHOLE[1:COMMENTS] == [
        "# plan: abc",
        "# origin (lat_deg lon_deg alt_amsl_m): 47.0 8.5 488.25",
        "# rows: 4",
        "# units: s,1,m,m,m,m/s,m/s,m/s,m/s2,m/s2,m/s2,rad",
    ]
    bare = read_setpoints("\r\n".join(LINES), "x")
    assert (bare.plan_hash, bare.origin, bare.stream.sysids) == ("", None, STREAM.sysids)


def test_every_column_says_its_unit() -> None:
    assert LINES[0].split(",") == list(COLUMNS)
    assert all(c == "sysid" or c.endswith(("_s", "_m", "_mps", "_mps2", "_rad")) for c in COLUMNS)


def test_any_parquet_reader_finds_columns_and_units(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(write_setpoints_parquet(StreamFile(STREAM, "abc", Origin(47.0, 8.5, 488.25))))
    table = pq.read_table(path)
    assert {f.name: f.metadata[b"unit"].decode() for f in table.schema} == COLUMNS
    assert json.loads(table.schema.metadata[b"skein.setpoints"]) == {
        "plan": "abc",
        "origin": {"lat_deg": 47.0, "lon_deg": 8.5, "alt_amsl_m": 488.25},
    }
    assert table.column("t_s").to_pylist() == [-0.04, -0.04, 0.0, 0.0]
    assert table.column("sysid").to_pylist() == [3, 1, 3, 1]


def test_parquet_of_others_and_parquet_that_was_damaged(tmp_path: Path) -> None:
    def written(table: pa.Table) -> bytes:
        buffer = io.BytesIO()
        pq.write_table(table, buffer)
        return buffer.getvalue()

    ours = write_setpoints_parquet(StreamFile(STREAM))
    table = pq.read_table(io.BytesIO(ours))
    middle = ours.index(b"PAR1") + 40
    for data, reason in (
        (written(pa.table({"x": [1.0]})), "not a setpoint file of this program"),
        (written(table.replace_schema_metadata(None)), "not a setpoint file of this program"),
        (written(table.drop_columns(["yaw_ned_rad"])), "columns are"),
        (written(table.slice(0, 3)), "rows are not a multiple"),
        (written(table.slice(0, 0)), "no rows"),
        (ours[:-1], "Parquet|magic"),
        (ours[:middle] + bytes([ours[middle] ^ 1]) + ours[middle + 1 :], "x: "),
        (b"", "x: "),
    ):
        with pytest.raises(FileFormatError, match=reason) as caught:
            read_setpoints_parquet(data, "x")
        assert caught.value.message.startswith("x: ")
