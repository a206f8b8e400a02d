"""Places under keys that people expect where a table has others: `lat` and `lon`, `center`, `position`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from gcs.scenario.degrees.place_questions import degrees, is_number, numbers, shown
from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.slips.shown_values import plain, toml
from gcs.scenario.validation.toml_lines import Key

_POSITION_KEYS = {  # what people write instead of a position
    **dict.fromkeys(("lat", "latitude", "lat_deg"), "lat"),
    **dict.fromkeys(("lon", "lng", "longitude", "lon_deg"), "lon"),
    **dict.fromkeys(("alt", "altitude", "alt_m", "alt_amsl_m", "height", "height_m"), "height"),
}
_HEIGHTS = ("height_m", "alt_amsl_m")
_POINTS = ("position_lat_lon", "lat_lon", "latlon", "latlng", "gps", "location", "coordinates", "coords", "point")
_CENTRES = ("center", "centre", "position", "place", "at")
_METRES_DIGITS = 3  # people write metres with no more of them after the point, and degrees with more


@dataclass(frozen=True)
class PlaceSlip:
    """A place under other keys: the mistake, the table as it was meant, and the keys about which nothing is known."""

    mistake: Mistake
    table: dict[str, Any]
    guessed: tuple[str, ...] = ()


def place_slip(table: dict[str, Any], known: Collection[str], key: Key) -> PlaceSlip | None:
    """The place of a table that stands under other keys than those `known`."""
    if "position_deg" in known and "position_m" not in table:
        return _as_height(table, key) if "position_deg" in table else _as_position(table, known, key)
    if "radius_m" in known and "lat_deg" in known:
        return _as_moves(table, key) or _as_centre(table, key)
    return None


def has_degrees(value: Any) -> bool:
    """Whether a list has places with as many digits as degrees need."""
    if not isinstance(value, list) or not value:
        return False
    if all(isinstance(one, list) for one in value):
        return any(has_degrees(one) for one in value if not any(isinstance(part, list) for part in one))
    return all(map(is_number, value)) and any(round(one, _METRES_DIGITS) != one for one in value[:2])


def _as_height(table: dict[str, Any], key: Key) -> PlaceSlip | None:
    """The height of a position, under a key that does not say from where it counts."""
    names = [name for name in table if _POSITION_KEYS.get(name) == "height"]
    if len(names) != 1 or names[0] in _HEIGHTS:
        return None
    value = toml(table[names[0]])
    text = "unknown key; a height is height_m, above the origin, or alt_amsl_m, above the sea"
    mistake = Mistake((*key, names[0]), text, remedy=f"write height_m = {value}, or alt_amsl_m = {value}")
    rest = {name: value for name, value in table.items() if name != names[0]}
    return PlaceSlip(mistake, rest | {"height_m": table[names[0]]}, ("position_m", "height_m"))


def _as_moves(table: dict[str, Any], key: Key) -> PlaceSlip | None:
    if "moves_deg" not in table:
        return None
    text = "unknown key; moves are displacements in metres, not places"
    mistake = Mistake((*key, "moves_deg"), text, remedy="write moves = [[s, m north, m east], ...]")
    return PlaceSlip(mistake, {name: value for name, value in table.items() if name != "moves_deg"})


def _as_position(table: dict[str, Any], known: Collection[str], key: Key) -> PlaceSlip | None:
    for name, value in table.items():
        if name not in known and name.lower().removesuffix("_deg") in _POINTS and has_degrees(value):
            place, height = shown(value[:2]), "".join(f", height_m = {plain(last)}" for last in value[2:3])
            mistake = Mistake(
                (*key, name), "unknown key; degrees are position_deg", remedy=f"write position_deg = {place}{height}"
            )
            rest = {other: value for other, value in table.items() if other != name}
            return PlaceSlip(mistake, rest | {"position_deg": value}, ("position_m", "position_deg", "height_m"))
    names = {name: _POSITION_KEYS[name] for name in table if name in _POSITION_KEYS}
    if {"lat", "lon"} - set(names.values()):
        return None
    found = {kind: name for name, kind in names.items()}
    lat, lon = table[found["lat"]], table[found["lon"]]
    place = shown((lat, lon)) if is_number(lat) and is_number(lon) else "[latitude, longitude]"
    height = found.get("height", "")
    last = f"{'alt_amsl_m' if height == 'alt_amsl_m' else 'height_m'} = {toml(table[height]) if height else '...'}"
    text = f"is given as {', '.join(names)}; a position is position_m, or position_deg and its height"
    mistake = Mistake((*key, "position_m"), text, remedy=f"write position_deg = {place}, {last}")
    return PlaceSlip(mistake, {name: value for name, value in table.items() if name not in names}, ("position_m",))


def _as_centre(table: dict[str, Any], key: Key) -> PlaceSlip | None:
    for name, value in table.items():
        stem = name.lower().removesuffix("_deg").removesuffix("_m")
        pair = numbers(value, 2)
        if stem not in _CENTRES or pair is None:
            continue
        is_in_degrees = name.lower().endswith("_deg") or has_degrees(value)
        keys = ("lat_deg", "lon_deg") if is_in_degrees else ("north_m", "east_m")
        write = degrees if is_in_degrees else plain
        step = " and ".join(f"{axis} = {write(number)}" for axis, number in zip(keys, pair, strict=True))
        text = f"unknown key; the centre of a disk is {keys[0]} and {keys[1]}"
        mistake = Mistake((*key, name), text, remedy=f"write {step}")
        rest = {other: value for other, value in table.items() if other != name}
        return PlaceSlip(mistake, rest | dict(zip(keys, pair, strict=True)))
    return None
