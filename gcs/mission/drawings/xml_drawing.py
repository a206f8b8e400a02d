"""Drawings in XML, of KML, KMZ and GPX.

Of KML: lines, polygons, points and tracks of Placemarks, in folders of any depth. Of GPX: routes, else tracks, else
waypoints in their order, with heights above the sea.
"""

import io
import math
import re
from collections.abc import Iterable, Iterator
from xml.etree.ElementTree import Element

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import (
    Datum,
    Drawing,
    DrawnArea,
    DrawnLine,
    DrawnPoint,
    Place,
    Sketch,
    labelled,
    on_earth,
    ring,
    tidy,
)
from gcs.util.archives import BadArchive, member_names, read_member
from gcs.util.bounded_file import MIB
from gcs.util.bounded_xml import read_xml, text_of

_IN_KMZ = "doc.kml"
UNPACKED_MAX_BYTES = 64 * MIB
_COMMA = re.compile(r"\s*,\s*")
_DATUMS = {"absolute": Datum.SEA, "relativeToGround": Datum.GROUND}  # all others lie on the ground
_GEOMETRIES = ("LineString", "LinearRing", "Polygon", "Point", "Track", "MultiTrack", "Model")
_ELSEWHERE = ("NetworkLink", "GroundOverlay", "PhotoOverlay", "Tour")
_INSIDE = {"1": True, "0": False}


def draw_kmz(data: bytes, source: str) -> Drawing:
    """The drawing in a KMZ archive: in doc.kml, else in its first KML. Raises `FileFormatError`."""
    try:
        names = [name for name in member_names(io.BytesIO(data)) if name.lower().endswith(".kml")]
        if not names:
            raise BadArchive("it holds no KML")
        name = _IN_KMZ if _IN_KMZ in names else names[0]
        text = read_member(io.BytesIO(data), name, UNPACKED_MAX_BYTES)
    except BadArchive as error:
        raise FileFormatError(f"{source}: is no KMZ: {error}.", hint="save the drawing as KML") from error
    return draw_kml(text, source)


def draw_kml(data: bytes, source: str) -> Drawing:
    """The drawing in a KML file. Raises `FileFormatError`."""
    found = Sketch(source)
    try:
        root = _root(data, "kml")
        for number, placemark in enumerate(root.iter("Placemark"), start=1):
            _placemark(placemark, number, found)
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.", hint="save the drawing again as KML") from error
    for kind in _ELSEWHERE:
        for number, one in enumerate(root.iter(kind), start=1):
            found.leave_out(labelled(kind, number, tidy(text_of(one, "name"))), "not carried over: it draws no line")
    return found.drawing()


def _root(data: bytes, name: str) -> Element:
    root = read_xml(data)
    if root.tag != name:
        raise ValueError(f"its root is <{tidy(root.tag)}>, not <{name}>")
    return root


def _placemark(placemark: Element, number: int, found: Sketch) -> None:
    name = tidy(text_of(placemark, "name"))
    label = labelled("Placemark", number, name)
    marks = {data.get("name", ""): text_of(data, "value") for data in placemark.iter("Data")}
    for shape in _shapes(placemark):
        modes = shape.iter("altitudeMode") if shape.tag == "MultiTrack" else shape.findall("altitudeMode")
        datum = next((_DATUMS.get(text_of(mode), Datum.NONE) for mode in modes), Datum.NONE)
        if shape.tag == "Polygon":
            outer = shape.find("outerBoundaryIs/LinearRing")
            if outer is None:
                raise ValueError(f"{label} is a polygon without an edge")
            holes = [inner.find("LinearRing") for inner in shape.findall("innerBoundaryIs")]
            inner = tuple(_ring(edge, label) for edge in holes if edge is not None)
            found.areas.append(DrawnArea(_ring(outer, label), label, _INSIDE.get(marks.get("inclusion", "")), inner))
        elif shape.tag == "Point":
            found.points += _points(_coordinates(shape), datum, label, name)
        elif shape.tag in ("LineString", "LinearRing"):
            found.lines.append(DrawnLine(label, tuple(_points(_coordinates(shape), datum, label))))
        elif shape.tag in ("Track", "MultiTrack"):
            rows = [text_of(coord).split() for coord in shape.iter("coord")]
            track = tuple(_points(map(_numbers, rows), datum, label))
            found.lines.append(DrawnLine(label, track, recorded=True))
        else:
            found.leave_out(label, "not carried over: a model is no line")


def _shapes(placemark: Element) -> Iterator[Element]:
    """The geometries of a Placemark, also those in a MultiGeometry."""
    for child in placemark:
        if child.tag == "MultiGeometry":
            yield from _shapes(child)
        elif child.tag in _GEOMETRIES:
            yield child


def _coordinates(shape: Element) -> Iterator[list[float]]:
    for corner in _COMMA.sub(",", text_of(shape, "coordinates")).split():
        yield _numbers(corner.split(","))


def _numbers(parts: list[str]) -> list[float]:
    """Longitude, latitude and perhaps a height. Raises ValueError."""
    try:
        values = [float(part) for part in parts if part]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
        raise ValueError(f"'{tidy(','.join(parts))[:60]}' is not longitude, latitude and height")
    return values


def _points(rows: Iterator[list[float]], datum: Datum, label: str, name: str = "") -> Iterator[DrawnPoint]:
    for number, (lon_deg, lat_deg, *rest) in enumerate(rows, start=1):
        height_m, point_datum = (rest[0], datum) if rest else (0.0, Datum.NONE)
        own = label if name or label == "" else f"point {number} of {label}"
        yield DrawnPoint(on_earth(lat_deg, lon_deg), height_m, point_datum, own, name)


def _ring(edge: Element, label: str) -> tuple[Place, ...]:
    return ring([on_earth(lat_deg, lon_deg) for lon_deg, lat_deg, *_ in _coordinates(edge)], label)


def draw_gpx(data: bytes, source: str) -> Drawing:
    """The drawing in a GPX file. Raises `FileFormatError`."""
    sketch = Sketch(source)
    try:
        root = _root(data, "gpx")
        for number, route in enumerate(root.findall("rte"), start=1):
            label = labelled("route", number, tidy(text_of(route, "name")))
            sketch.lines.append(DrawnLine(label, _gpx_points(route.findall("rtept"), label)))
        for number, track in enumerate(root.findall("trk"), start=1):
            label = labelled("track", number, tidy(text_of(track, "name")))
            points = (point for segment in track.findall("trkseg") for point in segment.findall("trkpt"))
            sketch.lines.append(DrawnLine(label, _gpx_points(points, label), recorded=True))
        sketch.points += _gpx_points(root.findall("wpt"), "")
    except ValueError as error:
        raise FileFormatError(f"{source}: {error}.", hint="save the drawing again as GPX") from error
    sketch.lines = [line for line in sketch.lines if line.points]
    return sketch.drawing()


def _gpx_points(elements: Iterable[Element], of: str) -> tuple[DrawnPoint, ...]:
    return tuple(_gpx_point(element, number, of) for number, element in enumerate(elements, start=1))


def _gpx_point(element: Element, number: int, of: str) -> DrawnPoint:
    name = tidy(text_of(element, "name"))
    label = f"{labelled('point', number, name)} of {of}" if of else labelled("waypoint", number, name)
    lat_deg, lon_deg = (_number(element.get(key, ""), label, key) for key in ("lat", "lon"))
    height = text_of(element, "ele")
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
