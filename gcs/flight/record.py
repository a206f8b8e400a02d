"""The flight record: what vehicles told, beside what the plan wanted at the same instants, as one table (Parquet).

Knows: the `.tlog` of a flight's folder, its plan, its T0. Does not know: flying, truth, pictures. The record is made
from the log, so that there is one of a flight that was cut short as well.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from gcs.errors import FileFormatError
from gcs.link.clock import VehicleClock
from gcs.link.codec import Codec
from gcs.link.dialect import ModeFlag
from gcs.link.message import GROUND, Message
from gcs.plan.trajectory import Plan
from gcs.quadrotor import POSITION, VELOCITY

NAME = "record.parquet"
Row = tuple[float, int, float, float, float, float, float, float, bool, int, int]
_AXES = ("north", "east", "down")


def read_tlog(path: Path) -> Iterator[Message]:
    """Messages of a `.tlog` in both directions, up to where it was cut off. Raises FileFormatError."""
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise FileFormatError(f"{path}: {problem.strerror}") from None
    codec = Codec(*GROUND)
    at = 0
    while at + 10 <= len(data):
        (_,) = struct.unpack_from(">Q", data, at)
        magic, length = data[at + 8], data[at + 9]
        if magic not in (0xFD, 0xFE) or at + 11 > len(data):
            raise FileFormatError(f"{path} is damaged {at} bytes from its start.")
        size = length + 12 + 13 * (data[at + 10] & 1) if magic == 0xFD else length + 8
        frame = data[at + 8 : at + 8 + size]
        at += 8 + size
        if len(frame) == size:
            yield from codec.decode(frame, ("log", 0))


def build_record(plan: Plan, t0_unix_s: float, messages: Iterator[Message]) -> pa.Table:
    """One row for every position that a vehicle told once its time was known.

    Columns: t_s (plan time), sysid, north/east/down_m, v_..._mps, planned_..._m, planned_v_..._mps, error_m, armed,
    mode, battery_pct (-1: not told). Common local NED frame.
    """
    clocks = {sysid: VehicleClock() for sysid in plan.sysids}
    modes = dict.fromkeys(plan.sysids, (False, 0))
    battery = dict.fromkeys(plan.sysids, -1)
    rows: list[Row] = []
    for n, message in enumerate(messages):
        sysid = message.sysid
        if sysid not in clocks:
            continue
        clocks[sysid].receive(message, float(n))
        fields = message.fields
        if message.name == "HEARTBEAT":
            modes[sysid] = bool(fields["base_mode"] & ModeFlag.ARMED), int(fields["custom_mode"])
        elif message.name == "SYS_STATUS":
            battery[sysid] = int(fields["battery_remaining"])
        elif message.name == "LOCAL_POSITION_NED":
            unix_s = clocks[sysid].unix_s(fields["time_boot_ms"])
            if unix_s is not None:
                motion = (fields[name] for name in ("x", "y", "z", "vx", "vy", "vz"))
                rows.append((unix_s - t0_unix_s, sysid, *motion, *modes[sysid], battery[sysid]))
    return _table(plan, rows)


def write_record(folder: Path, plan: Plan, t0_unix_s: float) -> pa.Table:
    """Make the record of a flight's folder from its telemetry, and keep it there."""
    logs = sorted(folder.glob("telemetry*.tlog"), key=lambda path: path.stat().st_mtime)
    table = build_record(plan, t0_unix_s, (message for path in logs for message in read_tlog(path)))
    pq.write_table(table, folder / NAME, compression="zstd")
    return table


def _table(
    plan: Plan, rows: list[tuple[float, int, float, float, float, float, float, float, bool, int, int]]
) -> pa.Table:
    columns = list(zip(*rows, strict=True)) or [()] * 11
    t_s, sysids = np.array(columns[0], dtype=np.float64), np.array(columns[1], dtype=np.int64)
    told = np.array(columns[2:8], dtype=np.float64).reshape(6, -1).T
    planned = np.full((len(t_s), 6), np.nan)
    inside = np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    for row, sysid in enumerate(plan.sysids):
        mine = sysids == sysid
        told[mine, :3] += plan.pads_ned_m[row]
        if mine.any():
            states = plan.states(inside[mine])[row]
            planned[mine] = np.hstack([states[:, POSITION], states[:, VELOCITY]])
    planned[(t_s < plan.t_start_s) | (t_s > plan.t_end_s)] = np.nan
    data: dict[str, object] = {"t_s": t_s, "sysid": sysids}
    for name, values in (("", told), ("planned_", planned)):
        data |= {f"{name}{axis}_m": values[:, n] for n, axis in enumerate(_AXES)}
        data |= {f"{name}v_{axis}_mps": values[:, 3 + n] for n, axis in enumerate(_AXES)}
    data["error_m"] = np.linalg.norm(told[:, :3] - planned[:, :3], axis=1)
    data["armed"] = np.array(columns[8], dtype=bool)
    data["mode"], data["battery_pct"] = (np.array(columns[n], dtype=np.int64) for n in (9, 10))
    return pa.table(data)
