"""Drawings in GeoJSON: lines, polygons with holes, and points in their order, with the names in their properties."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import (
    Datum,
    Drawing,
    DrawnArea,
    DrawnLine,
    DrawnPoint,
    Sketch,
    labelled,
    on_earth,
    ring,
    tidy,
)
from gcs.util.bounded_file import read_json

GEOJSON_TYPES = (
    *("FeatureCollection", "Feature", "GeometryCollection", "LineString", "MultiLineString", "Point", "MultiPoint"),
    *("Polygon", "MultiPolygon"),
)
_DEPTH_MAX = 8  # of collections in collections
_NAME_KEYS = ("name", "Name", "title", "label")
_WORLD = ("CRS84", "4326")  # of the old member "crs": the reference system of GeoJSON


@dataclass(frozen=True)
class _Feature:
    geometry: Any
    label: str
    name: str
    properties: dict[str, Any]


def draw_geojson(data: bytes, source: str) -> Drawing:
    """The drawing in a GeoJSON file. Raises `FileFormatError`."""
    found = Sketch(source)
    try:
        document = read_json(data.decode("utf-8-sig"))
        crs = document.get("crs") if isinstance(document, dict) else None
        if crs is not None and not any(name in str(crs)[:400] for name in _WORLD):
            raise ValueError("its member crs names another reference system than WGS 84; save it in EPSG:4326")
        for number, (geometry, properties) in enumerate(_features(document), start=1):
            name = next((tidy(properties[key]) for key in _NAME_KEYS if isinstance(properties.get(key), str)), "")
            label = labelled("feature", number, name)
            _geometry(_Feature(geometry, label, name, properties), geometry, found)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{source}: {str(error)[:200]}.", hint="save the drawing again as GeoJSON") from error
    if any(point.datum is Datum.SEA for line in found.lines for point in line.points if not line.recorded):
        found.leave_out("heights", "count from mean sea level; the standard of GeoJSON has them from the ellipsoid")
    return found.drawing()


def _features(document: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
    """The geometries of a document, and their properties."""
    kind = _kind(document)
    if kind == "FeatureCollection":
        for feature in _list(document, "features"):
            yield from _features(feature)
    elif kind == "Feature":
        properties = document.get("properties")
        yield document.get("geometry"), properties if isinstance(properties, dict) else {}
    else:
        yield document, {}


def _kind(value: Any) -> str:
    kind = value.get("type") if isinstance(value, dict) else None
    if not isinstance(kind, str):
        raise ValueError('is not GeoJSON: an object has no "type"')
    return kind


def _list(value: Any, key: str) -> list[Any]:
    found = value.get(key) if isinstance(value, dict) else value
    if not isinstance(found, list):
        raise ValueError(f'is not GeoJSON: "{key}" is not a list')
    return found


def _geometry(feature: _Feature, geometry: Any, found: Sketch, depth: int = 0) -> None:
    if geometry is None:  # a feature may have no place
        return
    kind = _kind(geometry)
    if kind == "GeometryCollection":
        if depth == _DEPTH_MAX:
            raise ValueError("collections are nested too deeply")
        for one in _list(geometry, "geometries"):
            _geometry(feature, one, found, depth + 1)
        return
    coordinates = _list(geometry, "coordinates")
    if kind == "Point" and _is_number(radius_m := feature.properties.get("radius_m")) and radius_m > 0:
        centre, inside = _point(coordinates, feature.label).place, feature.properties.get("inclusion") is True
        found.areas.append(DrawnArea((centre,), feature.label, inside, radius_m=float(radius_m)))
    elif kind == "Point":
        found.points.append(_point(coordinates, feature.label, feature.name))
    elif kind == "MultiPoint":
        found.points += _line(coordinates, feature)
    elif kind == "LineString":
        found.lines.append(_drawn(feature, _line(coordinates, feature)))
    elif kind == "MultiLineString":
        pieces = [point for piece in coordinates for point in _line(_list(piece, "coordinates"), feature)]
        found.lines.append(_drawn(feature, pieces))
    elif kind in ("Polygon", "MultiPolygon"):
        for rings in [coordinates] if kind == "Polygon" else coordinates:
            _area(feature, _list(rings, "coordinates"), found)
    else:
        raise ValueError(f"{feature.label} is of the unknown type '{tidy(kind)}'")


def _line(coordinates: Sequence[Any], feature: _Feature) -> list[DrawnPoint]:
    return [
        _point(position, f"point {number} of {feature.label}") for number, position in enumerate(coordinates, start=1)
    ]


def _drawn(feature: _Feature, points: list[DrawnPoint]) -> DrawnLine:
    """A line; the tracks that this program exports have their heights beside them."""
    heights = feature.properties.get("altitude_amsl_m")
    if not isinstance(heights, list) or len(heights) != len(points) or not all(map(_is_number, heights)):
        return DrawnLine(feature.label, tuple(points))
    placed = [
        DrawnPoint(point.place, float(height), Datum.SEA, point.label)
        for point, height in zip(points, heights, strict=True)
    ]
    return DrawnLine(feature.label, tuple(placed), recorded=True)


def _point(position: Any, label: str, name: str = "") -> DrawnPoint:
    if not isinstance(position, list) or len(position) < 2 or not all(map(_is_number, position[:3])):
        raise ValueError(f"{label} is not longitude, latitude and height")
    lon_deg, lat_deg, *rest = position[:3]
    try:
        place = on_earth(float(lat_deg), float(lon_deg))
    except ValueError as error:
        raise ValueError(f"{label}: {error}; save the drawing in degrees (EPSG:4326)") from None
    return DrawnPoint(place, float(rest[0]) if rest else 0.0, Datum.SEA if rest else Datum.NONE, label, name)


def _area(feature: _Feature, rings: list[Any], found: Sketch) -> None:
    edges = [
        ring([point.place for point in _line(_list(edge, "coordinates"), feature)], feature.label) for edge in rings
    ]
    if not edges:
        raise ValueError(f"{feature.label} is a polygon without an edge")
    inside = feature.properties.get("inclusion")
    found.areas.append(
        DrawnArea(edges[0], feature.label, inside if isinstance(inside, bool) else None, tuple(edges[1:]))
    )


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
