"""Drawings in GeoJSON: lines, polygons with holes, and points in their order, with the names in their properties."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeGuard

from gcs.mission.drawings.drawing import (
    AREA_HEIGHTS,
    INSIDE_UNSAID,
    KML_DATUMS,
    Datum,
    Drawing,
    DrawnArea,
    DrawnPoint,
    meaning_of,
    on_earth,
    on_line,
    refusal,
    tidy,
)
from gcs.mission.drawings.labels import Label
from gcs.mission.drawings.line_pieces import LinePiece
from gcs.mission.drawings.sketch import Sketch
from gcs.mission.formats.mission_file import Key, lines_at, offsets_of
from gcs.mission.formats.vendor_quirks import MARK, decoded
from gcs.util.bounded_file import read_json

GEOJSON_TYPES = (
    *("FeatureCollection", "Feature", "GeometryCollection", "LineString", "MultiLineString", "Point", "MultiPoint"),
    *("Polygon", "MultiPolygon"),
)
_PARTS = ("LineString", "Polygon", "Point")
_DEPTH_MAX = 8  # of collections in collections
_NAME_KEYS = ("name", "Name", "title", "label")
_READ_KEYS = ("radius_m", "altitude_amsl_m")  # of what this program exports
_MODE = "altitudeMode"  # the property in which GDAL keeps the mode of KML
_WORLD = ("CRS84", "4326")  # of the old member "crs": the reference system of GeoJSON


@dataclass(frozen=True)
class _Feature:
    label: Label
    name: str
    properties: dict[str, object]


def draw_geojson(data: bytes, source: str) -> Drawing:
    """The drawing in a GeoJSON file. Raises `FileFormatError`."""
    try:
        text = decoded(data, source).removeprefix(MARK)
        document = read_json(text)
        crs = document.get("crs") if isinstance(document, dict) else None
        if crs is not None and not any(name in str(crs)[:400] for name in _WORLD):
            raise ValueError("its member crs names another reference system than WGS 84; save it in EPSG:4326")
        aside: dict[str, list[int]] = {}  # lines of features with properties that say something of a flight
        features = [*_features(document)]
        places = offsets_of(text, {path for path, _, _ in features})
        has_lines = "\n" in text.strip()
        places = lines_at(text, places) if has_lines else {path: at + 1 for path, at in places.items()}
        found = Sketch(source, unit="line" if has_lines else "column")
        for number, (path, geometry, properties) in enumerate(features, start=1):
            read = _READ_KEYS if "radius_m" in properties or "altitude_amsl_m" in properties else ()
            for key, value in properties.items():
                if meaning_of(key) and value and key not in read:
                    aside.setdefault(key, []).append(places.get(path, 1))
            texts = (properties.get(key) for key in _NAME_KEYS)
            name = next((tidy(word) for word in texts if isinstance(word, str)), "")
            label = Label.named("feature", number, name, places.get(path, 1))
            with on_line(places.get(path, 1), found.unit):
                _feature(_Feature(label, name, properties), geometry, found)
    except (ValueError, RecursionError) as error:
        raise refusal(source, error, "GeoJSON") from error
    found.leave_out_data("property", aside, "feature")
    drawn = [line.points for line in found.lines if not line.recorded]
    if any(point.datum is Datum.SEA and point.height_m for points in drawn for point in points):
        found.leave_out(
            Label("heights"), "count from mean sea level; the standard of GeoJSON has them from the ellipsoid"
        )
    return found.drawing()


def _features(
    document: object, path: tuple[Key, ...] = ()
) -> Iterator[tuple[tuple[Key, ...], object, dict[str, object]]]:
    """The geometries of a document, where they stand in it, and their properties."""
    kind = _kind(document)
    if kind == "FeatureCollection":
        for row, feature in enumerate(_list(document, "features")):
            yield from _features(feature, (*path, "features", row))
    elif kind == "Feature" and isinstance(document, dict):
        properties = document.get("properties")
        yield path, document.get("geometry"), properties if isinstance(properties, dict) else {}
    else:
        yield path, document, {}


def _kind(value: object) -> str:
    kind = value.get("type") if isinstance(value, dict) else None
    if not isinstance(kind, str):
        raise ValueError('is not GeoJSON: an object has no "type"')
    return kind


def _list(value: object, key: str) -> list[object]:
    found = value.get(key) if isinstance(value, dict) else value
    if not isinstance(found, list):
        raise ValueError(f'is not GeoJSON: "{key}" is not a list')
    return found


def _geometries(geometry: object, depth: int = 0) -> Iterator[tuple[str, list[object]]]:
    """The kinds and coordinates in a geometry, those of collections and of multi-geometries one by one."""
    kind = _kind(geometry)
    if kind == "GeometryCollection":
        if depth == _DEPTH_MAX:
            raise ValueError("collections are nested too deeply")
        inner = _list(geometry, "geometries")
        for one in inner:
            yield from _geometries(one, depth + 1)
        if not inner:
            yield kind, []
        return
    if kind not in GEOJSON_TYPES or kind.startswith("Feature"):
        yield kind, []
        return
    coordinates = _list(geometry, "coordinates")
    if kind.startswith("Multi"):
        for part in coordinates or [[]]:
            yield kind.removeprefix("Multi"), _list(part, "coordinates")
    else:
        yield kind, coordinates


def _feature(feature: _Feature, geometry: object, found: Sketch) -> None:
    """Add what a feature draws. Raises ValueError."""
    parts = [] if geometry is None else [*_geometries(geometry)]
    if geometry is None:  # a feature may have no place
        found.leave_out(feature.label, "has no place; not carried over")
    for kind in dict.fromkeys(kind for kind, _ in parts if kind not in _PARTS):
        what = "an empty collection" if kind in GEOJSON_TYPES else f"of the unknown type '{tidy(kind)[:40]}'"
        found.leave_out(feature.label, f"{what}; not carried over")
    if any(map(_has_fourth_number, (one for _, one in parts))):
        found.leave_out(feature.label, "the numbers after its heights, times or measures, are not carried over")
    of_kind = {kind: [one for other, one in parts if other == kind] for kind in _PARTS}
    if of_kind["LineString"]:
        _add_line(feature, of_kind["LineString"], found)
    for kind in ("Polygon", "Point"):
        for number, coordinates in enumerate(of_kind[kind], start=1):
            own = feature.label.part(kind.lower(), number, len(of_kind[kind]))
            if not coordinates:
                found.leave_out(own, "has no place; not carried over")
            elif kind == "Polygon":
                _add_area(feature, own, coordinates, found)
            else:
                _add_point(feature, own, coordinates, found)


def _add_line(feature: _Feature, pieces: list[list[object]], found: Sketch) -> None:
    """Add a line; the tracks that this program exports have their heights beside them."""
    counts = feature.properties.get("points")  # of the pieces, where one with a single point has it twice
    if isinstance(counts, list) and len(counts) == len(pieces):
        pieces = [piece[:count] if count == 1 else piece for piece, count in zip(pieces, counts, strict=True)]
    own = [feature.label.part("line", number, len(pieces)) for number in range(1, len(pieces) + 1)]
    drawn = [
        LinePiece(label, _by_mode(feature, label, _line(piece, label), found))
        for label, piece in zip(own, pieces, strict=True)
    ]
    heights = feature.properties.get("altitude_amsl_m")
    total = sum(len(piece.points) for piece in drawn)
    if not isinstance(heights, list) or len(heights) != total or not all(map(_is_number, heights)):
        found.add_line(feature.label, drawn)
        return
    left = iter(heights)
    at_heights = [
        LinePiece(
            piece.label,
            tuple(replace(point, height_m=float(next(left)), datum=Datum.SEA) for point in piece.points),
        )
        for piece in drawn
    ]
    found.add_line(feature.label, at_heights, recorded=True)


def _line(coordinates: Sequence[object], label: Label) -> list[DrawnPoint]:
    return [_point(position, label.part("point", number)) for number, position in enumerate(coordinates, start=1)]


def _has_fourth_number(coordinates: list[object]) -> bool:
    if any(isinstance(one, list) for one in coordinates):
        return any(_has_fourth_number(one) for one in coordinates if isinstance(one, list))
    return len(coordinates) > 3


def _by_mode(feature: _Feature, label: Label, points: list[DrawnPoint], found: Sketch) -> tuple[DrawnPoint, ...]:
    """The points with heights that count as the feature's altitude mode says; without one, from the sea."""
    mode = feature.properties.get(_MODE)
    if not isinstance(mode, str) or not mode or not any(point.datum is Datum.SEA for point in points):
        return tuple(points)
    datum = KML_DATUMS.get(mode, Datum.NONE)
    if datum is Datum.NONE and any(point.height_m for point in points):
        found.leave_out(label, f"its heights are not carried over: its altitude mode is {tidy(mode)[:40]}")
    return tuple(replace(point, datum=datum) if point.datum is Datum.SEA else point for point in points)


def _add_point(feature: _Feature, label: Label, coordinates: list[object], found: Sketch) -> None:
    """Add a point; one with a radius is a disk."""
    if _is_number(radius_m := feature.properties.get("radius_m")) and radius_m > 0:
        centre, inside = _point(coordinates, label).place, feature.properties.get("inclusion") is True
        found.areas.append(DrawnArea((centre,), label, inside, radius_m=float(radius_m)))
    else:
        point = _point(coordinates, label, feature.name if label is feature.label else "")
        found.points.extend(_by_mode(feature, label, [point], found))


def _point(position: object, label: Label, name: str = "") -> DrawnPoint:
    if not isinstance(position, list) or len(position) < 2 or not all(map(_is_number, position[:3])):
        raise ValueError(f"{label} is not longitude, latitude and height")
    lon_deg, lat_deg, *rest = position[:3]
    try:
        place = on_earth(float(lat_deg), float(lon_deg))
    except ValueError as error:
        raise ValueError(f"{label}: {error}; save the drawing in degrees (EPSG:4326)") from None
    return DrawnPoint(place, float(rest[0]) if rest else 0.0, Datum.SEA if rest else Datum.NONE, label, name)


def _add_area(feature: _Feature, label: Label, rings: list[object], found: Sketch) -> None:
    drawn = [_line(_list(edge, "coordinates"), label) for edge in rings]
    if any(point.height_m for edge in drawn for point in edge):
        found.leave_out(label, f"its heights are {AREA_HEIGHTS}")
    edges = [[point.place for point in edge] for edge in drawn]
    inside = feature.properties.get("inclusion")
    if inside is not None and not isinstance(inside, bool):
        found.leave_out(label, f"its inclusion '{tidy(str(inside))[:40]}' is neither true nor false; {INSIDE_UNSAID}")
    found.add_area(label, edges[0], edges[1:], inside if isinstance(inside, bool) else None)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
