"""KML and KMZ: tracks in time and route points at altitudes above mean sea level, and the fence.

What KML has no tag for (a circle's radius, the vehicle, the plan) is in ExtendedData, which other programs ignore.
Only files of this program are read back.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
import simplekml

from gcs.errors import FileFormatError
from gcs.frames import from_degE7, to_degE7
from gcs.mission.formats.maps.tracks import DEGREE_DECIMALS, T0_SHOWN, MapFile, MapPoint, Track, checked, checked_points
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint
from gcs.util.archives import BadArchive, read_member
from gcs.util.bounded_file import MIB, in_mib

_NAMES = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>\n'
_T0 = datetime.fromisoformat(T0_SHOWN)
_MS = 1000
_CORNERS = 72  # of a circle on the map
_METRES_PER_DEGREE = 111_320.0  # good enough for a drawn circle
_INSIDE, _OUTSIDE = "ff00aa00", "ff0000cc"  # aabbggrr
_IN_KMZ = "doc.kml"
LARGEST_BYTES = 256 * MIB  # of a KMZ, unpacked
_TAGS_MAX = 4_000_000  # an element takes some hundred bytes of memory


def write_kml(file: MapFile) -> bytes:
    """The bytes of a file; `read_kml` gives back the same values."""
    simplekml.Kml.resetidcounter()  # the same map, the same bytes
    kml = simplekml.Kml(name=file.title)
    kml.document.description = f"Times count from T0, shown as {T0_SHOWN}; altitudes are above mean sea level."
    kml.document.extendeddata.newdata("plan", file.plan_hash)
    for number, track in enumerate(file.tracks):
        line = kml.newgxtrack(name=f"vehicle {track.sysid}", altitudemode=simplekml.AltitudeMode.absolute)
        line.extendeddata.newdata("vehicle", str(track.sysid))
        line.newwhen(list(map(_when, track.t_s.tolist())))
        line.newgxcoord(
            list(zip(track.lon_deg.tolist(), track.lat_deg.tolist(), track.alt_amsl_m.tolist(), strict=True))
        )
        line.style.linestyle.color = _colour(number)
        line.style.linestyle.width = 3
    for point in file.points:
        spot = kml.newpoint(name=point.title, altitudemode=simplekml.AltitudeMode.absolute)
        spot.coords = [(point.lon_deg, point.lat_deg, point.alt_amsl_m)]
        spot.description = f"The leader is here at {point.t_s:.1f} s."
        for key, text in (("route_point", str(point.number)), ("name", escape(point.name)), ("t_s", repr(point.t_s))):
            spot.extendeddata.newdata(key, text)
    for polygon in file.geofence.polygons:
        _draw(kml, polygon.inclusion, ((from_degE7(p.lon_degE7), from_degE7(p.lat_degE7)) for p in polygon.points))
    for circle in file.geofence.circles:
        drawn = _draw(kml, circle.inclusion, _corners(circle))
        for name, value in (
            ("latitude_degE7", circle.center.lat_degE7),
            ("longitude_degE7", circle.center.lon_degE7),
            ("radius_m", repr(circle.radius_m)),
        ):
            drawn.extendeddata.newdata(name, str(value))
    written: str = kml.kml(format=False)
    return (_DECLARATION + written).encode()


def read_kml(data: bytes | str, source: str) -> MapFile:
    """Contents of a file that `write_kml` wrote. Raises `FileFormatError` with file and reason for anything else."""
    try:
        text = data if isinstance(data, str) else data.decode()
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("it declares entities")
        if len(text) > LARGEST_BYTES or text.count("<") > _TAGS_MAX:
            raise ValueError(f"it has more than {in_mib(LARGEST_BYTES)} or {_TAGS_MAX:,} tags")
        document = ElementTree.fromstring(text).find("k:Document", _NAMES)
        if document is None:
            raise ValueError("there is no Document")
        tracks, points, polygons, circles = [], [], [], []
        for placemark in document.findall("k:Placemark", _NAMES):
            extended = _extended(placemark)
            line = placemark.find("gx:Track", _NAMES)
            if line is not None:
                tracks.append(_track(line, _extended(line)))
            elif "route_point" in extended:
                points.append(_point(placemark, extended))
            elif "radius_m" in extended:
                circles.append(_circle(extended))
            else:
                polygons.append(_polygon(placemark, extended))
        title = document.findtext("k:name", "", _NAMES)
        fence = Geofence(tuple(polygons), tuple(circles))
        return MapFile(title, _extended(document).get("plan", ""), checked(tracks), fence, checked_points(points))
    except (ValueError, KeyError, OverflowError, ElementTree.ParseError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise FileFormatError(f"{source}: not a map of this program: {reason[:200]}.") from error


def write_kmz(file: MapFile) -> bytes:
    """The same, zipped; the same map gives the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        info = zipfile.ZipInfo(_IN_KMZ, (1980, 1, 1, 0, 0, 0))
        info.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(info, write_kml(file))
    return buffer.getvalue()


def read_kmz(data: bytes, source: str) -> MapFile:
    """Contents of a file that `write_kmz` wrote. Raises `FileFormatError` with file and reason for anything else."""
    try:
        return read_kml(read_member(io.BytesIO(data), _IN_KMZ, LARGEST_BYTES), source)
    except BadArchive as error:
        raise FileFormatError(f"{source}: not a KMZ archive with {_IN_KMZ} in it: {error}.") from error


def _when(t_s: float) -> str:
    return (_T0 + timedelta(milliseconds=round(t_s * _MS))).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _colour(number: int) -> str:
    """A colour for the track with this number; consecutive numbers have distant hues."""
    hue = number * 0.618034 % 1.0 * 6.0
    parts = (round(255 * min(max(abs((hue + shift) % 6 - 3) - 1, 0), 1)) for shift in (2, 4, 0))
    return "ff" + "".join(f"{part:02x}" for part in parts)


def _draw(kml: Any, inclusion: bool, corners: Iterable[tuple[float, float]]) -> Any:
    ring = list(corners)
    drawn = kml.newpolygon(name="stay inside" if inclusion else "stay outside", outerboundaryis=[*ring, ring[0]])
    drawn.extendeddata.newdata("inclusion", str(int(inclusion)))
    drawn.style.polystyle.fill = 0
    drawn.style.linestyle.color = _INSIDE if inclusion else _OUTSIDE
    drawn.style.linestyle.width = 2
    return drawn


def _corners(circle: FenceCircle) -> Iterable[tuple[float, float]]:
    lat, lon = from_degE7(circle.center.lat_degE7), from_degE7(circle.center.lon_degE7)
    angles = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    north = circle.radius_m / _METRES_PER_DEGREE
    east = north / max(math.cos(math.radians(lat)), 1e-3)
    places = np.round([lon + east * np.sin(angles), lat + north * np.cos(angles)], DEGREE_DECIMALS)
    return zip(*places.tolist(), strict=True)


def _extended(element: ElementTree.Element) -> dict[str, str]:
    found = element.findall("k:ExtendedData/k:Data", _NAMES)
    return {data.get("name", ""): data.findtext("k:value", "", _NAMES) or "" for data in found}


def _track(line: ElementTree.Element, data: dict[str, str]) -> Track:
    times = [datetime.fromisoformat(e.text or "") - _T0 for e in line.findall("k:when", _NAMES)]
    t_s = np.array([(t / timedelta(milliseconds=1)) / _MS for t in times])
    rows = [(e.text or "").split() for e in line.findall("gx:coord", _NAMES)]
    if any(len(row) != 3 for row in rows):
        raise ValueError("a coordinate is not longitude, latitude and altitude")
    lon, lat, alt = np.array(rows, dtype=np.float64).reshape(-1, 3).T.copy()
    return Track(int(data["vehicle"]), t_s, lat, lon, alt)


def _point(placemark: ElementTree.Element, data: dict[str, str]) -> MapPoint:
    place = placemark.findtext("k:Point/k:coordinates", "", _NAMES).split(",")
    if len(place) != 3:
        raise ValueError("a coordinate is not longitude, latitude and altitude")
    lon_deg, lat_deg, alt_m = map(float, place)
    return MapPoint(int(data["route_point"]), data["name"], float(data["t_s"]), lat_deg, lon_deg, alt_m)


def _polygon(placemark: ElementTree.Element, data: dict[str, str]) -> FencePolygon:
    text = placemark.findtext("k:Polygon/k:outerBoundaryIs/k:LinearRing/k:coordinates", "", _NAMES)
    ring = [[float(part) for part in corner.split(",")[:2]] for corner in text.split()][:-1]
    if len(ring) < 3 or any(len(corner) != 2 for corner in ring):
        raise ValueError("a polygon has fewer than three corners")
    return FencePolygon(tuple(_place(lat, lon) for lon, lat in ring), _inclusion(data))


def _circle(data: dict[str, str]) -> FenceCircle:
    center = GeoPoint(int(data["latitude_degE7"]), int(data["longitude_degE7"]))
    radius_m = float(data["radius_m"])
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise ValueError(f"a circle has radius {radius_m:g} m")
    return FenceCircle(center, radius_m, _inclusion(data))


def _inclusion(data: dict[str, str]) -> bool:
    if data["inclusion"] not in ("0", "1"):
        raise ValueError("inclusion is neither 0 nor 1")
    return data["inclusion"] == "1"


def _place(lat_deg: float, lon_deg: float) -> GeoPoint:
    if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180):
        raise ValueError(f"latitude {lat_deg}, longitude {lon_deg} is not on Earth")
    return GeoPoint(to_degE7(lat_deg), to_degE7(lon_deg))
