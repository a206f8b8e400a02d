"""Numbers that look like another thing than metres from the origin: degrees, heights above the sea or downwards, km/h.

They are within all ranges, so that a plan could be made of them: a flight of centimetres, for example.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gcs.scenario.degrees.place_questions import Pair, degrees, shown, shown_column, shown_points
from gcs.scenario.schema.fields import Place
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import local_origin
from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.validation.slips.shown_values import plain
from gcs.scenario.validation.toml_lines import Key

_NEAR_DEG = 0.5  # of the origin
_NOWHERE_DEG = 1.0  # an origin at 0 N 0 E, whose degrees are like metres
_WRITTEN_DIGITS = 4  # people write metres with fewer digits after the point, and degrees with more
_SHORT_M = 0.5  # no flight is so short
_FAST_MPS = 25.0  # as fast as quadrotors fly in formation; in km/h, the speed of a slow one
_KMH = 3.6

RULES = Rules()


def doubts(scenario: Scenario) -> list[str]:
    """Questions about numbers that are possible, but look like km/h."""
    asked = []
    for place, speeds in (
        ("limits.speed_ned_mps", scenario.limits.speed_ned_mps),
        ("start.velocity_mps", scenario.start.velocity_mps),
    ):
        fastest = max(abs(speed) for speed in speeds)
        if fastest > _FAST_MPS:
            given = ", ".join(plain(speed) for speed in speeds)
            meant = ", ".join(plain(speed / _KMH) for speed in speeds)
            asked.append(
                f"{place}: {plain(fastest)} m/s are {fastest * _KMH:.0f} km/h. Is it in km/h? "
                f"Then write [{meant}] instead of [{given}]"
            )
    return asked


@RULES.needs("origin", "start")
def _start_is_in_metres(scenario: Scenario) -> Mistakes:
    yield from _place(scenario, ("start", "position_m"), scenario.start.position_m)


@RULES.needs("origin", "end")
def _end_is_in_metres(scenario: Scenario) -> Mistakes:
    yield from _place(scenario, ("end", "position_m"), scenario.end.position_m)


@RULES.needs("start", "route", "end")
def _flight_has_a_length(scenario: Scenario) -> Mistakes:
    """Degrees far from the origin, which is perhaps that of the template."""
    if scenario.route:
        return
    ends = (scenario.start.position_m, scenario.end.position_m)
    apart_m = max(abs(a - b) for a, b in zip(*ends, strict=True))
    if apart_m >= _SHORT_M or not all(_has_many_digits(value) for end in ends for value in end[:2]):
        return
    for table, place in zip(("start", "end"), ends, strict=True):
        step = f"write {_position(place[:2], place[2])}, and check [origin]"
        yield Mistake((table, "position_m"), _LOOKS, place, remedy=step)


@RULES.needs("origin", "formation")
def _vehicles_are_in_metres(scenario: Scenario) -> Mistakes:
    for row, vehicle in enumerate(scenario.formation.vehicle):
        yield from _place(scenario, ("formation", "vehicle", row, "position_m"), vehicle.position_m)
    for row, change in enumerate(scenario.formation.change):
        yield from _line(scenario, ("formation", "change", row, "gate_m"), change.gate_m or ())


@RULES.needs("origin", "no_fly")
def _zones_are_in_metres(scenario: Scenario) -> Mistakes:
    for row, zone in enumerate(scenario.no_fly):
        if zone.north_m is not None and zone.east_m is not None:
            for text, (lat, lon) in _looks_like_degrees(scenario, (zone.north_m, zone.east_m)):
                step = f"write lat_deg = {degrees(lat)} and lon_deg = {degrees(lon)} for this place"
                yield Mistake(("no_fly", row, "north_m"), text, zone.north_m, remedy=step)
        yield from _line(scenario, ("no_fly", row, "polygon_m"), zone.polygon_m or ())
        if any(asked for move in zone.moves for asked in _looks_like_degrees(scenario, move[1:])):
            text = "these look like degrees; moves are displacements in metres, not places"
            yield Mistake(
                ("no_fly", row, "moves"), text, zone.moves, remedy="write moves = [[s, m north, m east], ...]"
            )


@RULES.needs("origin", "keep_in")
def _keep_in_areas_are_in_metres(scenario: Scenario) -> Mistakes:
    for row, area in enumerate(scenario.keep_in):
        yield from _line(scenario, ("keep_in", row, "polygon_m"), area.polygon_m)


@RULES.needs("origin", "route")
def _route_is_in_metres(scenario: Scenario) -> Mistakes:
    for row, point in enumerate(scenario.route):
        yield from _place(scenario, ("route", row, "position_m"), point.position_m)


@RULES.needs("origin", "limits")
def _box_is_in_metres(scenario: Scenario) -> Mistakes:
    corners = list(zip(scenario.limits.north_m, scenario.limits.east_m, strict=True))
    yield from _columns(scenario, ("limits", "north_m"), corners, scenario.limits.north_m)


@RULES.needs("origin", "terrain")
def _summits_are_in_metres(scenario: Scenario) -> Mistakes:
    mountains = scenario.terrain.mountains
    summits = list(zip(mountains.north_m, mountains.east_m, strict=True))
    yield from _columns(scenario, ("terrain", "mountains", "north_m"), summits, mountains.north_m)


@RULES.needs("origin", "start", "route", "end", "limits")
def _heights_count_upwards_from_the_origin(scenario: Scenario) -> Mistakes:
    (low, high), sea_m = scenario.limits.height_m, scenario.origin.alt_amsl_m
    places: list[tuple[Key, Place]] = [(("start",), scenario.start.position_m)]
    places += [(("route", row), point.position_m) for row, point in enumerate(scenario.route)]
    places.append((("end",), scenario.end.position_m))
    for table, place in places:
        height = place[2]
        key: Key = (*table, "position_m", 2)
        if low <= height <= high:
            continue
        if height < 0.0 and low <= -height <= high:
            text = "is below the origin; heights are positive upwards"
            yield Mistake(key, text, height, remedy=f"write {plain(-height)} for {plain(-height)} m above the origin")
        elif abs(sea_m) > high - low and low <= height - sea_m <= high:
            text = f"looks like a height above mean sea level; heights count from the origin, which is at {sea_m:g} m"
            yield Mistake(key, text, height, remedy=f"write {plain(height - sea_m)}")
        elif abs(sea_m) > high - low and low <= height + sea_m <= high:
            text = f"is {plain(abs(height))} m {'below' if height < 0.0 else 'above'} the origin"
            step = f"write height_m = {plain(round(height + sea_m, 1))}, if it counts from the origin"
            yield Mistake(key, text, height, remedy=step)


@RULES.needs("start", "end", "limits")
def _height_limits_count_upwards(scenario: Scenario) -> Mistakes:
    low, high = scenario.limits.height_m
    heights = [scenario.start.position_m[2], scenario.end.position_m[2]]
    if high <= 0.0 and all(-high <= height <= -low for height in heights):
        text = "is below the origin, and the flight is above; heights are positive upwards"
        step = f"write [{plain(0.0 - high)}, {plain(0.0 - low)}]"
        yield Mistake(("limits", "height_m"), text, scenario.limits.height_m, remedy=step)


_LOOKS = "these look like degrees; this key is in metres north and east of the origin"


def _place(scenario: Scenario, key: Key, place: Sequence[float]) -> Mistakes:
    for text, meant in _looks_like_degrees(scenario, place):
        yield Mistake(key, text, tuple(place), remedy=f"write {_position(meant, place[2])}")


def _line(scenario: Scenario, key: Key, points: Sequence[Sequence[float]]) -> Mistakes:
    found = [one for point in points for one in _looks_like_degrees(scenario, point)]
    if found and len(found) == len(points):
        name = str(key[-1]).replace("_m", "_deg")
        yield Mistake(key, found[0][0], tuple(points), remedy=f"write {name} = {shown_points([p for _, p in found])}")


def _columns(scenario: Scenario, key: Key, places: Sequence[Pair], value: Sequence[float]) -> Mistakes:
    found = [one for place in places for one in _looks_like_degrees(scenario, place)]
    if found and len(found) == len(places):
        lats, lons = (shown_column(column) for column in zip(*(place for _, place in found), strict=True))
        step = f"write lat_deg = {lats} and lon_deg = {lons}"
        yield Mistake(key, found[0][0], tuple(value), remedy=step)


def _position(place_deg: Sequence[float], height_m: float) -> str:
    return f"position_deg = {shown(place_deg)}, height_m = {plain(height_m)}"


def _looks_like_degrees(scenario: Scenario, place: Sequence[float]) -> Iterator[tuple[str, Pair]]:
    """What to say, and the latitude and longitude, where two numbers are degrees near the origin."""
    origin = local_origin(scenario)
    here = (origin.lat_deg, origin.lon_deg)
    if max(map(abs, here)) < _NOWHERE_DEG or all(value == round(value) for value in place[:2]):
        return
    for lat_deg, lon_deg, swapped in ((place[0], place[1], False), (place[1], place[0], True)):
        if max(abs(lat_deg - here[0]), abs(lon_deg - here[1])) < _NEAR_DEG:
            text = _LOOKS + (", and latitude comes first" if swapped else "")
            yield text, (lat_deg, lon_deg)
            return


def _has_many_digits(value: float) -> bool:
    return round(value, _WRITTEN_DIGITS) != value
