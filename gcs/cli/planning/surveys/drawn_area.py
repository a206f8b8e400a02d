"""The area of a GeoJSON file: its only polygon, with its holes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs.errors import FileFormatError
from gcs.reading.bounded_file import MISSION_FILE, read_file
from gcs.reading.bounded_json import read_json

Ring = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class SurveyedArea:
    """Corners and holes: latitude, longitude, degrees."""

    corners: Ring
    holes: tuple[Ring, ...] = ()


def drawn_area(file: Path) -> SurveyedArea:
    """The only polygon of a file. Raises FileFormatError."""
    try:
        polygons = list(_polygons(read_json(read_file(file, MISSION_FILE))))
        if len(polygons) != 1:
            raise ValueError(f"it has {len(polygons)} polygons, not one")
        rings = [tuple((float(lat), float(lon)) for lon, lat, *_ in ring[:-1]) for ring in polygons[0]]
    except (ValueError, TypeError, KeyError) as error:
        raise FileFormatError(f"{file}: no area: {error}.", hint="draw one polygon") from None
    return SurveyedArea(rings[0], tuple(rings[1:]))


def _polygons(value: Any) -> Any:
    if value["type"] == "FeatureCollection":
        for feature in value["features"]:
            yield from _polygons(feature)
    elif value["type"] == "Feature":
        yield from _polygons(value["geometry"])
    elif value["type"] == "Polygon":
        yield value["coordinates"]
    elif value["type"] == "MultiPolygon":
        yield from value["coordinates"]
