"""Drawings in GPX 1.0 and 1.1: routes, else tracks, else waypoints in their order. Heights are above the sea."""

from __future__ import annotations

import math
from collections.abc import Iterable

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnPoint, Sketch, labelled, on_earth, tidy
from gcs.mission.drawings.drawn_lines import DrawnLine, drawing_of
from gcs.reading.bounded_xml import XmlElement, read_xml


def draw_gpx(data: bytes, source: str) -> Drawing:
    """The drawing in a GPX file. Raises `FileFormatError`."""
    sketch = Sketch(source)
    try:
        root = read_xml(data)
        if root.name != "gpx":
            raise ValueError(f"its root is <{tidy(root.name)}>, not <gpx>")
        lines = []
        for number, route in enumerate(root.all("rte"), start=1):
            label = labelled("route", number, tidy(route.said("name")))
            lines.append(DrawnLine(label, _points(route.all("rtept"), label)))
        for number, track in enumerate(root.all("trk"), start=1):
            label = labelled("track", number, tidy(track.said("name")))
            points = (point for segment in track.all("trkseg") for point in segment.all("trkpt"))
            lines.append(DrawnLine(label, _points(points, label), recorded=True))
        spots = _points(root.all("wpt"), "")
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.", hint="save the drawing again as GPX") from error
    return drawing_of(sketch, [line for line in lines if line.points], spots)


def _points(elements: Iterable[XmlElement], of: str) -> tuple[DrawnPoint, ...]:
    return tuple(_point(element, number, of) for number, element in enumerate(elements, start=1))


def _point(element: XmlElement, number: int, of: str) -> DrawnPoint:
    name = tidy(element.said("name"))
    label = f"{labelled('point', number, name)} of {of}" if of else labelled("waypoint", number, name)
    lat_deg, lon_deg = (_number(element.attributes.get(key, ""), label, key) for key in ("lat", "lon"))
    height = element.said("ele")
    height_m = _number(height, label, "ele") if height else 0.0
    return DrawnPoint(on_earth(lat_deg, lon_deg), height_m, Datum.SEA if height else Datum.NONE, label, name)


def _number(text: str, label: str, key: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{label}: {key} is not a number: '{tidy(text)[:40]}'")
    return value
