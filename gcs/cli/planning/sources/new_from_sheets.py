"""`gcs new --positions`: the flight of sheets, and what is said about them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcs.cli.console import Screen
from gcs.errors import counted
from gcs.frames import Origin
from gcs.scenario.sheets.flight_sheets import read_flight_sheets
from gcs.scenario.sheets.sheet_flight import SheetFlight
from gcs.scenario.template import FirstFlight


def flight_of_sheets(
    positions: Path, shapes: list[Path], wanted: dict[str, Any], at: tuple[float, float, float] | None, screen: Screen
) -> tuple[SheetFlight, tuple[float, float, None] | None]:
    """The flight; and its origin where that is the place of the first vehicle. Raises UsageError for a wrong sheet."""
    read = read_flight_sheets(
        positions,
        shapes,
        None if at is None else Origin(*at),
        count=wanted.get("count"),
        least_m=wanted.get("spacing_m"),
    )
    plain = FirstFlight()
    flight = SheetFlight(
        read.positions,
        read.shapes,
        wanted.get("course_deg", plain.course_deg),
        wanted.get("distance_m", plain.distance_m),
        wanted.get("height_m", read.height_m or plain.height_m),
        wanted.get("end_deg"),
    )
    for sheet in (read.positions, *read.shapes):
        screen.say(f"{sheet.file}: {counted(len(sheet.sysids), 'vehicle')}, {sheet.least_distance()}")
    if holes := sorted(
        set(range(min(flight.positions.sysids), max(flight.positions.sysids))) - set(flight.positions.sysids)
    ):
        screen.say(f"WARNING: {positions} has no vehicle {', '.join(map(str, holes))}; --count N makes that a mistake")
    if flight.is_close:
        screen.say('vehicles stand too near for ordinary GNSS: the scenario has sensors.grade = "rtk"')
    if at is not None or read.origin is None:
        return flight, None
    screen.say(f"the origin is the place of vehicle {read.positions.sysids[0]}")
    return flight, (read.origin.lat_deg, read.origin.lon_deg, None)
