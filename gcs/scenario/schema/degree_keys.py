"""The keys that give a place as latitude and longitude, beside those of each table that give it in metres.

Models have the keys in metres only. `gcs.scenario.validation.to_metres` replaces the others once, as a file is loaded.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Annotated, Any, TypeGuard

import numpy as np
from pydantic import Field, Strict, TypeAdapter

from gcs.frames import Origin, geodetic_to_ned, ned_to_geodetic, place_up_m
from gcs.scenario.schema.mistake import EXACT, plain
from gcs.scenario.schema.toml_lines import Key, Table
from gcs.types import Array

_Degrees = Annotated[float, Strict(), Field(allow_inf_nan=False)]
_Latitude = Annotated[_Degrees, Field(ge=-90, le=90)]
_Longitude = Annotated[_Degrees, Field(ge=-180, le=180)]
_Place = tuple[_Latitude, _Longitude]
_Height = Annotated[_Degrees, Field(ge=-10_000, le=10_000)]
_Altitude = Annotated[_Degrees, Field(ge=-10_500, le=19_000)]

Pair = Sequence[float]  # as written: latitude, longitude, or north, east
Values = Mapping[str, Any]  # of the keys in degrees, or of those in metres

_LISTED = 4  # places that a message writes out
_WRITTEN_MAX = 1e12  # larger numbers were not typed by a person
_DIGITS = 6  # of metres: a place that is given twice is the same place
_HEIGHT = 2  # index in a position
ABOVE_GROUND = "height_above_ground_m"  # instead of a height in a position, in metres or in degrees
_EARTH_M, _WIDER_M = 6.37e6, 0.05
_ROUNDING_M = 0.02  # of degrees with seven digits


def numbers(value: object, *counts: int) -> tuple[float, ...] | None:
    """A list as numbers that a person may have written; None for anything else, and for more or fewer of them."""
    if not isinstance(value, list | tuple) or (counts and len(value) not in counts):
        return None
    return tuple(value) if all(map(is_number, value)) else None


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a number that a person may have written."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -_WRITTEN_MAX < value < _WRITTEN_MAX


@dataclass(frozen=True)
class DegreeKeys:
    """The keys in metres for a place or for a list of places, and those that say the same in degrees.

    This is a list of points under one key; other forms derive from it.
    """

    metres: tuple[str, ...]
    degrees: Mapping[str, object]  # key: its type, with a description
    heights: Mapping[str, object] = field(default_factory=dict)  # for a position: one of these stands beside it

    def _rows(self, given: Sequence[object]) -> Iterable[object]:
        """The places in the values of the keys of one form, whatever stands there."""
        return given[0] if isinstance(given[0], list | tuple) else ()

    def values(self, places: Sequence[Pair]) -> list[Any]:
        """The values of the keys of one form."""
        return [[list(place) for place in places]]

    def pairs(self, given: Sequence[object]) -> list[Pair]:
        """The places in the values of the keys of one form; none where something else than places stands there."""
        found: list[Pair | None] = [numbers(row, 2) for row in self._rows(given)]
        return [] if None in found else [pair for pair in found if pair]

    def written(self, places: Sequence[Pair], height: str = "", *, metres: bool = False) -> str:
        """The keys and values of places in a file; those of a position with its height, of many the first ones."""
        names, digits = (self.metres, 3) if metres else (self.degrees, EXACT)
        values = [plain(value, digits) for value in self.values(places[:_LISTED])]
        if len(places) > _LISTED:
            values = [f"{value[:-1]}, ...]" for value in values]
        return " and ".join(f"{name} = {value}" for name, value in zip(names, values, strict=True))

    def converted(self, values: Values, origin: Origin) -> Table:
        """The keys in metres of places without mistakes."""
        lat, lon = np.array(self.pairs([values[name] for name in self.degrees]), dtype=float).reshape(-1, 2).T
        flat_m = _rounded(place_up_m(lat, lon, 0.0, origin)[:, :2])
        return dict(zip(self.metres, self.values(flat_m), strict=True))

    def in_file(self, key: Key, values: Values) -> Key:
        """The key with one in metres replaced by that of a file with these values."""
        return ([*self.degrees][self.metres.index(str(key[0]))], *key[1:])

    def changed(self, name: str, key: Key, value: Any, metres: Values, origin: Origin) -> Any:
        """The value of a key of the file for a new one of a key in metres; `metres` are those that it has now."""
        raise NotImplementedError(f"{name} for {key}")

    @property
    def every(self) -> Table:
        """All keys that stand only where a place is in degrees, with their types."""
        return {**self.degrees, **self.heights}

    def add_to(self, schema: Table) -> None:
        """Add the keys to a table's JSON Schema, each after those in metres; one of both forms is required."""
        properties: Table = {}
        for name, node in schema["properties"].items():
            properties[name] = node
            if name == self.metres[-1]:
                properties |= {key: adapter(kind).json_schema() for key, kind in self.every.items()}
        schema["properties"] = properties
        required = schema.get("required", [])
        if set(self.metres) <= set(required):
            rest = [name for name in required if name not in self.metres]
            schema["required"] = rest
            if not rest:
                del schema["required"]
            schema["oneOf"] = [{"required": list(self.metres)}, {"required": list(self.degrees)}]


@lru_cache(maxsize=64)
def adapter(kind: Any) -> TypeAdapter[Any]:
    """The validator of a key's type."""
    return TypeAdapter(kind)


class _Position(DegreeKeys):
    """A place with its height."""

    def _rows(self, given: Sequence[object]) -> Iterable[object]:
        return [(numbers(given[0], 2, 3) or ())[:2]]

    def values(self, places: Sequence[Pair]) -> list[Any]:
        return [list(places[0])]

    def written(self, places: Sequence[Pair], height: str = "", *, metres: bool = False) -> str:
        text = super().written(places, metres=metres)
        if metres:
            return f"{text[:-1]}, {height or 'height'}]"
        return f"{text}, height_m = {height}" if height else text

    def converted(self, values: Values, origin: Origin) -> Table:
        lat_deg, lon_deg = values["position_deg"]
        if "alt_amsl_m" not in values:
            up_m = place_up_m(lat_deg, lon_deg, values.get("height_m", 0.0), origin)
            return {"position_m": _rounded(up_m)}
        ned_m = geodetic_to_ned(lat_deg, lon_deg, values["alt_amsl_m"], origin)
        return {"position_m": _rounded(ned_m * [1.0, 1.0, -1.0])}

    def in_file(self, key: Key, values: Values) -> Key:
        height = next((name for name in self.heights if name in values), ABOVE_GROUND)
        return (height if key[1:] == (_HEIGHT,) else "position_deg",)

    def changed(self, name: str, key: Key, value: Any, metres: Values, origin: Origin) -> Any:
        position, axis = np.array(metres["position_m"]), int(key[1])
        position[axis] = value + (np.sign(value - position[axis]) * _ROUNDING_M if axis != _HEIGHT else 0.0)
        lat_deg, lon_deg, alt_amsl_m = map(float, ned_to_geodetic(position * [1.0, 1.0, -1.0], origin))
        return {"position_deg": [lat_deg, lon_deg], "height_m": value, "alt_amsl_m": alt_amsl_m}[name]

    def add_to(self, schema: Table) -> None:
        super().add_to(schema)
        schema["properties"]["position_m"]["minItems"] = _HEIGHT  # beside a height above the ground


class _Centre(DegreeKeys):
    """One place, with a key for each of its numbers."""

    def _rows(self, given: Sequence[object]) -> Iterable[object]:
        return [given]

    def values(self, places: Sequence[Pair]) -> list[Any]:
        return list(places[0])


class _Columns(DegreeKeys):
    """Places, with a list for each of their numbers."""

    def _rows(self, given: Sequence[object]) -> Iterable[object]:
        return zip(*given, strict=False) if all(map(numbers, given)) else [()]

    def values(self, places: Sequence[Pair]) -> list[Any]:
        return [list(column) for column in zip(*places, strict=True)] or [[], []]

    def converted(self, values: Values, origin: Origin) -> Table:
        sizes = [len(values[name]) for name in self.degrees]  # where one is shorter, the model tells that
        full = super().converted({name: np.resize(values[name], max(sizes)).tolist() for name in self.degrees}, origin)
        return {name: column[:size] for (name, column), size in zip(full.items(), sizes, strict=True)}


class _Box(_Columns):
    """A range on each axis."""

    def converted(self, values: Values, origin: Origin) -> Table:
        """The largest box in metres between two parallels and two meridians."""
        lat_deg, (west, east) = values["lat_deg"], values["lon_deg"]
        wide = (east - west) % 360.0
        middle = min((origin.lon_deg - west) % 360.0, wide)  # where a parallel is nearest to the equator's side
        south, north = (place_up_m(lat, west + np.array([0.0, middle, wide]), 0.0, origin) for lat in lat_deg)
        left_m, right_m = max(south[0, 1], north[0, 1]), min(south[2, 1], north[2, 1])
        ends_m = np.array([[south[:, 0].max(), north[:, 0].min()], [left_m, right_m]])
        return dict(zip(self.metres, _rounded(ends_m), strict=True))

    def in_file(self, key: Key, values: Values) -> Key:
        return super().in_file(key, values)[:1]

    def changed(self, name: str, key: Key, value: Any, metres: Values, origin: Origin) -> Any:
        # Parallels are curved and meridians meet, so that the box between them is narrower than at the origin.
        reach_m = max(abs(end) for end in (*value, *metres["north_m"], *metres["east_m"]))
        room_m = _WIDER_M + reach_m**2 * abs(np.tan(np.radians(origin.lat_deg))) / _EARTH_M
        ends, axis = np.zeros((2, 3)), self.metres.index(str(key[0]))
        ends[:, axis] = value[0] - room_m, value[1] + room_m
        return [float(end) for end in ned_to_geodetic(ends, origin)[axis]]


def _rounded(metres: Array) -> Any:
    return (np.round(metres, _DIGITS) + 0.0).tolist()


def _keys(form: type[DegreeKeys], metres: str, **degrees: tuple[object, str]) -> DegreeKeys:
    """The keys in degrees that may replace those in metres, each with its type and description."""
    names = tuple(metres.split())
    rows = zip(names, degrees.items(), strict=True)
    types = {key: _described(kind, f"instead of {name}: {text}") for name, (key, (kind, text)) in rows}
    return form(names, types)


def _described(kind: object, text: str) -> object:
    return Annotated[kind, Field(description=text)]


_HEIGHTS = {
    "height_m": _described(_Height, "with position_deg: height, m above height 0"),
    "alt_amsl_m": _described(_Altitude, "with position_deg, instead of height_m: m above mean sea level"),
}
_POSITION = "latitude, longitude, degrees; height_m or alt_amsl_m too"
POSITION = replace(_keys(_Position, "position_m", position_deg=(_Place, _POSITION)), heights=_HEIGHTS)
_CORNERS = Annotated[tuple[_Place, ...], Field(max_length=500)]
POLYGON = _keys(DegreeKeys, "polygon_m", polygon_deg=(_CORNERS, "its corners in order, [latitude, longitude], degrees"))
GATE = _keys(DegreeKeys, "gate_m", gate_deg=(tuple[_Place, _Place], "its two points, [latitude, longitude], degrees"))
CENTRE = _keys(
    _Centre,
    "north_m east_m",
    lat_deg=(_Latitude, "latitude of the centre, degrees"),
    lon_deg=(_Longitude, "longitude of the centre, degrees"),
)
SUMMITS = _keys(
    _Columns,
    "north_m east_m",
    lat_deg=(Annotated[tuple[_Latitude, ...], Field(max_length=500)], "latitudes of the summits, degrees"),
    lon_deg=(Annotated[tuple[_Longitude, ...], Field(max_length=500)], "longitudes of the summits, degrees"),
)
_WITHIN = "longitudes [west, east], degrees; the limits are the largest box in metres inside"
BOX = _keys(
    _Box,
    "north_m east_m",
    lat_deg=(tuple[_Latitude, _Latitude], "latitudes [south, north], degrees"),
    lon_deg=(tuple[_Longitude, _Longitude], _WITHIN),
)
