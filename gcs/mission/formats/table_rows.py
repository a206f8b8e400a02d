"""The rows of a QGC WPL table, version 100, 110 or 120, as generously as MAVProxy and QGroundControl read them.

MAVProxy splits rows at blanks, skips comments and blank lines, and numbers the items itself. QGroundControl splits rows
at tabs, and reads an empty cell as 0. Version 100 has 13 columns and commands of its own. Version 120 has no home row.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import FileFormatError
from gcs.mavlink import MavCommand
from gcs.mission.formats.item_place import Note, place_on_wire
from gcs.mission.formats.vendor_quirks import QuirkKind, QuirkList, significant_lines
from gcs.mission.model import MissionItem

HEADER, HEADER_100 = "QGC WPL 110", "QGC WPL 100"
WITHOUT_HOME = "120"
_COLUMNS = ("seq", "current", "frame", "command", "p1", "p2", "p3", "p4", "x", "y", "z", "autocontinue")
_COLUMNS_100 = ("seq", "frame", "command", "p3", "p4", "p1", "p2", "current", "y", "x", "z", "yaw", "autocontinue")
_PARAMS = ("p1", "p2", "p3", "p4")
_VERSIONS = {"100": _COLUMNS_100, "110": _COLUMNS, WITHOUT_HOME: _COLUMNS}
_COMMANDS_100 = {  # of version 100, in MAV_CMD
    **dict.fromkeys((2, 24), MavCommand.NAV_TAKEOFF),
    **dict.fromkeys((4, 26), MavCommand.NAV_LAND),
    **{3: MavCommand.NAV_RETURN_TO_LAUNCH, 25: MavCommand.NAV_WAYPOINT, 27: MavCommand.NAV_LOITER_UNLIM},
}
_SEQ = re.compile(r"[+-]?[0-9]{1,9}")


@dataclass(frozen=True)
class TableRow:
    """One row: the item in it, its place as written, with more digits than degE7 for home, and where it was read."""

    line: int
    seq: int | None
    item: MissionItem
    place: tuple[float, float, float]


def read_rows(text: str, source: str, quirks: QuirkList) -> tuple[str, list[TableRow]]:
    """The version of a table, and its rows. Raises `FileFormatError` with file, line and reason."""
    bodies = list(significant_lines(text, quirks))
    first, header = bodies[0] if bodies else (1, "")
    version = re.fullmatch(r"QGC\s+WPL\s+([0-9]+)\s*", header)
    if version is None or version[1] not in _VERSIONS:
        message = f"{source}, line {first}: expected '{HEADER}'."
        raise FileFormatError(message, hint="give a file in the QGC WPL 110, 120 or 100 format")
    if header.strip() != HEADER:
        quirks.add(QuirkKind.VERSION, f"'{header.strip()}' instead of '{HEADER}'", first)
    rows: list[TableRow] = []
    for number, body in bodies[1:]:
        try:
            rows.append(_row(body, number, version[1], quirks))
        except ValueError as error:
            raise FileFormatError(f"{source}, line {number}: {error}.") from error
    _check_numbers(rows, source, quirks)
    return version[1], rows


def _row(body: str, number: int, version: str, quirks: QuirkList) -> TableRow:
    """The row in one line. Raises ValueError."""

    def note(kind: QuirkKind, text: str) -> None:
        quirks.add(kind, text, number)

    columns = _VERSIONS[version]
    cell = dict(zip(columns, _cells(body, len(columns), note), strict=True))
    frame, command = _integer(cell, "frame", 0xFF), _integer(cell, "command", 0xFFFF)
    if version == "100":
        if command not in _COMMANDS_100:
            raise ValueError(
                f"command {command} is not one of {HEADER_100}: {', '.join(map(str, sorted(_COMMANDS_100)))}"
            )
        command = _COMMANDS_100[command]
        if cell["yaw"] and _float(cell, "yaw"):
            note(QuirkKind.YAW, f"yaw {cell['yaw']} of {HEADER_100} is ignored, as MAVProxy does")
    if cell["current"] and _integer(cell, "current", 0xFF) > 1:
        note(QuirkKind.CURRENT, f"column current is {cell['current']}: ignored")
    if cell["seq"] and not _SEQ.fullmatch(cell["seq"]):
        raise ValueError(f"seq must be an integer, got '{cell['seq'][:40]}'")
    for name in _PARAMS:
        if not cell[name]:
            note(QuirkKind.EMPTY, f"{name} is empty: read as 0, as QGroundControl does")
    p1, p2, p3, p4 = (_float(cell, name) if cell[name] else 0.0 for name in _PARAMS)
    place = [_float(cell, name) if cell[name] else None for name in ("x", "y", "z")]
    lat, lon, alt_m = place_on_wire(command, frame, place, note)
    item = MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt_m, bool(_integer(cell, "autocontinue", 1)))
    x, y, z = (0.0 if value is None else value for value in place)
    return TableRow(number, int(cell["seq"]) if cell["seq"] else None, item, (x, y, z))


def _cells(body: str, count: int, note: Note) -> list[str]:
    """The cells of a row, without blanks around them; empty ones only where tabs separate the columns."""
    by_tabs, by_blanks = body.split("\t"), body.split()
    stripped = [cell.strip() for cell in by_tabs]
    if by_tabs == by_blanks and len(by_tabs) == count:
        return by_tabs
    if len(stripped) == count and ("" in stripped or len(by_blanks) != count):
        return stripped
    if len(by_blanks) != count:
        raise ValueError(f"{len(by_blanks)} columns instead of {count}")
    note(QuirkKind.SEPARATOR, "columns separated or surrounded by blanks; QGroundControl reads only tabs")
    return by_blanks


def _check_numbers(rows: Sequence[TableRow], source: str, quirks: QuirkList) -> None:
    """Count wrong numbers. Refuse a jump to a number that is not exactly one item, and that in its place."""
    wrong = [(place, row) for place, row in enumerate(rows) if row.seq != place]
    for place, row in wrong:
        number = "empty" if row.seq is None else row.seq
        text = f"seq is {number}, but this is item {place}: the order of the rows counts"
        quirks.add(QuirkKind.SEQ, text, row.line)
    if not wrong:
        return
    for row in rows:
        target = row.item.params[0]
        if row.item.command != MavCommand.DO_JUMP or not target.is_integer():
            continue
        named = [place for place, other in enumerate(rows) if other.seq == target]
        if named != [round(target)] and (named or 0 <= target < len(rows)):
            raise FileFormatError(
                f"{source}, line {row.line}: jumps to item {target:.0f}, and the items are not numbered in order.",
                hint=f"number the rows 0, 1, 2, ...; line {wrong[0][1].line} is the first wrong one",
            )


def _integer(cell: dict[str, str], name: str, top: int) -> int:
    text = cell[name]
    if not (text.isascii() and text.isdigit() and len(text) <= 9 and int(text) <= top):
        raise ValueError(f"{name} must be an integer from 0 to {top}, got '{text[:40]}'")
    return int(text)


def _float(cell: dict[str, str], name: str) -> float:
    try:
        value = float(cell[name])
    except ValueError:
        raise ValueError(f"{name} must be a number, got '{cell[name][:40]}'") from None
    if math.isinf(value):
        raise ValueError(f"{name} is infinite")
    return value
