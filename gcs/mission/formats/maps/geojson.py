"""GeoJSON (RFC 7946): tracks, route points and fence for web maps and GIS programs.

Only files of this program are read back.

A third coordinate would be a height above the ellipsoid (RFC 7946, section 4). Altitudes here are above mean sea level,
so they are properties, beside the times. Lines are cut at the antimeridian; rings run counterclockwise.
"""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, TypeAdapter, ValidationError

from gcs.errors import FileFormatError
from gcs.frames import from_degE7, to_degE7
from gcs.mission.formats.maps.tracks import MapFile, MapPoint, Track, checked
from gcs.mission.geofence import LEAST_VERTICES, FenceCircle, FencePolygon, Geofence, GeoPoint
from gcs.util.bounded_file import refuse_crowded_json

Finite = Annotated[float, Field(allow_inf_nan=False)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Position = tuple[Longitude, Latitude]
VALUES_MAX = 8_000_000
_HALF_TURN_DEG = 180.0


class _Part(BaseModel):
    model_config = ConfigDict(strict=True)


class _Lines(_Part):
    type: Literal["MultiLineString"]
    coordinates: list[list[Position]]


class _Line(_Part):
    type: Literal["LineString"]
    coordinates: list[Position]


class _Ring(_Part):
    type: Literal["Polygon"]
    coordinates: Annotated[list[Annotated[list[Position], Field(min_length=LEAST_VERTICES + 1)]], Field(min_length=1)]


class _Spot(_Part):
    type: Literal["Point"]
    coordinates: Position


class _TrackProperties(_Part):
    kind: Literal["track"]
    vehicle: int
    t_s: list[Finite]
    altitude_amsl_m: list[Finite]
    points: list[int] | None = None  # of every piece, where a piece of one point had to be written twice


class _AreaProperties(_Part):
    kind: Literal["area"]
    inclusion: bool
    clockwise: bool


class _CircleProperties(_Part):
    kind: Literal["circle"]
    inclusion: bool
    radius_m: Annotated[Finite, Field(gt=0)]


class _PointProperties(_Part):
    kind: Literal["route_point"]
    number: int
    name: str
    t_s: Finite
    altitude_amsl_m: Finite


class _PointFeature(_Part):
    type: Literal["Feature"]
    geometry: _Spot
    properties: _PointProperties


class _TrackFeature(_Part):
    type: Literal["Feature"]
    geometry: Annotated[_Line | _Lines, Field(discriminator="type")]
    properties: _TrackProperties


class _AreaFeature(_Part):
    type: Literal["Feature"]
    geometry: _Ring
    properties: _AreaProperties


class _CircleFeature(_Part):
    type: Literal["Feature"]
    geometry: _Spot
    properties: _CircleProperties


def _kind(feature: Any) -> str:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    return str(properties.get("kind")) if isinstance(properties, dict) else ""


class _Collection(_Part):
    type: Literal["FeatureCollection"]
    title: str
    plan: str
    features: list[
        Annotated[
            Annotated[_TrackFeature, Tag("track")]
            | Annotated[_PointFeature, Tag("route_point")]
            | Annotated[_AreaFeature, Tag("area")]
            | Annotated[_CircleFeature, Tag("circle")],
            Discriminator(_kind),
        ]
    ]


_ADAPTER = TypeAdapter(_Collection)


def write_geojson(file: MapFile) -> str:
    """The text of a file; `read_geojson` gives back the same values."""
    features = [_track(track) for track in file.tracks]
    features += [_route_point(point) for point in file.points]
    features += [_area(polygon) for polygon in file.geofence.polygons]
    features += [
        _feature(
            {"type": "Point", "coordinates": _position(circle.center)},
            {"kind": "circle", "inclusion": circle.inclusion, "radius_m": circle.radius_m},
        )
        for circle in file.geofence.circles
    ]
    collection = {"type": "FeatureCollection", "title": file.title, "plan": file.plan_hash, "features": features}
    return json.dumps(collection, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n"


def read_geojson(data: bytes | str, source: str) -> MapFile:
    """Contents of a file that `write_geojson` wrote. Raises `FileFormatError` with file and reason otherwise."""
    try:
        refuse_crowded_json(data, VALUES_MAX)
        collection = _ADAPTER.validate_json(data)
        tracks, points, polygons, circles = [], [], [], []
        for feature in collection.features:
            if isinstance(feature, _TrackFeature):
                tracks.append(_read_track(feature))
            elif isinstance(feature, _PointFeature):
                points.append(_read_point(feature))
            elif isinstance(feature, _AreaFeature):
                polygons.append(_read_area(feature))
            else:
                center, properties = _place(feature.geometry.coordinates), feature.properties
                circles.append(FenceCircle(center, properties.radius_m, properties.inclusion))
        fence = Geofence(tuple(polygons), tuple(circles))
        return MapFile(collection.title, collection.plan, checked(tracks), fence, tuple(points))
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(map(str, first["loc"]))
        reason = f"{key}: {first['msg']}" if key else first["msg"]
        raise FileFormatError(f"{source}: not a map of this program: {reason}.") from error
    except ValueError as error:
        raise FileFormatError(f"{source}: not a map of this program: {error}.") from error


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _track(track: Track) -> dict[str, Any]:
    points = np.column_stack([track.lon_deg, track.lat_deg])
    crossings = np.flatnonzero(np.abs(np.diff(track.lon_deg)) > _HALF_TURN_DEG) + 1
    pieces = [piece.tolist() for piece in np.split(points, crossings)]
    properties: dict[str, Any] = {"kind": "track", "vehicle": track.sysid, "t_s": track.t_s.tolist()}
    properties["altitude_amsl_m"] = track.alt_amsl_m.tolist()
    lines = [piece * 2 if len(piece) == 1 else piece for piece in pieces]
    if lines != pieces:
        properties["points"] = [len(piece) for piece in pieces]
    if len(lines) == 1:
        return _feature({"type": "LineString", "coordinates": lines[0]}, properties)
    return _feature({"type": "MultiLineString", "coordinates": lines}, properties)


def _read_track(feature: _TrackFeature) -> Track:
    properties, geometry = feature.properties, feature.geometry
    lines = geometry.coordinates if isinstance(geometry, _Lines) else [geometry.coordinates]
    if properties.points is not None:
        lines = [line[: max(count, 0)] for line, count in zip(lines, properties.points, strict=True)]
    lon, lat = np.array([point for line in lines for point in line], dtype=np.float64).reshape(-1, 2).T.copy()
    return Track(properties.vehicle, np.array(properties.t_s), lat, lon, np.array(properties.altitude_amsl_m))


def _route_point(point: MapPoint) -> dict[str, Any]:
    properties = {"kind": "route_point", "number": point.number, "name": point.name, "t_s": point.t_s}
    properties["altitude_amsl_m"] = point.alt_amsl_m
    return _feature({"type": "Point", "coordinates": [point.lon_deg, point.lat_deg]}, properties)


def _read_point(feature: _PointFeature) -> MapPoint:
    known, (lon_deg, lat_deg) = feature.properties, feature.geometry.coordinates
    return MapPoint(known.number, known.name, known.t_s, lat_deg, lon_deg, known.altitude_amsl_m)


def _area(polygon: FencePolygon) -> dict[str, Any]:
    """Exterior rings run counterclockwise and close; `clockwise` records the order in the fence."""
    ring = [_position(place) for place in polygon.points]
    clockwise = _is_clockwise(ring)
    if clockwise:
        ring = [ring[0], *ring[:0:-1]]
    properties = {"kind": "area", "inclusion": polygon.inclusion, "clockwise": clockwise}
    return _feature({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}, properties)


def _read_area(feature: _AreaFeature) -> FencePolygon:
    ring = feature.geometry.coordinates[0][:-1]
    if feature.properties.clockwise:
        ring = [ring[0], *ring[:0:-1]]
    return FencePolygon(tuple(map(_place, ring)), feature.properties.inclusion)


def _is_clockwise(ring: list[list[float]]) -> bool:
    lon, lat = np.array(ring).T
    return bool(np.sum(lon * np.roll(lat, -1) - np.roll(lon, -1) * lat) < 0)


def _position(place: GeoPoint) -> list[float]:
    return [from_degE7(place.lon_degE7), from_degE7(place.lat_degE7)]


def _place(position: tuple[float, float]) -> GeoPoint:
    return GeoPoint(to_degE7(position[1]), to_degE7(position[0]))
