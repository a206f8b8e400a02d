"""The keys that give a place as latitude and longitude, beside those of each table that give it in metres.

Models have the keys in metres only. `gcs.scenario.validation.to_metres` replaces the others once, as a file is loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal

from pydantic import Field, Strict, TypeAdapter

_Degrees = Annotated[float, Strict(), Field(allow_inf_nan=False)]
_Latitude = Annotated[_Degrees, Field(ge=-90, le=90)]
_Longitude = Annotated[_Degrees, Field(ge=-180, le=180)]
_Place = tuple[_Latitude, _Longitude]
_Height = Annotated[_Degrees, Field(ge=-10_000, le=10_000)]
_Altitude = Annotated[_Degrees, Field(ge=-10_500, le=19_000)]

# How a table holds places: a position with its height; a list of points; one number, or a list, on each axis; a range
# on each axis.
Form = Literal["position", "points", "axes", "box"]


@dataclass(frozen=True)
class DegreeKeys:
    """The keys in metres for a place or for a list of places, and those that say the same in degrees."""

    form: Form
    metres: tuple[str, ...]
    degrees: Mapping[str, Any]  # key: its type, with a description
    heights: Mapping[str, Any] | None = None  # for a position: one of these stands beside it

    @property
    def every(self) -> dict[str, Any]:
        """All keys that stand only where a place is in degrees, with their types."""
        return {**self.degrees, **(self.heights or {})}

    def add_to(self, schema: dict[str, Any]) -> None:
        """Add the keys to a table's JSON Schema, each after those in metres; one of both forms is required."""
        properties: dict[str, Any] = {}
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


def _keys(form: Form, metres: str, **degrees: tuple[Any, str]) -> DegreeKeys:
    """The keys in degrees, each with its type and what it says instead of the one in metres."""
    names = tuple(metres.split())
    said = zip(names, degrees.items(), strict=True)
    types = {key: _said(kind, f"instead of {name}: {text}") for name, (key, (kind, text)) in said}
    return DegreeKeys(form, names, types)


def _said(kind: Any, text: str) -> Any:
    return Annotated[kind, Field(description=text)]


_HEIGHTS = {
    "height_m": _said(_Height, "with position_deg: height, m above height 0"),
    "alt_amsl_m": _said(_Altitude, "with position_deg, instead of height_m: m above mean sea level"),
}
_POSITION = "latitude, longitude, degrees; height_m or alt_amsl_m too"
POSITION = replace(_keys("position", "position_m", position_deg=(_Place, _POSITION)), heights=_HEIGHTS)
_CORNERS = Annotated[tuple[_Place, ...], Field(max_length=500)]
POLYGON = _keys("points", "polygon_m", polygon_deg=(_CORNERS, "its corners in order, [latitude, longitude], degrees"))
GATE = _keys("points", "gate_m", gate_deg=(tuple[_Place, _Place], "its two points, [latitude, longitude], degrees"))
CENTRE = _keys(
    "axes",
    "north_m east_m",
    lat_deg=(_Latitude, "latitude of the centre, degrees"),
    lon_deg=(_Longitude, "longitude of the centre, degrees"),
)
SUMMITS = _keys(
    "axes",
    "north_m east_m",
    lat_deg=(Annotated[tuple[_Latitude, ...], Field(max_length=500)], "latitudes of the summits, degrees"),
    lon_deg=(Annotated[tuple[_Longitude, ...], Field(max_length=500)], "longitudes of the summits, degrees"),
)
_WITHIN = "longitudes [west, east], degrees; the limits are the largest box in metres inside"
BOX = _keys(
    "box",
    "north_m east_m",
    lat_deg=(tuple[_Latitude, _Latitude], "latitudes [south, north], degrees"),
    lon_deg=(tuple[_Longitude, _Longitude], _WITHIN),
)
