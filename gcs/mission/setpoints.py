"""Timed setpoints: what all vehicles should do at every tick, and the CSV that holds it.

Knows: sampling a plan on whole milliseconds, the file's columns. Does not know: links, each vehicle's own frame.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from gcs.errors import FileFormatError
from gcs.mission.model import SetpointStream
from gcs.quadrotor import POSITION, VELOCITY, Array

if TYPE_CHECKING:
    from gcs.mission.smooth import SmoothPath
    from gcs.plan.trajectory import Plan

# Units and frame of every column: metres, seconds and radians in the formation's common local NED frame.
COLUMNS = (
    "t_s",
    "sysid",
    "north_m",
    "east_m",
    "down_m",
    "v_north_mps",
    "v_east_mps",
    "v_down_mps",
    "a_north_mps2",
    "a_east_mps2",
    "a_down_mps2",
    "yaw_ned_rad",
)
_DECIMALS = 6  # micrometres: far below what float32 on the wire keeps
_MS = 1000
LARGEST_ID = 10_000  # of a fleet; links carry 254


def build_stream(plan: Plan, rate_hz: float, smooth: SmoothPath | None = None) -> SetpointStream:
    """Setpoints from the end of the takeoff to the end of the hover after the arrival, of the smoothed path if given.

    Ticks are t = k / rate_hz, rounded to whole milliseconds, so one is at T0. The last setpoint is at rest with zero
    acceleration: an autopilot flies on with the last velocity and acceleration it was given.
    """
    if not 0 < rate_hz <= _MS:
        raise ValueError(f"a rate of {rate_hz} Hz has no ticks on whole milliseconds")
    start_s, end_s = plan.phase("takeoff").end_s, plan.phase("landing").start_s
    ticks = np.arange(np.ceil(start_s * rate_hz - 1e-6), np.floor(end_s * rate_hz + 1e-6) + 1)
    t_ms = np.rint(ticks * _MS / rate_hz)
    last_ms = np.floor(end_s * _MS + 1e-6)
    t_s = np.append(t_ms[t_ms < last_ms], last_ms) / _MS
    if smooth is None:
        states = plan.states(t_s)
        parts = states[..., POSITION], states[..., VELOCITY], plan.accelerations(t_s), states[..., 8]
    else:
        parts = smooth.at(t_s)
    position, velocity, acceleration, yaw = map(_rounded, parts)
    velocity[:, -1] = acceleration[:, -1] = 0.0
    return SetpointStream(plan.sysids, t_s, position, velocity, acceleration, yaw)


def write_setpoints(stream: SetpointStream) -> str:
    """CSV text: one row per instant and vehicle. `read_setpoints` gives back the same values."""
    vehicles, instants = len(stream.sysids), len(stream.t_s)
    table = np.empty((instants, vehicles, len(COLUMNS)))
    table[..., 0] = stream.t_s[:, None]
    table[..., 1] = stream.sysids
    parts = (stream.position_ned_m, stream.velocity_ned_mps, stream.acceleration_ned_mps2)
    table[..., 2:11] = np.concatenate(parts, axis=-1).swapaxes(0, 1)
    table[..., 11] = stream.yaw_ned_rad.T
    rows = table.reshape(-1, len(COLUMNS)).tolist()
    lines = [",".join(COLUMNS)]
    lines += [f"{t:.3f},{sysid:.0f}," + ",".join(map(repr, rest)) for t, sysid, *rest in rows]
    return "\n".join(lines) + "\n"


def read_setpoints(text: str | bytes, source: str) -> SetpointStream:
    """The stream in a CSV; `source` names it in errors. Raises `FileFormatError` for anything else or incomplete."""
    try:
        decoded = text if isinstance(text, str) else text.decode("utf-8-sig")
        head, _, body = decoded.partition("\n")
        if head.strip() != ",".join(COLUMNS):
            raise ValueError("line 1 is not the header '" + ",".join(COLUMNS) + "'")
        if not body.strip():
            raise ValueError("no setpoints")
        return _stream(np.loadtxt(io.StringIO(body), delimiter=",", comments=None, ndmin=2))
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.", hint="write the file again with `gcs export`") from error


def _stream(table: Array) -> SetpointStream:
    """Rows (N V, 12) as a stream. Raises ValueError."""
    if table.shape[1] != len(COLUMNS):
        raise ValueError(f"{table.shape[1]} columns instead of {len(COLUMNS)}")
    if not np.isfinite(table).all():
        raise ValueError("there is a value that is not a finite number")
    ids = table[table[:, 0] == table[0, 0], 1]
    sysids = tuple(int(i) for i in ids)
    if len(table) % len(sysids):
        raise ValueError(f"{len(table)} rows do not hold {len(sysids)} vehicles at every instant")
    table = table.reshape(-1, len(sysids), len(COLUMNS))
    if (table[..., 1] != sysids).any() or (table[..., 0] != table[:, :1, 0]).any():
        raise ValueError(f"not every instant has vehicles {sysids} in this order")
    if len(set(sysids)) != len(sysids) or (ids != sysids).any() or min(sysids) < 1 or max(sysids) > LARGEST_ID:
        raise ValueError(f"{ids.tolist()} are not distinct system ids from 1 to {LARGEST_ID}")
    t_s = table[:, 0, 0].copy()
    if (np.diff(t_s) <= 0).any() or (np.rint(t_s * _MS) / _MS != t_s).any():
        raise ValueError("times must rise in whole milliseconds")
    by_vehicle = np.ascontiguousarray(table.swapaxes(0, 1))
    return SetpointStream(
        sysids, t_s, by_vehicle[..., 2:5], by_vehicle[..., 5:8], by_vehicle[..., 8:11], by_vehicle[..., 11]
    )


def _rounded(values: Array) -> Array:
    return np.asarray(np.round(values, _DECIMALS) + 0.0)  # + 0.0 turns -0.0 into 0.0
