"""A scenario's tables with metres in the place of latitude and longitude, and mistakes in the file's own degrees.

All later layers know metres only.
"""

from __future__ import annotations

import dataclasses
import re
import typing
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from gcs.frames import Origin, geodetic_to_ned, ned_to_geodetic, place_up_m
from gcs.scenario.schema.degree_keys import DegreeKeys, adapter
from gcs.scenario.schema.fields import Part
from gcs.scenario.schema.mistake import Mistake, degrees, dotted, plain, value_at
from gcs.scenario.schema.scenario import OriginTable, Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.schema_words import from_pydantic
from gcs.scenario.validation.written_places import Pair, is_number, numbers, pairs_of, question, written
from gcs.types import Array

_SPOILT = ""  # no number: it makes a table invalid, and keeps rules about other tables away from it
_DIGITS = 6  # of metres: a place that is given twice is the same place
_NUMBER = r"(-?[\d.]*\d)"
_RANGE = re.compile(r"Write \[[-\d., e+]+\]$")  # in metres
_HEIGHT = 2  # index in a position
_EARTH_M, _WIDER_M = 6.37e6, 0.05
_ROUNDING_M = 0.02  # of degrees with seven digits


@dataclass(frozen=True)
class InDegrees:
    """A place that a table gives in degrees: its keys and values there, and where it is."""

    table: Key
    keys: DegreeKeys
    values: dict[str, Any]
    origin: Origin
    metres: dict[str, Any]


@dataclass
class InMetres:
    """The tables in metres, the mistakes in their degrees, the places that were converted, and those with mistakes."""

    data: dict[str, Any]
    origin: Origin | None  # None where it has mistakes of its own
    mistakes: list[Mistake] = field(default_factory=list)
    places: list[InDegrees] = field(default_factory=list)
    spoilt: set[Key] = field(default_factory=set)

    @property
    def certain(self) -> set[Key]:
        """The keys in metres whose places were in degrees: nothing needs to be asked about their numbers."""
        return {(*place.table, name) for place in self.places for name in place.keys.metres}

    def table(self, model: type[Part], table: dict[str, Any], key: Key) -> dict[str, Any]:
        """One table with its places in metres."""
        read = dict(table)
        for name, part in _inner_tables(model).items():
            value, path = table.get(name), (*key, name)
            if isinstance(value, dict):
                read[name] = self.table(part, value, path)
            elif isinstance(value, list):
                read[name] = [
                    self.table(part, one, (*path, row)) if isinstance(one, dict) else one
                    for row, one in enumerate(value)
                ]
        for keys in model.degree_keys:
            self._place(keys, read, key)
        return read

    def _place(self, keys: DegreeKeys, table: dict[str, Any], key: Key) -> None:
        """Replace one place of a table."""
        values = {name: table.pop(name) for name in keys.every if name in table}
        values = {name: value for name, value in values.items() if value is not None}  # as JSON has what is left out
        if not values:
            return
        in_metres = [name for name in keys.metres if table.get(name) is not None]
        mistakes = list(_place_mistakes(keys, values, in_metres, self.origin, key))
        self.mistakes += mistakes
        if not mistakes and self.origin is not None:
            metres = _converted(keys, values, self.origin)
            table |= metres
            self.places.append(InDegrees(key, keys, values, self.origin, metres))
        elif len(in_metres) < len(keys.metres):
            table |= dict.fromkeys(keys.metres, _SPOILT)
            self.spoilt |= {(*key, name) for name in keys.metres}


def in_metres(data: dict[str, Any]) -> InMetres:
    """The tables of a scenario with known keys, each place in metres from [origin]."""
    try:
        origin = Origin(**OriginTable.model_validate(data.get("origin")).model_dump())
    except ValidationError:
        origin = None
    found = InMetres({}, origin)
    found.data = found.table(Scenario, data, ())
    return found


def _place_mistakes(
    keys: DegreeKeys, values: dict[str, Any], in_metres: list[str], origin: Origin | None, key: Key
) -> Iterator[Mistake]:
    """The mistakes of one place in degrees: of its keys, of where it is, and of each number."""
    names, heights = list(keys.degrees), [name for name in keys.heights or () if name in values]
    lacking, first = [name for name in names if name not in values], next(iter(values))
    third = numbers(values.get(names[0]), 3) if keys.form == "position" else None
    if in_metres:
        text = f"stands beside {' and '.join(in_metres)}; a place is in metres or in degrees"
        text += ", with its height" if keys.heights else ""
        yield Mistake((*key, first), text, values[first], remedy="keep one of the two")
    elif lacking:
        step = f"add {lacking[0]}" + (" = [latitude, longitude]" if keys.heights else ", in degrees")
        yield Mistake((*key, lacking[0]), f"missing; {first} needs it", remedy=step)
    if in_metres or lacking:
        return
    if keys.heights and not heights and not third:
        text = f"missing; {first} needs a height: height_m above the origin, or alt_amsl_m above the sea"
        yield Mistake((*key, "height_m"), text, remedy="add height_m, in m")
    if heights[1:]:
        text = f"stands beside {heights[0]}; both are the height. Keep one of the two"
        yield Mistake((*key, heights[1]), text, values[heights[1]])
    found = list(_misplaced(keys, values, third, origin, key))
    yield from found
    for name in heights if found else values:
        try:
            adapter(keys.every[name]).validate_python(values[name])
        except ValidationError as error:
            yield from from_pydantic(error, Scenario, (*key, name))


def _misplaced(
    keys: DegreeKeys, values: dict[str, Any], third: Pair | None, origin: Origin | None, key: Key
) -> Iterator[Mistake]:
    """Places that are not near the origin, and lists that are none of places."""
    name, *_ = keys.degrees
    value, height = values[name], plain(third[2]) if third and len(values) == 1 else ""
    places, where = pairs_of(keys, [values[one] for one in keys.degrees]), (*key, name)
    asked = [question(place, origin) if origin else None for place in places]
    wrong = [one for one in asked if one]
    if wrong and all(one.degrees for one in wrong):
        meant = [one.degrees if one and one.degrees else place for one, place in zip(asked, places, strict=True)]
        yield Mistake(where, wrong[0].text, value, remedy=f"write {written(keys, meant, height)}")
    elif wrong and all(one and one.is_metres for one in asked):
        height = plain(values["height_m"]) if is_number(values.get("height_m")) else height
        yield Mistake(where, wrong[0].text, value, remedy=f"write {written(keys, places, height, metres=True)}")
    elif wrong:
        for row, (one, place) in enumerate(zip(asked, places, strict=True)):
            at, shown = ((*where, row), place) if keys.form == "points" else (where, value)
            if one:
                yield Mistake(at, one.text, shown, remedy="correct the place, or [origin]")
    elif third:
        text = "has three numbers; it is latitude and longitude, and the height has its own key"
        yield Mistake(where, text, value, remedy=f"write {written(keys, places, height)}")


def _converted(keys: DegreeKeys, values: dict[str, Any], origin: Origin) -> dict[str, Any]:
    """The keys in metres of a place without mistakes."""
    if keys.form == "position":
        lat_deg, lon_deg = values["position_deg"]
        if "height_m" in values:
            return {"position_m": _listed(place_up_m(lat_deg, lon_deg, values["height_m"], origin))}
        ned_m = geodetic_to_ned(lat_deg, lon_deg, values["alt_amsl_m"], origin)
        return {"position_m": _listed(ned_m * [1.0, 1.0, -1.0])}
    if keys.form == "points":
        (points,) = values.values()
        lat, lon = np.array(points, dtype=float).reshape(-1, 2).T
        return {keys.metres[0]: _listed(place_up_m(lat, lon, 0.0, origin)[:, :2])}
    if keys.form == "axes":
        lat, lon = (np.array(values[name], dtype=float) for name in keys.degrees)
        size = max(lat.shape, lon.shape)  # where one is shorter, the model tells that
        flat_m = place_up_m(np.resize(lat, size), np.resize(lon, size), 0.0, origin)
        axes = [_listed(flat_m[: one.size, axis] if size else flat_m[axis]) for axis, one in enumerate((lat, lon))]
        return dict(zip(keys.metres, axes, strict=True))
    return _box(values["lat_deg"], values["lon_deg"], origin)


def _box(lat_deg: list[float], lon_deg: list[float], origin: Origin) -> dict[str, Any]:
    """The largest box in metres between two parallels and two meridians."""
    west, wide = lon_deg[0], (lon_deg[1] - lon_deg[0]) % 360.0
    middle = min((origin.lon_deg - west) % 360.0, wide)  # where a parallel is nearest to the equator's side
    lons = west + np.array([0.0, middle, wide])
    south, north = (place_up_m(lat, lons, 0.0, origin) for lat in lat_deg)
    edges = np.array([south, north])
    return {
        "north_m": _listed(np.array([south[:, 0].max(), north[:, 0].min()])),
        "east_m": _listed(np.array([edges[:, 0, 1].max(), edges[:, 2, 1].min()])),
    }


def _listed(metres: Array) -> Any:
    return (np.round(metres, _DIGITS) + 0.0).tolist()


@lru_cache
def _inner_tables(model: type[BaseModel]) -> dict[str, type[Part]]:
    """The keys of a table that hold tables, and the models of these."""
    found = {name: _part_in(model_field.annotation) for name, model_field in model.model_fields.items()}
    return {name: part for name, part in found.items() if part is not None}


def _part_in(annotation: Any) -> type[Part] | None:
    if isinstance(annotation, type) and issubclass(annotation, Part):
        return annotation
    return next((part for part in map(_part_in, typing.get_args(annotation)) if part is not None), None)


def in_degree_keys(mistake: Mistake, found: InMetres) -> Mistake:
    """The mistake with the keys, the value and the next step that fit the file."""
    for place in found.places:
        mistake = dataclasses.replace(
            mistake, remedy=_step(mistake.remedy, place), text=_text(mistake.text, place, mistake.key)
        )
        depth = len(place.table)
        if mistake.key[:depth] == place.table and mistake.key[depth : depth + 1] in [(n,) for n in place.keys.metres]:
            path = _path(mistake.key[depth:], place)
            mistake = dataclasses.replace(mistake, key=(*place.table, *path), value=value_at(place.values, path))
    return mistake


def _path(metres: Key, place: InDegrees) -> Key:
    """The key of a table in the file for one in metres."""
    (name, *rest), keys = metres, place.keys
    if keys.form == "position":
        return (_height_key(place) if rest == [_HEIGHT] else "position_deg",)
    return (list(keys.degrees)[keys.metres.index(str(name))], *(rest if keys.form != "box" else ()))


def _height_key(place: InDegrees) -> str:
    return next(name for name in place.keys.heights or () if name in place.values)


def _text(text: str, place: InDegrees, key: Key) -> str:
    """A text that names keys in metres: with those of the file."""
    for metres, other in zip(place.keys.metres, place.keys.degrees, strict=True):
        if place.keys.form == "box":
            text = text.replace(f"limits.{metres},", f"limits.{other}, {metres[:-2]}")
            if key == (*place.table, metres):
                text = _RANGE.sub("Exchange the two numbers", text)
        elif key[: len(place.table)] == place.table:
            text = re.sub(rf"(?<![\w.]){metres}\b", other, text)
    return text


def _step(step: str, place: InDegrees) -> str:
    """A next step that sets keys in metres: with those of the file."""
    table = re.escape(dotted(place.table))
    if place.keys.form == "position":
        pattern = rf"(?<={table}\.)position_m\[([012])\] to {_NUMBER}"
        return re.sub(pattern, lambda found: _moved(place, int(found[1]), float(found[2])), step)
    pattern = rf"(?<={table}\.)(north_m|east_m) to \[{_NUMBER}, {_NUMBER}\]"
    return re.sub(pattern, lambda found: _wider(place, found[1], float(found[2]), float(found[3])), step)


def _moved(place: InDegrees, axis: int, to_m: float) -> str:
    """The position with another coordinate, in degrees or as a height."""
    position = np.array(place.metres["position_m"])
    position[axis] = to_m + (np.sign(to_m - position[axis]) * _ROUNDING_M if axis != _HEIGHT else 0.0)
    lat_deg, lon_deg, alt_amsl_m = map(float, ned_to_geodetic(position * [1.0, 1.0, -1.0], place.origin))
    if axis != _HEIGHT:
        return f"position_deg to [{degrees(lat_deg)}, {degrees(lon_deg)}]"
    height = _height_key(place)
    return f"{height} to {plain(to_m if height == 'height_m' else alt_amsl_m)}"


def _wider(place: InDegrees, name: str, low_m: float, high_m: float) -> str:
    """A range of the box in degrees that holds one in metres."""
    # Parallels are curved and meridians meet, so that the box between them is narrower than at the origin.
    reach_m = max(map(abs, (low_m, high_m, *place.metres["north_m"], *place.metres["east_m"])))
    room_m = _WIDER_M + reach_m**2 * abs(np.tan(np.radians(place.origin.lat_deg))) / _EARTH_M
    ends, axis = np.zeros((2, 3)), place.keys.metres.index(name)
    ends[:, axis] = low_m - room_m, high_m + room_m
    low_deg, high_deg = map(float, ned_to_geodetic(ends, place.origin)[axis])
    return f"{[*place.keys.degrees][axis]} to [{degrees(low_deg)}, {degrees(high_deg)}]"
