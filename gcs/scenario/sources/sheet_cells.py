"""The rows and columns of a spreadsheet saved as CSV, as spreadsheets of several countries write it."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import UsageError, counted
from gcs.util.bounded_file import POSITION_SHEET, read_file

NUMBER, EAST, NORTH, HEIGHT, LATITUDE, LONGITUDE = "number", "x", "y", "z", "latitude", "longitude"
_NAMES = {
    NUMBER: ("number", "no", "nr", "id", "sysid", "vehicle", "drone", "uav"),
    EAST: ("x", "east", "easting"),
    NORTH: ("y", "north", "northing"),
    HEIGHT: ("z", "height", "up"),
    LATITUDE: ("latitude", "lat"),
    LONGITUDE: ("longitude", "lon", "lng", "long"),
}
_COLUMN_OF = {name: column for column, names in _NAMES.items() for name in names}
_UNIT = re.compile(r"[\s_]*[\[(]?(?:m|deg|degrees|metres|°)?[\])]?\.?$")
_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx and .ods; .xls
_ROWS_MAX, _TOLD_MAX = 254, 12
_PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_BOUNDS = {LATITUDE: 85.0, LONGITUDE: 180.0, NUMBER: 254.0}
_FARTHEST_M = 20_000.0
_EXAMPLE = "begin with a row of names, for example number,x,y,z or number,latitude,longitude,height"


@dataclass(frozen=True)
class SheetRow:
    """One row: its number in the file, counted from 1 as a spreadsheet does, and its numbers by column."""

    row: int
    cells: dict[str, float]

    @property
    def number(self) -> int:
        """The number of the vehicle."""
        return int(self.cells[NUMBER])

    @property
    def height_m(self) -> float:
        """Its height; 0 in a sheet without heights."""
        return self.cells.get(HEIGHT, 0.0)


def read_sheet(file: Path) -> list[SheetRow]:
    """The rows of a CSV file. Raises UsageError with every mistake and its row, or nothing is read."""
    text = _text(file)
    first = next((line for line in text.splitlines() if line.strip()), "")
    separator = max(";\t,", key=first.count)
    lines = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        filled = [(lines.line_num, line) for line in lines if any(cell.strip() for cell in line)]
    except csv.Error as problem:
        raise UsageError(f"{file}, row {lines.line_num}: {problem}", hint="save the sheet as CSV again") from None
    if not filled:
        raise UsageError(f"{file}: has no rows", hint=_EXAMPLE)
    columns = _columns(file, filled[0][1])
    if not 1 <= len(filled) - 1 <= _ROWS_MAX:
        has = counted(len(filled) - 1, "vehicle")
        raise UsageError(f"{file}: has {has}; a formation has 1 to {_ROWS_MAX}", hint="give one row for each vehicle")
    rows: list[SheetRow] = []
    mistakes: list[str] = []
    for number, line in filled[1:]:
        cells: dict[str, float] = {}
        for name, column in columns.items():
            cell = line[column].strip() if column < len(line) else ""
            try:
                cells[name] = _value(cell, name, decimal_comma=separator != ",")
            except ValueError as mistake:
                mistakes.append(f"row {number}, {name}: {mistake}")
        if len(cells) == len(columns):
            rows.append(SheetRow(number, cells))
    mistakes += _twice(rows)
    refuse(file, mistakes)
    return sorted(rows, key=lambda row: row.number)


def refuse(file: Path, mistakes: list[str]) -> None:
    """Raise UsageError for the mistakes of a sheet, if there are any."""
    if not mistakes:
        return
    told = mistakes[:_TOLD_MAX]
    if len(mistakes) > _TOLD_MAX:
        told.append(f"and {len(mistakes) - _TOLD_MAX} more")
    text = f"{file} has {counted(len(mistakes), 'mistake')}; nothing is written\n" + "\n".join(told)
    raise UsageError(text, hint="correct the sheet, and save it as CSV again")


def _text(file: Path) -> str:
    data = read_file(file, POSITION_SHEET, error=UsageError, hint="name the CSV file of the sheet")
    if data.startswith(_WORKBOOKS):
        raise UsageError(f"{file}: is a workbook, not CSV", hint='save the sheet as "CSV UTF-8" and name that file')
    for encoding in ("utf-8-sig", "cp1252"):  # spreadsheets on Windows write the second
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise UsageError(f"{file}: is not a text file", hint='save the sheet as "CSV UTF-8" and name that file')


def _columns(file: Path, header: list[str]) -> dict[str, int]:
    """Where each known column stands. Raises UsageError for one that is missing or there twice."""
    found: dict[str, int] = {}
    for place, title in enumerate(header):
        name = _COLUMN_OF.get(_UNIT.sub("", title.strip().lower()) or title.strip().lower())
        if name in found:
            raise UsageError(f"{file}, row 1: has two columns for {name}", hint=f"keep one column {name}")
        if name is not None:
            found[name] = place
    is_degrees = LATITUDE in found or LONGITUDE in found
    if is_degrees and (EAST in found or NORTH in found):
        raise UsageError(f"{file}, row 1: has metres and degrees", hint="keep x and y, or latitude and longitude")
    needed = (NUMBER, LATITUDE, LONGITUDE) if is_degrees else (NUMBER, EAST, NORTH)
    if missing := [name for name in needed if name not in found]:
        names = ", ".join(f'"{title.strip()}"' for title in header[:8])
        raise UsageError(f"{file}, row 1: has no column {', '.join(missing)}; its columns are {names}", hint=_EXAMPLE)
    return {name: found[name] for name in (*needed, HEIGHT) if name in found}


def _value(cell: str, name: str, *, decimal_comma: bool) -> float:
    """The number in a cell. Raises ValueError."""
    if not cell:
        raise ValueError("is empty")
    plain = cell.replace("\N{MINUS SIGN}", "-")
    if decimal_comma and plain.count(",") == 1 and "." not in plain:
        plain = plain.replace(",", ".")
    if not _PLAIN.fullmatch(plain):
        raise ValueError(f'"{cell[:40]}" is not a number')
    value = float(plain)
    if name == NUMBER and not (value.is_integer() and 1.0 <= value <= _BOUNDS[NUMBER]):
        raise ValueError(f"{cell[:40]} is not a system id; it must be a whole number from 1 to 254")
    if abs(value) > (most := _BOUNDS.get(name, _FARTHEST_M)):
        raise ValueError(f"{cell[:40]} is out of range; it must be from {-most:g} to {most:g}")
    return value


def _twice(rows: list[SheetRow]) -> Iterator[str]:
    first: dict[int, int] = {}
    for row in rows:
        if first.setdefault(row.number, row.row) != row.row:
            yield f"row {row.row}, number: vehicle {row.number} is there twice; it is in row {first[row.number]} too"
