"""The tracks in KML and GeoJSON files, as programs that show them read them: by the standard library."""

from __future__ import annotations

import json
from datetime import datetime
from xml.etree import ElementTree

import numpy as np

from gcs.mission.formats.maps.tracks import T0_SHOWN, Track

KML = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}


def kml_tracks(text: str | bytes) -> list[Track]:
    """By vehicle, in the order of the file."""
    found = []
    for line in ElementTree.fromstring(text).iterfind("k:Document/k:Placemark/gx:Track", KML):
        whens = [datetime.fromisoformat(each.text or "") for each in line.iterfind("k:when", KML)]
        t_s = [(when - datetime.fromisoformat(T0_SHOWN)).total_seconds() for when in whens]
        rows = [(each.text or "").split() for each in line.iterfind("gx:coord", KML)]
        lon, lat, alt = np.array(rows, dtype=np.float64).reshape(-1, 3).T
        sysid = line.findtext("k:ExtendedData/k:Data[@name='vehicle']/k:value", "", KML)
        found.append(Track(int(sysid), np.array(t_s), lat, lon, alt))
    return found


def geojson_tracks(text: str | bytes) -> list[Track]:
    """By vehicle, in the order of the file; pieces of one point are written twice."""
    found = []
    for feature in json.loads(text)["features"]:
        properties, geometry = feature["properties"], feature["geometry"]
        if properties["kind"] == "track":
            lines = geometry["coordinates"] if geometry["type"] == "MultiLineString" else [geometry["coordinates"]]
            counts = properties.get("points", [len(line) for line in lines])
            points = [point for line, count in zip(lines, counts, strict=True) for point in line[:count]]
            lon, lat = np.array(points, dtype=np.float64).reshape(-1, 2).T
            altitude = np.array(properties["altitude_amsl_m"])
            found.append(Track(properties["vehicle"], np.array(properties["t_s"]), lat, lon, altitude))
    return found
