"""The scenarios of `gcs new` from sheets, a drawn route or a drawn area, and their summaries."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from gcs.cli.planning.new_options import DrawingOptions, SurveyOptions, overlap_share, pass_course_deg
from gcs.cli.shared.console import Screen
from gcs.errors import Infeasible, UsageError, counted
from gcs.frames import Origin, ned_to_geodetic
from gcs.mission.drawings.labels import Label, sentences
from gcs.mission.drawings.route_formats import read_drawing
from gcs.mission.drawings.to_scenario.drawn_areas import AreaTables
from gcs.mission.drawings.to_scenario.drawn_ground import ground_of
from gcs.mission.drawings.to_scenario.route_flight import route_flight, route_text
from gcs.mission.drawings.to_scenario.survey_area import survey_area
from gcs.scenario.sources.flight_sheets import read_flight_sheets
from gcs.scenario.sources.sheet_flight import SheetFlight
from gcs.scenario.sources.template import FirstFlight, Flight, ImpossibleFlight, draft, named_beside, scenario_text
from gcs.scenario.values.navigation_error import vehicle_size_m

if TYPE_CHECKING:
    from gcs.scenario.sources.survey_flight import SurveyFlight
    from gcs.types import JsonObject

ALTITUDE_UNKNOWN = "its origin is at 0 m above the sea; for altitudes above the sea, write the true one: alt_amsl_m"
_WHOLE = 0.999  # a survey that sees as much of an area sees all
_SHARES = tuple(0.05 * number for number in range(20, 7, -1))  # of the separation asked for, to try in turn
_FARTHEST_M = 5_000.0  # from the origin to the area
_SPEED_SHARE = 0.9  # of the vehicle's limit: the planner needs room to keep the time


def text_of_drawing(
    folder: Path, file: Path, options: DrawingOptions, wanted: JsonObject, screen: Screen
) -> tuple[str, list[str], Flight]:
    """The text of the scenario, the sentences about what is not carried over, and the flight.

    Times are those of the vehicle. Raises FileFormatError for a file that is no drawing of a route, and UsageError for
    a flight that is not possible.
    """
    from gcs.scenario.sources.flight_margins import VEHICLE_TYPE, type_limits

    limits, height_m = type_limits(options.vehicle or VEHICLE_TYPE), wanted.pop("height_m", None)
    flight = route_flight(read_drawing(file), options.at, height_m, options.terrain, limits=limits, **wanted)
    text = route_text(folder, flight, options.vehicle)
    time_s = tomllib.loads(text)["time"]["flight_s"]  # less than asked where the battery asks for it
    way = f"{counted(len(flight.route.points), 'point')}{', and back to the start' if flight.route.returns else ''}"
    length = f"{flight.length_m:.0f} m in {time_s:.0f} s"
    screen.say(f"{file}: {', '.join([way, length, *_counted_areas(flight.areas)])}")
    left_out = sentences(flight.left_out, flight.drawing.unit)
    for sentence in left_out:
        screen.say(f"  {sentence}")
    return text, left_out, flight


def flight_of_sheets(
    positions: Path,
    shapes: list[Path],
    wanted: JsonObject,
    at: tuple[float, float, float] | None,
    vehicle: str | None,
    screen: Screen,
) -> tuple[SheetFlight, tuple[float, float, None] | None]:
    """The flight; and its origin where that is the place of the first vehicle. Raises UsageError for a wrong sheet."""
    from gcs.scenario.sources.flight_margins import VEHICLE_TYPE, type_limits

    kind = vehicle or VEHICLE_TYPE
    read = read_flight_sheets(
        positions,
        shapes,
        None if at is None else Origin(*at),
        count=wanted.get("count"),
        least_m=wanted.get("spacing_m"),
        vehicle=kind,
    )
    plain = FirstFlight()
    flight = SheetFlight(
        read.positions,
        read.shapes,
        wanted.get("course_deg", plain.course_deg),
        wanted.get("distance_m", 0.0 if shapes and "course_deg" not in wanted else plain.distance_m),
        wanted.get("height_m", read.height_m or plain.height_m),
        wanted.get("end_deg"),
        limits=type_limits(kind),
    )
    for sheet in (read.positions, *read.shapes):
        screen.say(f"{sheet.file}: {counted(len(sheet.sysids), 'vehicle')}, {sheet.least_distance()}")
    if holes := sorted(
        set(range(min(flight.positions.sysids), max(flight.positions.sysids))) - set(flight.positions.sysids)
    ):
        screen.say(f"WARNING: {positions} has no vehicle {', '.join(map(str, holes))}; --count N makes that a mistake")
    flight = with_its_changes(flight, wanted.get("spacing_m"), vehicle, screen)
    if flight.is_show:
        screen.say("figures stand where their sheets put them; --distance takes them along a way instead")
        if flight.lift_m:
            screen.say(f"heights in the figures count from the flight's {flight.lift_m:g} m: some are on the ground")
    elif shapes:
        screen.say("shapes are taken along the way, without their places; --distance 0 puts them where the sheets do")
    if at is not None or read.origin is None:
        return flight, None
    screen.say(f"the origin is the place of vehicle {read.positions.sysids[0]}")
    return flight, (read.origin.lat_deg, read.origin.lon_deg, None)


def with_its_changes(flight: SheetFlight, asked_m: float | None, vehicle: str | None, screen: Screen) -> SheetFlight:
    """The flight with the times that its changes of shape take, and with the separation that they keep.

    That is the one asked for, else the usual one; where no paths keep it, the largest one that some do, and it is said.
    Raises UsageError where vehicles would touch.
    """
    from gcs.plan.formation.timeline import made_changes

    wanted_m, why = asked_m or flight.usual_separation_m, ""
    for share in _SHARES:
        tried = replace(flight, separation_m=share * wanted_m)
        scenario = draft(tried, vehicle)
        kept_m = scenario.limits.separation_min_m
        if why and kept_m < vehicle_size_m(scenario.vehicle):
            break
        try:
            made = made_changes(scenario)
        except Infeasible as none:
            why = why or none.reason.rsplit(";", 1)[0]  # its end is the separation that was tried
            continue
        if why:
            option = "--spacing " if asked_m else ""
            screen.say(f"separation_min_m is {kept_m:g} m, less than {option}{wanted_m:g}, with which {why}")
        elif asked_m:
            screen.say(f"separation_min_m is {kept_m:g} m, as --spacing asks")
        return replace(tried, changes_s=tuple(change.duration_s for change in made))
    raise UsageError(f"these shapes cannot follow each other: {why}", hint="give the shapes larger distances")


def text_of_survey(
    folder: Path,
    file: Path,
    options: DrawingOptions,
    survey: SurveyOptions,
    count: int | None,
    height_m: float | None,
    screen: Screen,
) -> tuple[str, list[str], Flight]:
    """The text of the scenario, the sentences about what is not carried over, and the flight.

    The speed is one that the vehicle can fly. With an elevation model the height is that above the ground, and the
    altitude of an origin that has none is the ground's. Raises UsageError for what cannot be flown, and FileFormatError
    for a file that is no drawing.
    """
    from gcs.scenario.sources.flight_margins import VEHICLE_TYPE, type_limits
    from gcs.scenario.sources.survey_flight import COUNTS, SurveyGround, SurveyOrder, survey_flight

    at, terrain, vehicle = options.at, options.terrain, options.vehicle
    drawing, avoids = read_drawing(file), survey.holes == "avoid"
    drawn = survey_area(drawing, at, avoid_holes=avoids)
    altitude_is = drawn.altitude_is
    if terrain is not None and not altitude_is:
        start = drawn.origin.lat_deg, drawn.origin.lon_deg
        under_m = ground_of(terrain, [start, *drawn.field.corners]).alt_amsl_m(start)
        altitude_is = "--terrain"
        drawn = survey_area(drawing, (*start, round(under_m or 0.0, 1)), avoid_holes=avoids)
    away_m = float(drawn.surveyed.distance(shapely.Point(0.0, 0.0)))
    if away_m > _FARTHEST_M:
        text = f"{file} is {away_m:,.0f} m from --at; a survey begins at most {_FARTHEST_M:,.0f} m away."
        raise UsageError(text, hint="leave --at out to begin at the area, or give a place near it")
    plain = SurveyOrder(drawn.surveyed, 1.0)
    assert survey.swath is not None
    order = SurveyOrder(
        drawn.surveyed,
        survey.swath,
        overlap_share(survey.overlap),
        pass_course_deg(survey.angle),
        COUNTS if count is None else tuple(range(1, count + 1)),
        plain.height_m if height_m is None else height_m,
        _speed_mps(survey.speed, plain.speed_mps, vehicle),
        drawn.avoided,
        starts_at_origin=at is not None,
        limits=type_limits(vehicle or VEHICLE_TYPE),
    )
    flight = survey_flight(order)
    if terrain is not None:
        lat, lon, _ = ned_to_geodetic(np.column_stack([flight.flown_m, np.zeros(len(flight.flown_m))]), drawn.origin)
        ground = ground_of(terrain, [(float(a), float(b)) for a, b in zip(lat, lon, strict=True)])
        order = replace(order, ground=SurveyGround(terrain, partial(ground.under_m, origin=drawn.origin)))
        flight = replace(flight, order=order)
    passed = [(Label("the start"), flight.start_m), *((Label(one.name), one.place_m) for one in flight.points())]
    areas = drawn.tables(passed)
    flight = replace(flight, order=replace(order, zones="\n".join(areas.texts)))
    for sentence in [*_sentences(flight, areas), *_fewer(flight, count)]:
        screen.say(sentence)
    left_out = sentences((*drawn.left_out, *areas.left_out), drawn.drawing.unit)
    for sentence in left_out:
        screen.say(f"  {sentence}")
    place, which = drawn.origin, "ground" if terrain is not None else "origin"
    screen.say(f"flown {order.height_m:g} m above the {which} (--height)")
    if at is None:
        screen.say(f"the origin is the first corner of {file}")
    if altitude_is in ("the planned home", "--terrain"):
        screen.say(f"its altitude is that of {altitude_is}: {place.alt_amsl_m:g} m above the sea")
    elif not altitude_is:
        screen.say(ALTITUDE_UNKNOWN)
    try:
        text = scenario_text(folder, place, flight=flight, vehicle=vehicle)
    except ImpossibleFlight as error:
        reason = "\n".join(f"{areas.place(one, drawn.drawing)}: {one.whole}" for one in error.mistakes)
        text = f"{file}: such a survey is not possible: {reason}"
        raise UsageError(text, hint="give a smaller --count, or another --angle; or draw the area larger") from None
    return text if terrain is None else named_beside(text, terrain, folder), left_out, flight


def _sentences(flight: SurveyFlight, areas: AreaTables) -> list[str]:
    mown = flight.mowing
    holes = len(flight.order.area.interiors)
    tables = _counted_areas(areas)
    apart = f" {mown.spacing_m:.2f} m apart"
    notes = [
        f"{flight.area_ha:.2f} ha: {counted(mown.count, 'vehicle')}{apart * (mown.count > 1)}, "
        f"{counted(len(mown.passes), 'pass', 'passes')}{apart * (mown.count == 1)} "
        f"at {mown.course_deg % 180.0:.1f} degrees, "
        f"about {flight.flight_s:g} s" + "".join(f", {one}" for one in tables)
    ]
    if areas.no_fly and flight.seen < _WHOLE:
        notes.append(f"passes see about {flight.seen:.0%} of it, the ways round no-fly zones perhaps more")
    if holes and not areas.no_fly:
        notes.append(f"{counted(holes, 'hole')}: not surveyed, and crossed by vehicles; --holes avoid forbids that")
    return notes


def _fewer(flight: SurveyFlight, count: int | None) -> list[str]:
    """Why a survey has fewer vehicles than `--count` allows."""
    from gcs.scenario.sources.survey_flight import survey_flight

    used = flight.mowing.count
    if count is None or used == count:
        return []
    try:
        all_of_them = survey_flight(replace(flight.order, counts=(count,)))
    except UsageError as error:
        return [f"{used} of {count} vehicles: with {count} {error.message}"]
    seen = f"see about {all_of_them.seen:.0%} of it" if flight.order.avoided else "see it"
    return [f"{used} of {count} vehicles: all {count} abreast would {seen} in about {all_of_them.flight_s:g} s"]


def _counted_areas(areas: AreaTables) -> list[str]:
    return [
        counted(len(tables), noun, plural)
        for tables, noun, plural in (
            (areas.keep_in, "area to stay in", "areas to stay in"),
            (areas.no_fly, "no-fly zone", ""),
        )
        if tables
    ]


def _speed_mps(speed_mps: float | None, usual_mps: float, vehicle: str | None) -> float:
    """The speed asked for, else the usual one where the vehicles can. Raises UsageError for more than they fly."""
    from gcs.scenario.sources.flight_margins import VEHICLE_TYPE, type_limits

    kind = vehicle or VEHICLE_TYPE
    most_mps = _SPEED_SHARE * min(type_limits(kind).speed_ned_mps[:2])
    if speed_mps is None:
        return min(usual_mps, most_mps)
    if speed_mps > most_mps:
        text = f"--speed {speed_mps:g}: the vehicles ({kind}) survey with at most {most_mps:g} m/s"
        raise UsageError(text, hint="give a lower speed, or faster vehicles: --vehicle TYPE")
    return speed_mps
