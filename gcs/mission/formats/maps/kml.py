"""KML and KMZ: tracks in time and route points at altitudes above mean sea level, and the fence.

What KML has no tag for (a circle's radius, the vehicle, the plan) is in ExtendedData, which other programs ignore.
"""

import io
import math
import zipfile
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import simplekml

from gcs.frames import wrapped_deg
from gcs.mission.formats.maps.tracks import DEGREE_DECIMALS, T0_SHOWN, MapFile

_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>\n'
_T0 = datetime.fromisoformat(T0_SHOWN)
_MS = 1000
_CORNERS = 72  # of a circle on the map
_METRES_PER_DEGREE = 111_320.0  # good enough for a drawn circle
_INSIDE, _OUTSIDE = "ff00aa00", "ff0000cc"  # aabbggrr
_IN_KMZ = "doc.kml"


def write_kml(file: MapFile) -> bytes:
    """The bytes of a file."""
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
        hue = number * 0.618034 % 1.0 * 6.0
        parts = (round(255 * min(max(abs((hue + shift) % 6 - 3) - 1, 0), 1)) for shift in (2, 4, 0))
        line.style.linestyle.color = "ff" + "".join(f"{part:02x}" for part in parts)
        line.style.linestyle.width = 3
    for point in file.points:
        spot = kml.newpoint(name=point.title, altitudemode=simplekml.AltitudeMode.absolute)
        spot.coords = [(point.lon_deg, point.lat_deg, point.alt_amsl_m)]
        spot.description = f"The leader is here at {point.t_s:.1f} s."
        for key, text in (("route_point", str(point.number)), ("name", escape(point.name)), ("t_s", repr(point.t_s))):
            spot.extendeddata.newdata(key, text)
    for polygon in file.geofence.polygons:
        _draw(kml, polygon.inclusion, (place.place_deg[::-1] for place in polygon.points))
    for circle in file.geofence.circles:
        lat, lon = circle.center.place_deg
        angles = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
        north = circle.radius_m / _METRES_PER_DEGREE
        east = north / max(math.cos(math.radians(lat)), 1e-3)
        places = np.round([wrapped_deg(lon + east * np.sin(angles)), lat + north * np.cos(angles)], DEGREE_DECIMALS)
        drawn = _draw(kml, circle.inclusion, zip(*places.tolist(), strict=True))
        for name, value in (
            ("latitude_degE7", circle.center.lat_degE7),
            ("longitude_degE7", circle.center.lon_degE7),
            ("radius_m", repr(circle.radius_m)),
        ):
            drawn.extendeddata.newdata(name, str(value))
    written: str = kml.kml(format=False)
    return (_DECLARATION + written).encode()


def write_kmz(file: MapFile) -> bytes:
    """The same, zipped; the same map gives the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        info = zipfile.ZipInfo(_IN_KMZ, (1980, 1, 1, 0, 0, 0))
        info.compress_type = zipfile.ZIP_DEFLATED
        archive.writestr(info, write_kml(file))
    return buffer.getvalue()


def _when(t_s: float) -> str:
    return (_T0 + timedelta(milliseconds=round(t_s * _MS))).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _draw(kml: Any, inclusion: bool, corners: Iterable[tuple[float, float]]) -> Any:
    ring = list(corners)
    drawn = kml.newpolygon(name="stay inside" if inclusion else "stay outside", outerboundaryis=[*ring, ring[0]])
    drawn.extendeddata.newdata("inclusion", str(int(inclusion)))
    drawn.style.polystyle.fill = 0
    drawn.style.linestyle.color = _INSIDE if inclusion else _OUTSIDE
    drawn.style.linestyle.width = 2
    return drawn
