"""`gcs new`: write a first scenario, which plans as it is. `gcs schema`: the JSON Schema of scenario files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from gcs.cli.console import Screen
from gcs.cli.planning.new_options import COURSES, SurveyOptions, check_survey, parse_course, parse_place
from gcs.cli.shared_options import DebugOption, JsonOption, one_of, unknown_choice, within
from gcs.errors import UsageError

_ORIGIN = (-35.363262, 149.165237, 584.0)  # the default home of ArduPilot's simulators
SHAPES = ("triangle", "line", "column", "vee", "grid", "circle", "sphere")
OTHER_NAMES = {"wedge": "vee", "v": "vee", "abreast": "line", "row": "line", "ring": "circle", "square": "grid"}


def new(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Folder to make. Its last part names the scenario.", show_default=False),
    ],
    at: Annotated[
        str | None,
        typer.Option(
            "--at",
            metavar="LAT,LON[,ALT]",
            help="Origin: degrees, degrees, m above mean sea level. Spaces do as well as commas.",
            show_default="the field of ArduPilot's simulators",
        ),
    ] = None,
    count: Annotated[int | None, typer.Option("--count", metavar="N", help="Vehicles.", show_default="6")] = None,
    shape: Annotated[
        str | None,
        typer.Option(
            "--shape",
            metavar="SHAPE",
            help=f"Formation: {', '.join(SHAPES[:-1])} or {SHAPES[-1]}. It faces the course.",
            show_default="vee",
            autocompletion=one_of(*SHAPES),
        ),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option("--spacing", metavar="METRES", help="Distance between neighbours.", show_default="10"),
    ] = None,
    course: Annotated[
        str | None,
        typer.Option(
            "--course",
            metavar="COURSE",
            help="Direction of the flight: north-east, ne, or degrees clockwise from north.",
            show_default="north",
            autocompletion=one_of(*COURSES),
        ),
    ] = None,
    distance: Annotated[
        float | None, typer.Option("--distance", metavar="METRES", help="Length of the flight.", show_default="300")
    ] = None,
    end: Annotated[
        str | None,
        typer.Option(
            "--end",
            metavar="LAT,LON",
            help="End of the flight, degrees, instead of --course and --distance.",
            show_default=False,
        ),
    ] = None,
    height: Annotated[
        float | None,
        typer.Option("--height", metavar="METRES", help="Height of the flight above the origin.", show_default="15"),
    ] = None,
    positions: Annotated[
        Path | None,
        typer.Option(
            "--positions",
            metavar="FILE.csv",
            help="Sheet with the places of all vehicles on the ground: number, x (east), y (north), z (height) in m, "
            "or number, latitude, longitude, height. Instead of --shape.",
            show_default=False,
        ),
    ] = None,
    shapes: Annotated[
        list[Path] | None,
        typer.Option(
            "--shapes",
            metavar="FILE.csv",
            help="With --positions: sheet with a shape to take on the way. Repeat it for several.",
            show_default=False,
        ),
    ] = None,
    route: Annotated[
        Path | None,
        typer.Option(
            "--route",
            metavar="FILE",
            help="Route drawn in another program: .plan, .waypoints, .kml, .kmz, .gpx or .geojson. Instead of "
            "--course, --distance and --end. --height counts for points without a height.",
            show_default=False,
        ),
    ] = None,
    survey: Annotated[
        Path | None,
        typer.Option(
            "--survey",
            metavar="AREA",
            help="Drawing with the polygon of an area (KML, KMZ, GeoJSON, .plan): a line abreast mows it, there and "
            "back. It flies from --at, or where the first pass begins, and comes home.",
            show_default=False,
        ),
    ] = None,
    swath: Annotated[
        float | None,
        typer.Option("--swath", metavar="METRES", help="Width that a vehicle sees on its way.", show_default=False),
    ] = None,
    overlap: Annotated[
        str | None,
        typer.Option(
            "--overlap",
            metavar="SHARE",
            help="Share of the swath that neighbours see both, at least: 20% or 0.2.",
            show_default="20%",
        ),
    ] = None,
    angle: Annotated[
        str | None,
        typer.Option(
            "--angle",
            metavar="COURSE",
            help="Direction of the passes: auto is the quickest one; or as --course.",
            show_default="auto",
        ),
    ] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", metavar="M/S", help="Speed of a survey.", show_default="4")
    ] = None,
    holes: Annotated[
        str | None,
        typer.Option(
            "--holes",
            metavar="cross|avoid",
            help="Holes of the area, ponds for example, are not surveyed. cross: vehicles fly over them; avoid: they "
            "are no-fly zones.",
            show_default="cross",
            autocompletion=one_of("cross", "avoid"),
        ),
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="Write every table, with comments.")] = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a short scenario that plans at once.

    Without options the flight passes a no-fly zone; with any of --count to --height it has none.

    With --positions vehicles and shapes come from spreadsheets saved as CSV (UTF-8); a sheet with a mistake is refused,
    with its rows. --spacing is then the least distance that is allowed, and --count the number that must be there.

    With --route the formation flies along a route that was drawn, or recorded, in another program. What the scenario
    cannot carry over is printed, with the number and the name of each item. The origin is the planned home, else the
    first point; --at gives another.

    With --survey the formation keeps its direction and flies sideways between passes. Without --count four to six
    vehicles fly, with it at most so many. --spacing follows from --swath and --overlap.

    Examples: gcs new plans/first

    gcs new plans/line --at 47.39,8.54 --count 4 --shape line --spacing 8 --course north-east --distance 400

    gcs new plans/there --at 47.39,8.54 --end 47.393,8.546

    gcs new plans/show --at 46.95,7.44,540 --positions grid.csv --shapes star.csv --shapes ring.csv --height 40

    gcs new plans/valley --route valley.plan --count 4 --shape line

    gcs new plans/meadow --survey meadow.kml --swath 12 --overlap 20% --height 30

    gcs new plans/whole --at 47.3977 8.5456 488 --full
    """
    screen = Screen(json=json)
    _check(count, shape, spacing, distance, height)
    end_deg = None if end is None else parse_place(end, "--end")[:2]
    if end_deg is not None and (course is not None or distance is not None):
        raise UsageError("--end gives the course and the distance.", hint="leave out --course and --distance")
    if positions is not None and (shape is not None or full):
        wrong = "--full" if full else "--shape"
        raise UsageError(f"--positions and {wrong} exclude each other.", hint=f"leave out {wrong}")
    if shapes and positions is None:
        raise UsageError("--shapes needs --positions.", hint="give the places on the ground too: --positions FILE.csv")
    surveyed = SurveyOptions(swath, overlap, angle, speed, holes)
    flights = {"--positions": positions, "--course": course, "--distance": distance, "--end": end, "--full": full}
    if route is not None:
        _exclude("--route", {**flights, "--survey": survey})
    if survey is not None:
        _exclude("--survey", {**flights, "--shape": shape, "--spacing": spacing})
        check_survey(surveyed)
    elif surveyed.given():
        raise UsageError(f"{surveyed.given()[0]} needs --survey.", hint="give the area too: --survey AREA")
    given: dict[str, Any] = {
        "count": count,
        "shape": shape,
        "spacing_m": spacing,
        "course_deg": None if course is None else parse_course(course),
        "distance_m": distance,
        "height_m": height,
        "end_deg": end_deg,
    }
    lat_deg, lon_deg, alt_amsl_m = _ORIGIN if at is None else parse_place(at)
    from gcs.files import atomic_write
    from gcs.scenario.load import FILE_NAME
    from gcs.scenario.template import FirstFlight, Flight, scenario_text, straight_to

    file = folder / FILE_NAME
    if file.exists():
        raise UsageError(f"{file} exists already.", hint="choose another name, or delete the file first")
    if end_deg is not None:
        given |= straight_to(end_deg, (lat_deg, lon_deg))
    wanted = {key: value for key, value in given.items() if value is not None}
    flight: Flight | None = FirstFlight(**wanted) if wanted else None
    if positions is not None:
        from gcs.cli.planning.new_flights import flight_of_sheets

        origin = None if at is None else (lat_deg, lon_deg, alt_amsl_m or 0.0)
        flight, place = flight_of_sheets(positions, shapes or [], wanted, origin, screen)
        lat_deg, lon_deg, alt_amsl_m = place or (lat_deg, lon_deg, alt_amsl_m)
    if route is not None:
        from gcs.cli.planning.new_flights import text_of_drawing

        text, left_out = text_of_drawing(folder, route, wanted, None if at is None else parse_place(at), screen)
        atomic_write(file, text)
        screen.say(f"wrote {file}")
        screen.say(f"next: gcs plan {folder}")
        screen.result({"scenario": file, "left_out": left_out})
        return
    if survey is not None:
        origin = None if at is None else (lat_deg, lon_deg, alt_amsl_m or 0.0)
        from gcs.cli.planning.new_flights import flight_of_survey

        flight, place = flight_of_survey(survey, surveyed, origin, count, height, screen)
        lat_deg, lon_deg, alt_amsl_m = place or (lat_deg, lon_deg, alt_amsl_m)
    atomic_write(file, scenario_text(folder, lat_deg, lon_deg, alt_amsl_m or 0.0, full=full, flight=flight))
    screen.say(f"wrote {file}")
    if alt_amsl_m is None:
        screen.say("its origin is at 0 m above the sea; for altitudes above the sea, write the true one: alt_amsl_m")
    screen.say(f"next: gcs plan {folder}")
    screen.result({"scenario": file})


def _exclude(option: str, others: dict[str, object]) -> None:
    """Raise `UsageError` if one of the others was given as well."""
    if wrong := next((other for other, value in others.items() if value), ""):
        raise UsageError(f"{option} and {wrong} exclude each other.", hint=f"leave out {wrong}")


def _check(
    count: int | None, shape: str | None, spacing: float | None, distance: float | None, height: float | None
) -> None:
    """Refuse wrong options before heavy imports. Raises `UsageError`."""
    if shape is not None and shape not in SHAPES:
        raise unknown_choice("--shape", shape, SHAPES, meant=OTHER_NAMES.get(shape.lower()))
    for option, value, least, most, unit in (
        ("--count", count, 1, 10_000, ""),
        ("--spacing", spacing, 0.1, 1000.0, "m"),
        ("--distance", distance, 1.0, 20_000.0, "m"),
        ("--height", height, 1.0, 1000.0, "m"),
    ):
        if value is not None:
            within(option, value, least, most, unit)


def schema(debug: DebugOption = False) -> None:
    """Print the JSON Schema of scenario.toml, for editors that complete TOML.

    Example: gcs schema > scenario.schema.json
    """
    from gcs.scenario.schema.json_schema import scenario_schema

    print(json.dumps(scenario_schema(), indent=2))
