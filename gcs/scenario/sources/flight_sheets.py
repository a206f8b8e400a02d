"""The sheets of one flight, as CSV: the places of all vehicles on the ground, and the places of each shape.

Spreadsheets of several countries write CSV in their own ways.
"""

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import UsageError, counted
from gcs.frames import Origin, place_up_m
from gcs.scenario.schema.formation_table import START_SHAPE
from gcs.scenario.sources.flight_margins import VEHICLE_TYPE
from gcs.scenario.sources.load import vehicle_type
from gcs.scenario.validation.spacing import close_pairs, nearest_pair
from gcs.scenario.values.navigation_error import vehicle_size_m
from gcs.types import Array
from gcs.util.bounded_file import POSITION_SHEET, as_utf8, read_file

_LISTED_PAIRS = 8
_ROUNDING_M = 0.005  # two places written in millimetres are nearer or farther than they were computed
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
_ROWS_MAX, _LISTED_MAX = 254, 12
_PLAIN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_BOUNDS = {LATITUDE: 85.0, LONGITUDE: 180.0, NUMBER: 254.0}
_FARTHEST_M = 20_000.0
AIR_M = 0.1  # lower places of figures are on the ground: their sheets have heights above the flight's, not the origin's
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
    first_at: dict[int, int] = {}
    for row in rows:
        if (there := first_at.setdefault(row.number, row.row)) != row.row:
            text = f"vehicle {row.number} is there twice; it is in row {there} too"
            mistakes.append(f"row {row.row}, number: {text}")
    refuse(file, mistakes)
    return sorted(rows, key=lambda row: row.number)


def refuse(file: Path, mistakes: list[str]) -> None:
    """Raise UsageError for the mistakes of a sheet, if there are any."""
    if not mistakes:
        return
    listed = mistakes[:_LISTED_MAX]
    if len(mistakes) > _LISTED_MAX:
        listed.append(f"and {len(mistakes) - _LISTED_MAX} more")
    text = f"{file} has {counted(len(mistakes), 'mistake')}; nothing is written\n" + "\n".join(listed)
    raise UsageError(text, hint="correct the sheet, and save it as CSV again")


def _text(file: Path) -> str:
    data = read_file(file, POSITION_SHEET, error=UsageError, hint="name the CSV file of the sheet")
    if data.startswith(_WORKBOOKS):
        raise UsageError(f"{file}: is a workbook, not CSV", hint='save the sheet as "CSV UTF-8" and name that file')
    try:
        data = as_utf8(data)
    except ValueError as error:
        raise UsageError(f"{file}: {error}", hint='save the sheet as "CSV UTF-8" and name that file') from None
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


@dataclass(frozen=True)
class Sheet:
    """One sheet: its file, the vehicles in order, and their places (V, 3), north, east and up from the origin."""

    file: Path
    sysids: tuple[int, ...]
    places_m: Array

    @property
    def name(self) -> str:
        """The name of its shape."""
        return _name_of(self.file)

    @property
    def offsets_m(self) -> Array:
        """The places seen from the first vehicle, which leads."""
        return np.asarray((self.places_m - self.places_m[0]).round(3) + 0.0)

    def least_distance(self) -> str:
        """The nearest two vehicles, for people."""
        pair = nearest_pair(self.places_m)
        if pair is None:
            return "one vehicle"
        return f"at least {pair.distance_m:.2f} m apart ({self.sysids[pair.first]} and {self.sysids[pair.second]})"


@dataclass(frozen=True)
class FlightSheets:
    """The sheets of one flight, and the origin of their metres, if it is known."""

    positions: Sheet
    shapes: tuple[Sheet, ...]
    origin: Origin | None

    @property
    def height_m(self) -> float | None:
        """The leader's height in the first shape, else on its pad; None where that is on the ground."""
        first = (*self.shapes, self.positions)[0].places_m[0, 2]
        return float(first) if first >= AIR_M else None


def read_flight_sheets(
    positions: Path,
    shapes: list[Path],
    origin: Origin | None,
    *,
    count: int | None = None,
    least_m: float | None = None,
    vehicle: str = VEHICLE_TYPE,
) -> FlightSheets:
    """The sheets of a flight. Without an origin it is the place of the first vehicle, if that is in degrees.

    Raises UsageError for sheets with mistakes: vehicles that are missing, there twice, or nearer than `least_m`; left
    out, that is twice the size of a `vehicle`, a preset or a vehicle file.
    """
    if least_m is None:
        least_m = math.floor(20.0 * vehicle_size_m(vehicle_type(vehicle).vehicle)) / 10.0
    rows = read_sheet(positions)
    if origin is None and LATITUDE in rows[0].cells:
        origin = Origin(*_place(rows[0]), 0.0)
    first = _sheet(positions, rows, origin, least_m, pads=True)
    expected = set(first.sysids)
    if count is not None and count != len(expected):
        absent = sorted(set(range(1, count + 1)) - expected)
        missing = f"; missing: {_ids(absent)}" if absent else ""
        text = f"{positions}: has {counted(len(expected), 'vehicle')}, and --count is {count}{missing}"
        raise UsageError(text, hint="correct the sheet or --count")
    sheets: list[Sheet] = []
    for file in shapes:
        if (name := _name_of(file)) in (START_SHAPE, *(sheet.name for sheet in sheets)):
            raise UsageError(f"{file}: another shape has the name {name}", hint="give the file another name")
        rows = read_sheet(file)
        absent = sorted(expected - {row.number for row in rows})
        mistakes = [f"no row has vehicle {_ids(absent)}, which {positions.name} has"] * bool(absent)
        others = (row for row in rows if row.number not in expected)
        refuse(file, mistakes + [f"row {row.row}: {positions.name} has no vehicle {row.number}" for row in others])
        sheets.append(_sheet(file, rows, origin, least_m))
    return FlightSheets(first, tuple(sheets), origin)


def _sheet(file: Path, rows: list[SheetRow], origin: Origin | None, least_m: float, *, pads: bool = False) -> Sheet:
    heights_m = np.array([row.height_m for row in rows])
    if LATITUDE in rows[0].cells:
        if origin is None:
            raise UsageError(f"{file}: has degrees, and the origin is not known", hint="give it: --at LAT,LON[,ALT]")
        lat_deg, lon_deg = np.array([_place(row) for row in rows]).T
        places_m = place_up_m(lat_deg, lon_deg, heights_m, origin)
    else:
        places_m = np.array([[row.cells[NORTH], row.cells[EAST], row.height_m] for row in rows])
    farthest = int(np.abs(places_m[:, :2]).max(axis=1).argmax())
    if (far_m := float(np.abs(places_m[farthest, :2]).max())) > _FARTHEST_M:
        text = f"row {rows[farthest].row}: is {far_m:,.0f} m from the origin"
        refuse(file, [f"{text}; are latitude and longitude swapped, or is --at another place?"])
    pairs = close_pairs(places_m * [1.0, 1.0, 0.0] if pads else places_m, least_m - _ROUNDING_M)
    what = "on the ground" if pads else "apart"
    listed = [
        f"rows {rows[p.first].row} and {rows[p.second].row}: vehicles {rows[p.first].number} and "
        f"{rows[p.second].number} are {p.distance_m:.2f} m {what}; at least {least_m:.2f} m is needed"
        for p in pairs[:_LISTED_PAIRS]
    ]
    refuse(file, listed + ["and more pairs"] * (len(pairs) > _LISTED_PAIRS))
    return Sheet(file, tuple(row.number for row in rows), places_m)


def _place(row: SheetRow) -> tuple[float, float]:
    return row.cells[LATITUDE], row.cells[LONGITUDE]


def _name_of(file: Path) -> str:
    return re.sub(r"[^a-z0-9_]+", "-", file.stem.lower()).strip("-_") or "shape"


def _ids(ids: list[int]) -> str:
    return ", ".join(map(str, ids[:10])) + (f" and {len(ids) - 10} more" if len(ids) > 10 else "")
