"""The table in setpoint files, one row for every time and vehicle, and the table as CSV (`.setpoints`).

Positions are in the formation's common local NED frame. Its origin is in the file's metadata, because the local frame
of each vehicle begins at its own start.
"""

import math
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from gcs.errors import FileFormatError
from gcs.frames import Origin
from gcs.mission.formats.tables.csv_table import read_csv, with_units, write_csv
from gcs.mission.model import SetpointStream

COLUMNS = with_units(
    "t_s sysid north_m east_m down_m v_north_mps v_east_mps v_down_mps a_north_mps2 a_east_mps2 a_down_mps2 yaw_ned_rad"
)
LARGEST_ID = 10_000  # of a plan; links carry at most 254
_MS = 1000
_TITLE = "Skein setpoints: common local NED frame, t_s = 0 is T0"
_ORIGIN = "origin (lat_deg lon_deg alt_amsl_m)"
_ORIGIN_PARTS = 3


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


def write_setpoints(file: StreamFile) -> bytes:
    """The bytes of a file; `read_setpoints` gives back the same values."""
    comments = {"plan": file.plan_hash}
    if file.origin is not None:
        comments[_ORIGIN] = f"{file.origin.lat_deg!r} {file.origin.lon_deg!r} {file.origin.alt_amsl_m!r}"
    return write_csv(_TITLE, comments, COLUMNS, to_table(file.stream))


def read_setpoints(data: bytes | str, source: str) -> StreamFile:
    """Contents of a file; `source` names it in errors. Raises `FileFormatError` for anything else or incomplete."""
    try:
        comments, table = read_csv(data, COLUMNS)
        return StreamFile(from_table(table), comments.get("plan", ""), _origin(comments.get("origin")))
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.", hint="write the file again with `gcs export`") from error


def _origin(text: str | None) -> Origin | None:
    if text is None:
        return None
    numbers = [float(part) for part in text.split()]
    if len(numbers) != _ORIGIN_PARTS or not all(map(math.isfinite, numbers)):
        raise ValueError(f"the origin must be three numbers, got '{text[:60]}'")
    return Origin(*numbers)
