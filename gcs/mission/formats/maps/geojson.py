"""GeoJSON (RFC 7946): tracks, route points and fence for web maps and GIS programs.

A third coordinate would be a height above the ellipsoid (RFC 7946, section 4). Altitudes here are above mean sea level,
so they are properties, beside the times. Lines are cut at the antimeridian; rings run counterclockwise.
"""

import json

import numpy as np

from gcs.mission.formats.maps.tracks import MapFile, MapPoint, Track
from gcs.mission.geofence import FencePolygon

_HALF_TURN_DEG = 180.0
_Members = dict[str, object]


def write_geojson(file: MapFile) -> str:
    """The text of a file."""
    features = [_track(track) for track in file.tracks]
    features += [_route_point(point) for point in file.points]
    features += [_area(polygon) for polygon in file.geofence.polygons]
    for circle in file.geofence.circles:
        properties = {"kind": "circle", "inclusion": circle.inclusion, "radius_m": circle.radius_m}
        features.append(_feature({"type": "Point", "coordinates": circle.center.place_deg[::-1]}, properties))
    collection = {"type": "FeatureCollection", "title": file.title, "plan": file.plan_hash, "features": features}
    return json.dumps(collection, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n"


def _feature(geometry: _Members, properties: _Members) -> _Members:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _track(track: Track) -> _Members:
    points = np.column_stack([track.lon_deg, track.lat_deg])
    crossings = np.flatnonzero(np.abs(np.diff(track.lon_deg)) > _HALF_TURN_DEG) + 1
    pieces = [piece.tolist() for piece in np.split(points, crossings)]
    properties: _Members = {"kind": "track", "vehicle": track.sysid, "t_s": track.t_s.tolist()}
    properties["altitude_amsl_m"] = track.alt_amsl_m.tolist()
    lines = [piece * 2 if len(piece) == 1 else piece for piece in pieces]
    if lines != pieces:
        properties["points"] = [len(piece) for piece in pieces]
    if len(lines) == 1:
        return _feature({"type": "LineString", "coordinates": lines[0]}, properties)
    return _feature({"type": "MultiLineString", "coordinates": lines}, properties)


def _route_point(point: MapPoint) -> _Members:
    properties = {"kind": "route_point", "number": point.number, "name": point.name, "t_s": point.t_s}
    properties["altitude_amsl_m"] = point.alt_amsl_m
    return _feature({"type": "Point", "coordinates": [point.lon_deg, point.lat_deg]}, properties)


def _area(polygon: FencePolygon) -> _Members:
    """Exterior rings run counterclockwise and close; `clockwise` records the order in the fence."""
    ring = [list(place.place_deg[::-1]) for place in polygon.points]
    lon, lat = np.array(ring).T
    clockwise = bool(np.sum(lon * np.roll(lat, -1) - np.roll(lon, -1) * lat) < 0)
    if clockwise:
        ring = [ring[0], *ring[:0:-1]]
    properties = {"kind": "area", "inclusion": polygon.inclusion, "clockwise": clockwise}
    return _feature({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}, properties)
