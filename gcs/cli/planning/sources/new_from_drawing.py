"""`gcs new --route`: the scenario of a drawn route, and what is said about the drawing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcs.cli.console import Screen
from gcs.errors import counted
from gcs.mission.drawings.drawing import sentences
from gcs.mission.drawings.read_drawing import read_drawing
from gcs.mission.drawings.to_scenario.route_flight import route_flight
from gcs.scenario.template import scenario_text


def text_of_drawing(
    folder: Path, file: Path, wanted: dict[str, Any], at: tuple[float, float, float | None] | None, screen: Screen
) -> tuple[str, list[str]]:
    """The text of the scenario, and the sentences about what is not carried over.

    Raises FileFormatError for a file that is no drawing of a route, and UsageError for a flight that is not possible.
    """
    flight = route_flight(read_drawing(file), at, wanted.pop("height_m", None), **wanted)
    origin = flight.route.origin
    text = scenario_text(
        folder, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m, flight=flight, template="template_route.toml"
    )
    areas = [
        counted(len(tables), noun, plural)
        for tables, noun, plural in (
            (flight.areas.keep_in, "area to stay in", "areas to stay in"),
            (flight.areas.no_fly, "no-fly zone", ""),
        )
        if tables
    ]
    way = f"{counted(len(flight.route.points), 'point')}{', and back to the start' if flight.route.returns else ''}"
    screen.say(f"{file}: {', '.join([way, f'{flight.length_m:.0f} m in {flight.flight_s:.0f} s', *areas])}")
    left_out = sentences(flight.left_out)
    for sentence in left_out:
        screen.say(f"  {sentence}")
    return text, left_out
