"""Setpoint streams: their ticks, their values, their end, and what the CSV reader refuses."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import FileFormatError
from gcs.mission.model import SetpointStream
from gcs.mission.setpoints import COLUMNS, build_stream, read_setpoints, write_setpoints
from gcs.plan.trajectory import Plan
from gcs.quadrotor import POSITION, VELOCITY


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


def test_the_whole_stream_survives_the_file(simulation1_plan: Plan) -> None:
    stream = build_stream(simulation1_plan, 5.0)
    back = read_setpoints(write_setpoints(stream), "x")
    assert back.sysids == stream.sysids
    for name in ("t_s", "position_ned_m", "velocity_ned_mps", "acceleration_ned_mps2", "yaw_ned_rad"):
        assert np.array_equal(getattr(back, name), getattr(stream, name))


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 2000.0, np.nan])
def test_a_rate_without_ticks(simulation1_plan: Plan, rate_hz: float) -> None:
    with pytest.raises(ValueError, match="Hz"):
        build_stream(simulation1_plan, rate_hz)


STREAM = SetpointStream((3, 1), np.array([-0.04, 0.0]), *[np.ones((2, 2, 3))] * 3, np.zeros((2, 2)))
LINES = write_setpoints(STREAM).splitlines()


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ([], "header"),
        (LINES[1:], "header"),
        (LINES[:1], "no setpoints"),
        (LINES[:-1], "rows do not hold"),
        ([*LINES[:3], LINES[4], LINES[3]], "in this order"),
        ([LINES[0], *LINES[3:], *LINES[1:3]], "times must rise"),
        ([LINES[0], LINES[1], LINES[1]], "distinct system ids"),
        ([LINES[0], LINES[1].replace(",3,", ",10001,")], "distinct system ids"),
        ([LINES[0], LINES[1].replace("-0.040", "-0.0401")], "whole milliseconds"),
        ([LINES[0], LINES[1].replace("1.0", "nan", 1)], "finite"),
        ([LINES[0], LINES[1].replace("1.0", "one", 1)], "one"),
        ([LINES[0], LINES[1] + ",7"], "columns"),
    ],
)
def test_a_mistake_is_named(lines: list[str], reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason) as caught:
        read_setpoints("\n".join(lines), "s.csv")
    assert caught.value.message.startswith("s.csv: ")


def test_every_column_says_its_unit() -> None:
    assert LINES[0].split(",") == list(COLUMNS)
    assert all(c == "sysid" or c.endswith(("_s", "_m", "_mps", "_mps2", "_rad")) for c in COLUMNS)
