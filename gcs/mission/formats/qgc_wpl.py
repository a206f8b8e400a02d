"""QGC WPL 110: tables of mission items, as Mission Planner, MAVProxy and QGroundControl read and write them.

`.waypoints`, `.fence` and `.rally` files are such tables of twelve tab-separated columns. In `.waypoints` files row 0
is home where the autopilot counts it. Numbers are written so that they are read back exactly, with at least 8 decimals:
6 decimals, which some programs write, move a waypoint by up to 6 cm each way.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission import geofence
from gcs.mission.formats.item_place import place_in_file
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.table_rows import HEADER, WITHOUT_HOME, TableRow, read_rows
from gcs.mission.formats.vendor_quirks import Quirk, QuirkKind, QuirkList, decoded
from gcs.mission.geofence import BadItem, Geofence, RallyPoint
from gcs.mission.model import Command, Frame, Home, MissionItem

_Value = TypeVar("_Value")
_HOME_COMMANDS = (int(Command.NAV_WAYPOINT), 0)  # some versions of Mission Planner write 0
_DECIMALS_MIN = 8


@dataclass(frozen=True)
class WaypointFile:
    """Contents of one table. `home` is None for autopilots that do not count it as item 0 (PX4)."""

    home: Home | None
    items: tuple[MissionItem, ...]
    lines: tuple[int, ...] = field(default=(), compare=False)  # where each item was read
    quirks: tuple[Quirk, ...] = field(default=(), compare=False)


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


def read_waypoints(text: str | bytes, source: str, *, home_first: bool | None = True) -> WaypointFile:
    """Contents of a table. `source` names it in errors; `home_first` says whether row 0 is home (ArduPilot) or an item.

    None: a first row that could be home is home. A table of version 120 has no home row. What other programs write
    otherwise is in `quirks`. Raises `FileFormatError` with file, line and reason for what cannot be flown as written.
    """
    quirks = QuirkList(source)
    version, rows = read_rows(decoded(text, source), source, quirks)
    if version == WITHOUT_HOME:
        home_first = False
    elif home_first is None:
        home_first = bool(rows) and rows[0].item.frame == Frame.GLOBAL and rows[0].item.command in _HOME_COMMANDS
    elif home_first and not rows:
        raise FileFormatError(f"{source}: no row 0, the home position.")
    home = _home(rows[0], source, quirks) if home_first else None
    items = rows[1:] if home_first else rows
    return WaypointFile(home, tuple(r.item for r in items), tuple(r.line for r in items), quirks.found())


def write_mission(file: MissionFile) -> str:
    """The text of a file that holds this mission, with home in row 0 where the autopilot counts it."""
    return write_waypoints(WaypointFile(file.home if file.firmware.home_is_item_0 else None, file.items))


def read_mission(data: bytes, source: str, firmware: Autopilot | None = None) -> MissionFile:
    """The mission in a file. Raises `FileFormatError` with file, line and reason.

    Without `firmware`, a first row that could be home is home. The file is then read as one for the first autopilot of
    the table that writes home there, or that does not.
    """
    table = read_waypoints(data, source, home_first=None if firmware is None else firmware.home_is_item_0)
    home_first = table.home is not None
    if firmware is None:
        firmware = next(known for known in Autopilot if known.home_is_item_0 == home_first)
    return MissionFile(
        source, firmware, table.home, table.items, lines=table.lines, jumps_from=int(home_first), quirks=table.quirks
    )


def write_fence(fence: Geofence) -> str:
    """The text of a file; `read_fence` gives back the same values."""
    return write_waypoints(WaypointFile(None, geofence.fence_items(fence)))


def read_fence(text: str | bytes, source: str) -> Geofence:
    """The fence in a file. Raises `FileFormatError` with file and reason."""
    return fence_in(read_waypoints(text, source, home_first=False), source)


def write_rally(points: Sequence[RallyPoint]) -> str:
    """The text of a file; `read_rally` gives back the same values."""
    return write_waypoints(WaypointFile(None, geofence.rally_items(points)))


def read_rally(text: str | bytes, source: str) -> tuple[RallyPoint, ...]:
    """The rally points in a file. Raises `FileFormatError` with file and reason."""
    return rally_in(read_waypoints(text, source, home_first=False), source)


def fence_in(table: WaypointFile, source: str) -> Geofence:
    """The fence in a table without home. Raises `FileFormatError` with file and reason."""
    return _converted(table, source, geofence.fence_from_items)


def rally_in(table: WaypointFile, source: str) -> tuple[RallyPoint, ...]:
    """The rally points in a table without home. Raises `FileFormatError` with file and reason."""
    return _converted(table, source, geofence.rally_from_items)


def _converted(table: WaypointFile, source: str, convert: Callable[[Sequence[MissionItem]], _Value]) -> _Value:
    items, skipped = table.items, 0
    if items and (items[0].frame, items[0].command) == (Frame.GLOBAL, Command.NAV_WAYPOINT):
        items, skipped = items[1:], 1
    try:
        return convert(items)
    except BadItem as error:
        raise FileFormatError(f"{source}, line {table.lines[error.index + skipped]}: {error}.") from error


def _home(row: TableRow, source: str, quirks: QuirkList) -> Home:
    """The home position in row 0. Raises `FileFormatError` for another row."""
    frame = row.item.frame
    if row.item.command not in _HOME_COMMANDS or frame == Frame.MISSION or frame not in tuple(Frame):
        message = f"{source}, line {row.line}: row 0 is not a home position (frame 0, command 16)."
        raise FileFormatError(message, hint="files for PX4 have no home row: give --autopilot px4 for them")
    if frame != Frame.GLOBAL:
        text = f"home is in frame {frame}, not 0; its altitude, {row.place[2]:g} m, counts as AMSL"
        quirks.add(QuirkKind.HOME, text, row.line)
    return Home(*row.place)


def _place(item: MissionItem) -> tuple[float, float, float]:
    return (*place_in_file(item), item.alt_m)


def _number(value: float) -> str:
    return np.format_float_positional(value, unique=True, min_digits=_DECIMALS_MIN, trim="k")
