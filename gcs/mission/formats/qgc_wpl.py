"""QGC WPL 110: tables of mission items, as Mission Planner, MAVProxy and QGroundControl read and write them.

`.waypoints`, `.fence` and `.rally` files are such tables of twelve tab-separated columns. In `.waypoints` files row 0
is home where the autopilot counts it. Numbers are written so that they are read back exactly, with at least 8 decimals:
6 decimals, which some programs write, move a waypoint by up to 6 cm each way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.frames import from_degE7, to_degE7
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.geofence import (
    BadItem,
    Geofence,
    RallyPoint,
    fence_from_items,
    fence_items,
    rally_from_items,
    rally_items,
)
from gcs.mission.model import Command, Frame, Home, MissionItem

HEADER = "QGC WPL 110"

_Value = TypeVar("_Value")
_HOME_COMMANDS = (int(Command.NAV_WAYPOINT), 0)  # some versions of Mission Planner write 0
_COLUMNS = ("seq", "current", "frame", "command", "p1", "p2", "p3", "p4", "x", "y", "z", "autocontinue")
_DECIMALS_MIN = 8


@dataclass(frozen=True)
class WaypointFile:
    """Contents of one table. `home` is None for autopilots that do not count it as item 0 (PX4)."""

    home: Home | None
    items: tuple[MissionItem, ...]
    lines: tuple[int, ...] = field(default=(), compare=False)  # where each item was read


def write_waypoints(file: WaypointFile) -> str:
    """The text of a file; `read_waypoints` gives back the same values."""
    rows = []
    if file.home is not None:
        place = (file.home.lat_deg, file.home.lon_deg, file.home.alt_amsl_m)
        rows.append((int(Frame.GLOBAL), int(Command.NAV_WAYPOINT), (0.0,) * 4 + place, True))
    rows += [(i.frame, i.command, i.params + _place(i), i.autocontinue) for i in file.items]
    lines = [HEADER]
    for seq, (frame, command, numbers, autocontinue) in enumerate(rows):
        columns = (seq, int(seq == 0), frame, command, *map(_number, numbers), int(autocontinue))
        lines.append("\t".join(map(str, columns)))
    return "\n".join(lines) + "\n"


def read_waypoints(text: str | bytes, source: str, *, home_first: bool = True) -> WaypointFile:
    """Contents of a table. `source` names it in errors; `home_first` says whether row 0 is home (ArduPilot) or an item.

    Lines that begin with # are comments. Raises `FileFormatError` with file, line and reason for any other text.
    """
    lines = _decoded(text, source).splitlines()
    if not lines or lines[0].strip() != HEADER:
        raise FileFormatError(f"{source}, line 1: expected '{HEADER}'.", hint="give a file in the QGC WPL 110 format")
    items: list[MissionItem] = []
    places: list[int] = []
    home: Home | None = None
    row = 0
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            item, place = _item(line, row)
        except ValueError as error:
            raise FileFormatError(f"{source}, line {number}: {error}.") from error
        if row == 0 and home_first:
            if item.frame != Frame.GLOBAL or item.command not in _HOME_COMMANDS:
                raise FileFormatError(
                    f"{source}, line {number}: row 0 is not a home position (frame 0, command 16).",
                    hint="files for PX4 have no home row: give --autopilot px4 for them",
                )
            home = Home(*place)
        else:
            items.append(item)
            places.append(number)
        row += 1
    if home_first and home is None:
        raise FileFormatError(f"{source}: no row 0, the home position.")
    return WaypointFile(home, tuple(items), tuple(places))


def write_mission(file: MissionFile) -> str:
    """The text of a file that holds this mission, with home in row 0 where the autopilot counts it."""
    return write_waypoints(WaypointFile(file.home if file.firmware.home_is_item_0 else None, file.items))


def read_mission(data: bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file. Raises `FileFormatError` with file, line and reason.

    Without `firmware`, a first row that could be home is home. The file is then read as one for the first autopilot of
    the table that writes home there, or that does not.
    """
    home_first = _begins_with_home(data) if firmware is None else firmware.home_is_item_0
    table = read_waypoints(data, source, home_first=home_first)
    if firmware is None:
        firmware = next(known for known in Autopilot if known.home_is_item_0 == home_first)
    return MissionFile(source, firmware, table.home, table.items, lines=table.lines, jumps_from=int(home_first))


def write_fence(fence: Geofence) -> str:
    """The text of a file; `read_fence` gives back the same values."""
    return write_waypoints(WaypointFile(None, fence_items(fence)))


def read_fence(text: str | bytes, source: str) -> Geofence:
    """The fence in a file. Raises `FileFormatError` with file and reason."""
    return _read_items(text, source, fence_from_items)


def write_rally(points: Sequence[RallyPoint]) -> str:
    """The text of a file; `read_rally` gives back the same values."""
    return write_waypoints(WaypointFile(None, rally_items(points)))


def read_rally(text: str | bytes, source: str) -> tuple[RallyPoint, ...]:
    """The rally points in a file. Raises `FileFormatError` with file and reason."""
    return _read_items(text, source, rally_from_items)


def _begins_with_home(table: bytes) -> bool:
    """Whether the first row could be home: a waypoint in the absolute frame."""
    rows = (line.split() for line in table.splitlines()[1:] if line.strip() and not line.lstrip().startswith(b"#"))
    first = next(rows, [])
    return first[2:4] in [[b"%d" % Frame.GLOBAL, b"%d" % command] for command in _HOME_COMMANDS]


def _read_items(text: str | bytes, source: str, convert: Callable[[Sequence[MissionItem]], _Value]) -> _Value:
    file = read_waypoints(text, source, home_first=False)
    items, skipped = file.items, 0
    if items and (items[0].frame, items[0].command) == (Frame.GLOBAL, Command.NAV_WAYPOINT):
        items, skipped = items[1:], 1
    try:
        return convert(items)
    except BadItem as error:
        raise FileFormatError(f"{source}, line {file.lines[error.index + skipped]}: {error}.") from error


def _item(line: str, row: int) -> tuple[MissionItem, tuple[float, float, float]]:
    """The item in one row, and its position as written, with more digits than degE7 for home. Raises ValueError."""
    columns = line.strip("\r\n").split("\t")
    if len(columns) == 1:
        columns = line.split()
    if len(columns) != len(_COLUMNS):
        raise ValueError(f"{len(columns)} columns instead of {len(_COLUMNS)}")
    cell = dict(zip(_COLUMNS, columns, strict=True))
    if _integer(cell, "seq", 0xFFFF) != row:
        raise ValueError(f"seq is {cell['seq']}, but this is item {row}")
    _integer(cell, "current", 1)
    p1, p2, p3, p4 = (_float(cell, name) for name in ("p1", "p2", "p3", "p4"))
    x, y, z = place = tuple(_float(cell, name) for name in ("x", "y", "z"))
    if not all(map(math.isfinite, place)):
        raise ValueError("the position is not a number")
    frame = _integer(cell, "frame", 0xFF)
    lat, lon = wire_position(frame, x, y)
    item = MissionItem(
        _integer(cell, "command", 0xFFFF),
        frame,
        (p1, p2, p3, p4),
        lat,
        lon,
        z,
        bool(_integer(cell, "autocontinue", 1)),
    )
    return item, (x, y, z)


def wire_position(frame: int, x: float, y: float) -> tuple[int, int]:
    """Columns x and y in the units of links: degE7, or in frame 2 plain integers. Raises ValueError."""
    if frame == Frame.MISSION:
        if x != round(x) or y != round(y) or max(abs(x), abs(y)) >= 2**31:
            raise ValueError(f"parameters 5 and 6 of an item without a position must be integers, got {x}, {y}")
        return round(x), round(y)
    if abs(x) > 90 or abs(y) > 180:
        raise ValueError(f"latitude {x}, longitude {y} is not on Earth")
    return to_degE7(x), to_degE7(y)


def file_position(item: MissionItem) -> tuple[float, float]:
    """Inverse of `wire_position`."""
    if item.frame == Frame.MISSION:
        return float(item.lat_degE7), float(item.lon_degE7)
    return from_degE7(item.lat_degE7), from_degE7(item.lon_degE7)


def _place(item: MissionItem) -> tuple[float, float, float]:
    return (*file_position(item), item.alt_m)


def _number(value: float) -> str:
    return np.format_float_positional(value, unique=True, min_digits=_DECIMALS_MIN, trim="k")


def _integer(cell: dict[str, str], name: str, top: int) -> int:
    text = cell[name].strip()
    if not (text.isascii() and text.isdigit() and len(text) <= 9 and int(text) <= top):
        raise ValueError(f"{name} must be an integer from 0 to {top}, got '{text[:40]}'")
    return int(text)


def _float(cell: dict[str, str], name: str) -> float:
    text = cell[name].strip()
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{name} must be a number, got '{text[:40]}'") from None
    if math.isinf(value):
        raise ValueError(f"{name} is infinite")
    return value


def _decoded(text: str | bytes, source: str) -> str:
    if isinstance(text, str):
        return text
    try:
        return text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{source}: not a text file (byte {error.start}).") from error
