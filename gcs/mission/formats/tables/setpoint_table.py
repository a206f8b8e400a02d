"""The table in setpoint files: one row for every time and vehicle.

Positions are in the formation's common local NED frame. Its origin is in the file's metadata, because the local frame
of each vehicle begins at its own start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from gcs.frames import Origin
from gcs.mission.model import SetpointStream

# Name and unit. The name repeats the unit for readers that lose comments.
COLUMNS = {
    "t_s": "s",
    "sysid": "1",
    "north_m": "m",
    "east_m": "m",
    "down_m": "m",
    "v_north_mps": "m/s",
    "v_east_mps": "m/s",
    "v_down_mps": "m/s",
    "a_north_mps2": "m/s2",
    "a_east_mps2": "m/s2",
    "a_down_mps2": "m/s2",
    "yaw_ned_rad": "rad",
}
LARGEST_ID = 10_000  # of a plan; links carry at most 254
_MS = 1000


@dataclass(frozen=True)
class StreamFile:
    """Contents of one file: the stream of one or more vehicles, the hash of its plan, the origin of its frame."""

    stream: SetpointStream
    plan_hash: str = ""
    origin: Origin | None = None


def to_table(stream: SetpointStream) -> pa.Table:
    """The table, with rows by time, then by vehicle in the stream's order."""
    vehicles, instants = len(stream.sysids), len(stream.t_s)
    parts = (stream.position_ned_m, stream.velocity_ned_mps, stream.acceleration_ned_mps2)
    columns = [np.repeat(stream.t_s, vehicles), np.tile(np.array(stream.sysids, dtype=np.int32), instants)]
    columns += [part[..., axis].T.ravel() for part in parts for axis in range(3)]
    columns.append(stream.yaw_ned_rad.T.ravel())
    return pa.table(dict(zip(COLUMNS, columns, strict=True)))


def from_table(table: pa.Table) -> SetpointStream:
    """The stream in a table with exactly these columns. Raises ValueError for anything incomplete or out of order."""
    if table.num_rows == 0:
        raise ValueError("no rows")
    values = np.column_stack([table.column(name).to_numpy().astype(np.float64) for name in COLUMNS])
    if not np.isfinite(values).all():
        raise ValueError("a value is not a finite number")
    ids = values[values[:, 0] == values[0, 0], 1]
    if (ids != np.rint(ids)).any() or len(set(ids)) != len(ids) or ids.min() < 1 or ids.max() > LARGEST_ID:
        raise ValueError(f"{ids.tolist()[:9]} are not distinct system ids from 1 to {LARGEST_ID}")
    sysids = tuple(int(i) for i in ids)
    if len(values) % len(sysids):
        raise ValueError(f"{len(values)} rows are not a multiple of the {len(sysids)} vehicles")
    values = values.reshape(-1, len(sysids), len(COLUMNS))
    if (values[..., 1] != sysids).any() or (values[..., 0] != values[:, :1, 0]).any():
        raise ValueError(f"the rows of a time are not those of vehicles {sysids[:9]} in this order")
    t_s = values[:, 0, 0].copy()
    if (np.diff(t_s) <= 0).any() or (np.rint(t_s * _MS) / _MS != t_s).any():
        raise ValueError("times do not increase in whole milliseconds")
    by_vehicle = np.ascontiguousarray(values.swapaxes(0, 1))
    return SetpointStream(
        sysids, t_s, by_vehicle[..., 2:5], by_vehicle[..., 5:8], by_vehicle[..., 8:11], by_vehicle[..., 11]
    )
