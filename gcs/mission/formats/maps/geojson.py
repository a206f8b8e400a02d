"""GeoJSON (RFC 7946): tracks, route points and fence for web maps and GIS programs.

A third coordinate would be a height above the ellipsoid (RFC 7946, section 4). Altitudes here are above mean sea level,
so they are properties, beside the times. Lines and areas are cut at the antimeridian; rings run counterclockwise.
"""

import json

import numpy as np
import shapely

from gcs.frames import unwrapped_deg
from gcs.mission.formats.maps.tracks import DEGREE_DECIMALS, MapFile, MapPoint, Track
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
    lat, lon = np.array([place.place_deg for place in polygon.points]).T
    ring = np.column_stack([unwrapped_deg(lon), lat])
    clockwise = not shapely.LinearRing(ring).is_ccw
    if clockwise:
        ring = np.concatenate([ring[:1], ring[:0:-1]])
    properties: _Members = {"kind": "area", "inclusion": polygon.inclusion, "clockwise": clockwise}
    if np.abs(ring[:, 0]).max() <= _HALF_TURN_DEG:
        return _feature({"type": "Polygon", "coordinates": [[*ring.tolist(), ring[0].tolist()]]}, properties)
    # RFC 7946, section 3.1.9: cut at the antimeridian, each part on its own side
    parts = []
    for turn_deg in (0.0, 2.0 * _HALF_TURN_DEG, -2.0 * _HALF_TURN_DEG):
        low, high = turn_deg - _HALF_TURN_DEG, turn_deg + _HALF_TURN_DEG
        for part in shapely.get_parts(shapely.clip_by_rect(shapely.Polygon(ring), low, -90.0, high, 90.0)):
            if part.area > 0.0:
                corners = np.array(shapely.geometry.polygon.orient(part).exterior.coords) - [turn_deg, 0.0]
                parts.append([np.round(corners, DEGREE_DECIMALS).tolist()])
    return _feature({"type": "MultiPolygon", "coordinates": parts}, properties)
