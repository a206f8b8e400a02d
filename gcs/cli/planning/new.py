"""`gcs new`: write a first scenario, which plans as it is. `gcs schema`: the JSON Schema of scenario files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.planning.new_options import COURSES, DrawingOptions, SurveyOptions, check_survey, parse_course, parse_place
from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import DebugOption, JsonOption, argument, one_of, option
from gcs.errors import UsageError

if TYPE_CHECKING:
    from gcs.scenario.schema.scenario import Scenario
    from gcs.scenario.sources.template import Flight
    from gcs.types import JsonObject

_ORIGIN = (-35.363262, 149.165237, 584.0)  # the default home of ArduPilot's simulators
SHAPES = ("triangle", "line", "column", "vee", "grid", "circle", "sphere")
OTHER_NAMES = {"wedge": "vee", "v": "vee", "abreast": "line", "row": "line", "ring": "circle", "square": "grid"}


def new(
    folder: Annotated[Path, argument("Folder to make. Its last part names the scenario.", "FOLDER")],
    at: Annotated[
        str | None,
        option(
            "Origin: degrees, degrees, m above mean sea level. Separated by commas or spaces.",
            metavar="LAT,LON[,ALT]",
            shown="the field of ArduPilot's simulators",
        ),
    ] = None,
    count: Annotated[int | None, option("Vehicles.", metavar="N", shown="6", limits=(1, 10_000, ""))] = None,
    shape: Annotated[
        str | None,
        option(
            f"Formation: {', '.join(SHAPES[:-1])} or {SHAPES[-1]}. It faces the course.",
            metavar="SHAPE",
            shown="vee",
            words=SHAPES,
            meant=OTHER_NAMES,
        ),
    ] = None,
    spacing: Annotated[
        float | None, option("Distance between neighbours.", metavar="METRES", shown="10", limits=(0.1, 1000.0, "m"))
    ] = None,
    course: Annotated[
        str | None,
        typer.Option(
            metavar="COURSE",
            help="Direction of the flight: north-east, ne, or degrees clockwise from north.",
            show_default="north",
            autocompletion=one_of(*COURSES),
        ),
    ] = None,
    distance: Annotated[
        float | None,
        option(
            "Length of the flight. 0: it ends where it begins.",
            metavar="METRES",
            shown="300; 0 with --shapes",
            limits=(0.0, 20_000.0, "m"),
        ),
    ] = None,
    end: Annotated[
        str | None,
        option("End of the flight, degrees, instead of --course and --distance.", metavar="LAT,LON", shown=False),
    ] = None,
    height: Annotated[
        float | None,
        option("Height of the flight above the origin.", metavar="METRES", shown="15", limits=(1.0, 1000.0, "m")),
    ] = None,
    positions: Annotated[
        Path | None,
        option(
            "Sheet with the places of all vehicles on the ground: number, x (east), y (north), z (height) in m, or "
            "number, latitude, longitude, height. Instead of --shape.",
            metavar="FILE.csv",
            shown=False,
        ),
    ] = None,
    shapes: Annotated[
        list[Path] | None,
        option(
            "With --positions: sheet with the places of a figure. Repeat it for several.",
            metavar="FILE.csv",
            shown=False,
        ),
    ] = None,
    route: Annotated[
        Path | None,
        option(
            "Route drawn in another program: .plan, .waypoints, .kml, .kmz, .gpx or .geojson. Instead of --course, "
            "--distance and --end. --height counts for points without a height, or on the ground.",
            metavar="FILE",
            shown=False,
        ),
    ] = None,
    terrain: Annotated[
        Path | None,
        option(
            "With --route: elevation model (GeoTIFF, .hgt) from which drawn heights above the ground count. With "
            "--survey: --height counts from its ground.",
            metavar="DEM",
            shown="level ground at the origin",
        ),
    ] = None,
    survey: Annotated[
        Path | None,
        option(
            "Drawing with the polygon of an area (KML, KMZ, GeoJSON, .poly, .plan, also of a survey pattern), which "
            "vehicles abreast survey in parallel passes. They start at --at, or where the first pass begins, and come "
            "back.",
            metavar="AREA",
            shown=False,
        ),
    ] = None,
    swath: Annotated[
        float | None, option("Width that one vehicle sees.", metavar="METRES", shown=False, limits=(0.5, 1000.0, "m"))
    ] = None,
    overlap: Annotated[
        str | None,
        option("Least share of the swath that the neighbour sees too: 20% or 0.2.", metavar="SHARE", shown="20%"),
    ] = None,
    angle: Annotated[
        str | None,
        option("Direction of the passes: auto (the quickest), or as for --course.", metavar="COURSE", shown="auto"),
    ] = None,
    speed: Annotated[
        float | None, option("Speed of a survey.", metavar="M/S", shown="4", limits=(0.2, 100.0, "m/s"))
    ] = None,
    holes: Annotated[
        str | None,
        option(
            "Holes of the area, ponds for example, are not surveyed. cross: vehicles fly over them; avoid: they are "
            "no-fly zones.",
            metavar="cross|avoid",
            shown="cross",
            words=("cross", "avoid"),
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        option(
            "Vehicles: quad500, f150, or a vehicle file, for example of `gcs new-vehicle`.",
            metavar="TYPE",
            shown="quad500",
        ),
    ] = None,
    full: Annotated[bool, option("Write every table, with comments.", "--full")] = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a short scenario that plans at once.

    Without options the flight passes a no-fly zone; with any of --count to --height it has none.

    The share of the batteries that the flight needs is estimated and printed. A flight that needs more than the
    reserve leaves is written with a higher speed, or refused with what would fit.

    With --positions vehicles and shapes come from spreadsheets saved as CSV (UTF-8); errors in a sheet are reported
    with their rows. --spacing is then the least distance allowed, at all times, and --count the required number of
    vehicles. Each shape is a figure that stands where its sheet puts it; with --distance, --course or --end the
    formation takes it on its way, wherever it is then.

    With --route the formation flies along a route that was drawn, or recorded, in another program. Items that are not
    carried over are printed, each with number and name. The origin is the planned home, else the first point; --at
    sets another.

    With --survey the formation keeps its direction and flies sideways between passes. Four to six vehicles fly, or at
    most --count. --spacing follows from --swath and --overlap.

    Examples: gcs new plans/first

    gcs new plans/line --at 47.39,8.54 --count 4 --shape line --spacing 8 --course north-east --distance 400

    gcs new plans/there --at 47.39,8.54 --end 47.393,8.546

    gcs new plans/show --at 46.95,7.44,540 --positions grid.csv --shapes star.csv --shapes ring.csv --height 40

    gcs new plans/valley --route valley.plan --count 4 --shape line

    gcs new plans/meadow --survey meadow.kml --swath 12 --overlap 20% --height 30

    gcs new plans/small --vehicle five.toml --count 4

    gcs new plans/whole --at 47.3977 8.5456 488 --full
    """
    screen = Screen(json=json)
    end_deg = None if end is None else parse_place(end, "--end")[:2]
    if end_deg is not None and (course is not None or distance is not None):
        raise UsageError("--end gives the course and the distance.", hint="leave out --course and --distance")
    if positions is not None:
        _exclude("--positions", {"--full": full, "--shape": shape})
    if shapes and positions is None:
        raise UsageError("--shapes needs --positions.", hint="give the places on the ground too: --positions FILE.csv")
    surveyed = SurveyOptions(swath, overlap, angle, speed, holes)
    flights = {"--positions": positions, "--course": course, "--distance": distance, "--end": end, "--full": full}
    if terrain is not None and route is None and survey is None:
        raise UsageError(
            "--terrain needs --route or --survey.", hint="write [terrain.dem] in other scenarios: docs/scenario.md"
        )
    if route is not None:
        _exclude("--route", {**flights, "--survey": survey})
    if survey is not None:
        _exclude("--survey", {**flights, "--shape": shape, "--spacing": spacing})
        check_survey(surveyed)
    elif surveyed.given():
        raise UsageError(f"{surveyed.given()[0]} needs --survey.", hint="give the area too: --survey AREA")
    given: JsonObject = {
        "count": count,
        "shape": shape,
        "spacing_m": spacing,
        "course_deg": None if course is None else parse_course(course),
        "distance_m": distance,
        "height_m": height,
        "end_deg": end_deg,
    }
    lat_deg, lon_deg, alt_amsl_m = _ORIGIN if at is None else parse_place(at)
    from gcs.frames import Origin
    from gcs.scenario.sources.bundled_missions import FILE_NAME
    from gcs.scenario.sources.flight_margins import VEHICLE_TYPE, type_limits
    from gcs.scenario.sources.load import load_scenario
    from gcs.scenario.sources.template import FirstFlight, flown_by, scenario_text, straight_to
    from gcs.util.atomic_write import atomic_write

    file = folder / FILE_NAME
    if file.exists():
        raise UsageError(f"{file} exists already.", hint="choose another name, or delete the file first")
    if end_deg is not None:
        given |= straight_to(end_deg, (lat_deg, lon_deg))
    wanted = {key: value for key, value in given.items() if value is not None}
    origin = None if at is None else (lat_deg, lon_deg, alt_amsl_m or 0.0)
    limits = type_limits(vehicle or VEHICLE_TYPE)
    flight: Flight | None = FirstFlight(**wanted, limits=limits) if wanted or vehicle else None
    left_out: dict[str, list[str]] = {}
    if positions is not None:
        from gcs.cli.planning.new_flights import flight_of_sheets

        flight, place = flight_of_sheets(positions, shapes or [], wanted, origin, vehicle, screen)
        lat_deg, lon_deg, alt_amsl_m = place or (lat_deg, lon_deg, alt_amsl_m)
    drawing = DrawingOptions(None if at is None else parse_place(at), terrain, vehicle)
    if survey is not None:
        from gcs.cli.planning.new_flights import text_of_survey

        text, left_out["left_out"], flight = text_of_survey(folder, survey, drawing, surveyed, count, height, screen)
    elif route is not None:
        from gcs.cli.planning.new_flights import text_of_drawing

        text, left_out["left_out"], flight = text_of_drawing(folder, route, drawing, wanted, screen)
    else:
        there = Origin(lat_deg, lon_deg, alt_amsl_m or 0.0)
        text = scenario_text(folder, there, full=full, flight=flight, vehicle=vehicle)
    if vehicle is not None:
        text = flown_by(text, vehicle, folder)
    atomic_write(file, text)
    scenario = load_scenario(folder)
    if spacing is not None and positions is None and len(scenario.formation.sysids) > 1:
        limit = f"separation_min_m is {scenario.limits.separation_min_m:g} m, less, for room to change the shape"
        screen.say(f"vehicles stand {spacing:g} m apart; {limit}")
    if scenario.sensors.grade == "rtk":
        screen.say('vehicles stand too near for ordinary GNSS: the scenario has sensors.grade = "rtk"')
    screen.say(f"wrote {file}")
    if alt_amsl_m is None and route is None and survey is None:
        screen.say("its origin is at 0 m above the sea; for altitudes above the sea, write the true one: alt_amsl_m")
    share = _say_battery(scenario, flight or FirstFlight(), screen)
    screen.say(f"next: gcs plan {folder}")
    screen.result({"scenario": file, "battery_share_estimate": share, **left_out})


def _say_battery(scenario: Scenario, flight: Flight, screen: Screen) -> float:
    """Print what a flight needs of its batteries by the estimate, and what would fit; return the share of one."""
    from gcs.scenario.values.battery_estimate import battery_estimate

    need, count = battery_estimate(scenario), len(scenario.formation.sysids)
    each = "one" if count == 1 else f"{count}, one for each vehicle"
    if not need.is_enough:
        text = f"{need.whole_s:.0f} s from take-off to touch-down need about {need.share:.0%} of a battery"
        most = f"one lasts {need.longest_s:.0f} s, with {1.0 - need.usable:.0%} of it in reserve"
        screen.warn(f"{text}; {most}: the plan will fail verification. To fit, {flight.fitting(need.longest_s)}")
        return round(need.share, 3)
    kept = f"{1.0 - need.usable:.0%} stays in reserve"
    screen.say(f"batteries: {each}; about {need.share:.0%} of it used in {need.whole_s:.0f} s, {kept}")
    return round(need.share, 3)


def _exclude(option: str, others: dict[str, object]) -> None:
    """Raise `UsageError` if one of the others was given as well."""
    if wrong := next((other for other, value in others.items() if value), ""):
        raise UsageError(f"{option} and {wrong} exclude each other.", hint=f"leave out {wrong}")


def schema(debug: DebugOption = False) -> None:
    """Print the JSON Schema of scenario.toml, for editors that complete TOML.

    Example: gcs schema > scenario.schema.json
    """
    from gcs.scenario.schema.vehicle_types import scenario_schema

    print(json.dumps(scenario_schema(), indent=2))
