"""Numbers that look like another thing than metres from the origin: degrees, heights above the sea or downwards, km/h.

They are within all ranges, so that a plan could be made of them: a flight of centimetres, for example.
"""

from functools import partial
from typing import Any

from gcs.frames import wrapped_deg
from gcs.scenario.schema.degree_keys import POSITION, Pair
from gcs.scenario.schema.fields import tables
from gcs.scenario.schema.mistake import Mistake, plain
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.rule_set import Mistakes, Rules
from gcs.scenario.values.si import local_origin

_NEAR_DEG = 0.5  # of the origin
_NOWHERE_DEG = 1.0  # an origin at 0 N 0 E, whose degrees are like metres
_WRITTEN_DIGITS = 4  # people write metres with fewer digits after the point, and degrees with more
_SHORT_M = 0.5  # no flight is so short
_FAST_MPS = 25.0  # as fast as quadrotors fly in formation; in km/h, the speed of a slow one
_KMH = 3.6
_LOOKS = "these look like degrees; this key is in metres north and east of the origin"
_MOVES = "these look like degrees; moves are displacements in metres, not places"

RULES = Rules()


def doubts(scenario: Scenario) -> list[str]:
    """Questions about numbers that are possible, but look like km/h."""
    given = (
        ("limits.speed_ned_mps", scenario.limits.speed_ned_mps),
        ("start.velocity_mps", scenario.start.velocity_mps),
    )
    return [
        f"{place}: {plain(fastest)} m/s are {fastest * _KMH:.0f} km/h. Is it in km/h? Then write "
        f"[{', '.join(plain(speed / _KMH) for speed in speeds)}] instead of [{', '.join(map(plain, speeds))}]"
        for place, speeds in given
        if (fastest := max(map(abs, speeds))) > _FAST_MPS
    ]


def _are_in_metres(table: str, scenario: Scenario) -> Mistakes:
    """The places of a table that are degrees near the origin."""
    origin = local_origin(scenario)
    here = (origin.lat_deg, origin.lon_deg)
    if max(map(abs, here)) < _NOWHERE_DEG:
        return
    for key, model, part in tables(Scenario, scenario.model_dump(include={table}, warnings=False)):
        for keys in model.degree_keys:
            given: list[Any] = [part.get(name) for name in keys.metres]
            meant = [_as_degrees(pair, here) for pair in keys.pairs(given)]
            places = [one for one in meant if one]
            if places and len(places) == len(meant):
                is_swapped = places[0] != keys.pairs(given)[0]
                text = _LOOKS + (", and latitude comes first" if is_swapped else "")
                height = plain(given[0][2]) if keys is POSITION else ""
                yield Mistake((*key, keys.metres[0]), text, given[0], remedy=f"write {keys.written(places, height)}")
        if any(_as_degrees((north, east), here) for _, north, east in part.get("moves", ())):
            yield Mistake((*key, "moves"), _MOVES, part["moves"], remedy="write moves = [[s, m north, m east], ...]")


for _table in Scenario.model_fields:
    RULES.needs("origin", _table)(partial(_are_in_metres, _table))


@RULES.needs("start", "route", "end")
def _flight_has_a_length(scenario: Scenario) -> Mistakes:
    """Degrees far from the origin, which is perhaps that of the template."""
    ends = {"start": scenario.start.position_m, "end": scenario.end.position_m}
    apart_m = max(abs(a - b) for a, b in zip(*ends.values(), strict=True))
    is_precise = all(round(value, _WRITTEN_DIGITS) != value for end in ends.values() for value in end[:2])
    if not scenario.route and apart_m < _SHORT_M and is_precise:
        for table, place in ends.items():
            step = f"write {POSITION.written([place[:2]], plain(place[2]))}, and check [origin]"
            yield Mistake((table, "position_m"), _LOOKS, place, remedy=step)


@RULES.needs("origin", "start", "route", "end", "limits")
def _heights_count_upwards_from_the_origin(scenario: Scenario) -> Mistakes:
    (low, high), sea_m = scenario.limits.height_m, scenario.origin.alt_amsl_m
    places: list[tuple[Key, Any]] = [(("start",), scenario.start), (("end",), scenario.end)]
    places += [(("route", row), point) for row, point in enumerate(scenario.route)]
    heights = {(*table, "position_m", 2): place.position_m[2] for table, place in places}
    if high <= 0.0 and all(low <= -height <= high for height in heights.values()):
        text = "is below the origin, and the flight is above; heights are positive upwards"
        step = f"write [{plain(-high)}, {plain(-low)}]"
        yield Mistake(("limits", "height_m"), text, scenario.limits.height_m, remedy=step)
        return
    for key, height in heights.items():
        up, over, under = plain(-height), plain(height - sea_m), plain(round(height + sea_m, 1))
        sea = f"looks like a height above mean sea level; the origin is at {sea_m:g} m"
        below, own = "is below the origin; heights are positive upwards", f"is {plain(height)} m above the origin"
        guesses = [(-height, below, f"write {up} for {up} m above the origin")] * (height < 0.0) + [
            (height - sea_m, sea, f"write {over}"),
            (height + sea_m, own, f"write height_m = {under}, if it counts from the origin"),
        ] * (abs(sea_m) > high - low)
        fits = [(text, step) for meant, text, step in guesses if low <= meant <= high]
        if fits and not low <= height <= high:
            yield Mistake(key, fits[0][0], height, remedy=fits[0][1])


def _as_degrees(pair: Pair, here: Pair) -> Pair | None:
    """The latitude and longitude in two numbers near the origin; None for metres."""
    if all(value == round(value) for value in pair):
        return None
    for lat, lon in (pair, pair[::-1]):
        if max(abs(lat - here[0]), abs(float(wrapped_deg(lon - here[1])))) < _NEAR_DEG:
            return lat, lon
    return None
