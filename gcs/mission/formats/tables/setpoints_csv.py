"""`.setpoints` files: the setpoint table as CSV, with plan hash and origin in comments. Both may be missing."""

from __future__ import annotations

import math

from gcs.errors import FileFormatError
from gcs.frames import Origin
from gcs.mission.formats.tables.csv_table import read_csv, write_csv
from gcs.mission.formats.tables.setpoint_table import COLUMNS, StreamFile, from_table, to_table

_TITLE = "Skein setpoints: common local NED frame, t_s = 0 is T0"
_ORIGIN = "origin (lat_deg lon_deg alt_amsl_m)"
_ORIGIN_PARTS = 3


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
