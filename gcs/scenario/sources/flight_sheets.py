"""The sheets of one flight: the places of all vehicles on the ground, and the places of each shape."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import UsageError, counted
from gcs.frames import Origin, place_up_m
from gcs.scenario.schema.formation_table import START_SHAPE
from gcs.scenario.schema.vehicle_types import preset_file
from gcs.scenario.sources.load import load_vehicle
from gcs.scenario.sources.sheet_cells import EAST, LATITUDE, LONGITUDE, NORTH, SheetRow, read_sheet, refuse
from gcs.scenario.validation.spacing import close_pairs, nearest_pair
from gcs.scenario.values.navigation_error import vehicle_size_m
from gcs.types import Array

_TYPE = "quad500"  # of the template
_FARTHEST_M = 20_000.0
_TOLD_PAIRS = 8


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
        return float(first) if first >= 1.0 else None


def read_flight_sheets(
    positions: Path,
    shapes: list[Path],
    origin: Origin | None,
    *,
    count: int | None = None,
    least_m: float | None = None,
) -> FlightSheets:
    """The sheets of a flight. Without an origin it is the place of the first vehicle, if that is in degrees.

    Raises UsageError for sheets with mistakes: vehicles that are missing, there twice, or nearer than `least_m`; left
    out, that is twice the size of a vehicle.
    """
    if least_m is None:
        least_m = math.floor(20.0 * vehicle_size_m(load_vehicle(preset_file(_TYPE)).vehicle)) / 10.0
    rows = read_sheet(positions)
    if origin is None and LATITUDE in rows[0].cells:
        origin = Origin(*_place(rows[0]), 0.0)
    first = _sheet(positions, rows, origin, least_m, pads=True)
    expected = set(first.sysids)
    if count is not None and count != len(expected):
        absent = sorted(set(range(1, count + 1)) - expected)
        missing = f"; missing: {_ids(absent)}" if absent else ""
        raise UsageError(
            f"{positions}: has {counted(len(expected), 'vehicle')}, and --count is {count}{missing}",
            hint="correct the sheet or --count",
        )
    sheets: list[Sheet] = []
    for file in shapes:
        if (name := _name_of(file)) in (START_SHAPE, *(sheet.name for sheet in sheets)):
            raise UsageError(f"{file}: another shape has the name {name}", hint="give the file another name")
        rows = read_sheet(file)
        _refuse_other_vehicles(file, rows, positions, expected)
        sheets.append(_sheet(file, rows, origin, least_m))
    return FlightSheets(first, tuple(sheets), origin)


def _refuse_other_vehicles(file: Path, rows: list[SheetRow], positions: Path, expected: set[int]) -> None:
    """Raise UsageError for a shape that has not the vehicles of the positions."""
    absent = sorted(expected - {row.number for row in rows})
    mistakes = [f"no row has vehicle {_ids(absent)}, which {positions.name} has"] * bool(absent)
    mistakes += [f"row {r.row}: {positions.name} has no vehicle {r.number}" for r in rows if r.number not in expected]
    refuse(file, mistakes)


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
    pairs = close_pairs(places_m * [1.0, 1.0, 0.0] if pads else places_m, least_m)
    what = "on the ground" if pads else "apart"
    told = [
        f"rows {rows[p.first].row} and {rows[p.second].row}: vehicles {rows[p.first].number} and "
        f"{rows[p.second].number} are {p.distance_m:.2f} m {what}; at least {least_m:.2f} m is needed"
        for p in pairs[:_TOLD_PAIRS]
    ]
    refuse(file, told + ["and more pairs"] * (len(pairs) > _TOLD_PAIRS))
    return Sheet(file, tuple(row.number for row in rows), places_m)


def _place(row: SheetRow) -> tuple[float, float]:
    return row.cells[LATITUDE], row.cells[LONGITUDE]


def _name_of(file: Path) -> str:
    return re.sub(r"[^a-z0-9_]+", "-", file.stem.lower()).strip("-_") or "shape"


def _ids(ids: list[int]) -> str:
    return ", ".join(map(str, ids[:10])) + (f" and {len(ids) - 10} more" if len(ids) > 10 else "")
