"""Drawings in XML, of KML, KMZ and GPX.

Of KML: lines, polygons, points and tracks of Placemarks, in folders of any depth. Of GPX: routes, else tracks, else
waypoints in their order, with heights above the sea. Every place that none of them holds is left out with its line.
"""

import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

from gcs.errors import FileFormatError, counted
from gcs.mission.drawings.drawing import (
    AREA_HEIGHTS,
    INSIDE_UNSAID,
    KML_DATUMS,
    Datum,
    Drawing,
    DrawnPoint,
    Place,
    meaning_of,
    on_earth,
    on_line,
    refusal,
    tidy,
)
from gcs.mission.drawings.labels import Label, LeftOut
from gcs.mission.drawings.line_pieces import LinePiece
from gcs.mission.drawings.sketch import Sketch
from gcs.util.archives import BadArchive, member_names, read_member
from gcs.util.bounded_file import MIB
from gcs.util.bounded_xml import line_of, read_xml, text_of

_IN_KMZ = "doc.kml"
UNPACKED_MAX_BYTES = 64 * MIB
_COMMA = re.compile(r"\s*,\s*")
_CLAMPED = "clampToGround"  # the altitude mode of a geometry that gives none
_LINES, _TRACKS = ("LineString", "LinearRing"), ("Track", "MultiTrack")
_GEOMETRIES = (*_LINES, *_TRACKS, "Polygon", "Point", "Model")
_WITHOUT_PLACE = frozenset(  # what a Placemark has beside its geometry
    (
        *("name", "visibility", "open", "author", "link", "address", "AddressDetails", "phoneNumber", "Snippet"),
        *("snippet", "description", "LookAt", "Camera", "TimeStamp", "TimeSpan", "styleUrl", "Style", "StyleMap"),
        *("Region", "Metadata", "ExtendedData", "balloonVisibility"),
    )
)
_ELSEWHERE = {
    "NetworkLink": "the file that it links to is not read",
    **dict.fromkeys(("GroundOverlay", "ScreenOverlay", "PhotoOverlay"), "not carried over: an image is no line"),
    "Tour": "not carried over: it draws no line",
    "Update": "not carried over: a change of another file",
}
_SAYING = ("Data", "SimpleData")  # elements of ExtendedData with a name and a value
_INSIDE = {"1": True, "true": True, "0": False, "false": False}


def draw_kmz(data: bytes, source: str) -> Drawing:
    """The drawing in a KMZ archive: in doc.kml, else in its first KML. Raises `FileFormatError`."""
    try:
        names = [name for name in member_names(io.BytesIO(data)) if name.lower().endswith(".kml")]
        if not names:
            raise BadArchive("it holds no KML")
        name = next((name for name in names if name.lower() == _IN_KMZ), names[0])
        text = read_member(io.BytesIO(data), name, UNPACKED_MAX_BYTES)
    except BadArchive as error:
        raise FileFormatError(f"{source}: is no KMZ: {error}.", hint="save the drawing as KML") from error
    drawing = draw_kml(text, source)
    others = tuple(LeftOut(Label(tidy(one)), f"not read; the drawing is {tidy(name)}") for one in names if one != name)
    return replace(drawing, left_out=drawing.left_out + others)


def draw_kml(data: bytes, source: str) -> Drawing:
    """The drawing in a KML file. Raises `FileFormatError`."""
    found = Sketch(source)
    try:
        root = _root(data, "kml")
        reader = _KmlReader(found)
        changes = {id(one) for update in root.iter("Update") for one in update.iter("Placemark")}
        placemarks = [one for one in root.iter("Placemark") if id(one) not in changes]
        for number, placemark in enumerate(placemarks, start=1):
            with on_line(line_of(placemark)):
                reader.placemark(placemark, number)
        reader.rest(root)
    except ValueError as error:
        raise refusal(source, error, "KML") from error
    return found.drawing()


def _root(data: bytes, name: str) -> Element:
    root = read_xml(data)
    if root.tag != name:
        raise ValueError(f"its root is <{tidy(root.tag)}>, not <{name}>")
    return root


@dataclass
class _KmlReader:
    """Reads Placemarks into a sketch, and remembers which places of the file it has read."""

    found: Sketch
    read: set[int] = field(default_factory=set)  # identities of elements
    aside: dict[str, list[int]] = field(default_factory=dict)  # lines of Placemarks with data that say of a flight

    def placemark(self, placemark: Element, number: int) -> None:
        """Add what a Placemark draws. Raises ValueError."""
        name = tidy(text_of(placemark, "name"))
        label = Label.named("Placemark", number, name, line_of(placemark))
        marks = {
            data.get("name", ""): text_of(data, "value") or text_of(data)
            for kind in _SAYING
            for data in placemark.iter(kind)
        }
        for key, value in marks.items():
            if meaning_of(key) and value:
                self.aside.setdefault(key, []).append(line_of(placemark))
        before = len(self.found.left_out)
        shapes = [*self._shapes(placemark, label)]
        if not shapes and len(self.found.left_out) == before:
            self.found.leave_out(label, "has no geometry; not carried over")
        lines = [shape for shape in shapes if shape.tag in _LINES]
        if lines:
            self.found.add_line(label, [*self._pieces(lines, "line", label)])
        tracks = [shape for shape in shapes if shape.tag in _TRACKS]
        if tracks:
            segments = [one for track in tracks for one in _segments(track)]
            self.found.add_line(label, [*self._pieces(segments, "track", label)], recorded=True)
        for kind in ("Polygon", "Point", "Model"):
            parts = [shape for shape in shapes if shape.tag == kind]
            for part, shape in enumerate(parts, start=1):
                own = label.part(kind.lower(), part, len(parts), line_of(shape))
                if kind == "Polygon":
                    inside = marks.get("inclusion", "").lower()
                    if inside and inside not in _INSIDE:
                        text = f"its inclusion '{tidy(inside)[:40]}' is neither true nor false; {INSIDE_UNSAID}"
                        self.found.leave_out(own, text)
                    self._polygon(shape, own, _INSIDE.get(inside))
                elif kind == "Point":
                    points = [*self._points(shape, own, name)]
                    self.found.points.extend(points)
                    if not points:
                        self.found.leave_out(own, "has no place; not carried over")
                else:
                    self.found.leave_out(own, "not carried over: a model is no line")

    def rest(self, root: Element) -> None:
        """Leave out what stands outside of Placemarks, each with a sentence."""
        for kind, text in _ELSEWHERE.items():
            for number, one in enumerate(root.iter(kind), start=1):
                label = Label.named(kind, number, tidy(text_of(one, "name")), line_of(one))
                self.found.leave_out(label, text)
                self._have_read(one)
        for one in root.iter():
            if one.tag in ("coordinates", "coord") and id(one) not in self.read:
                label = Label(f"<{one.tag}> on line {line_of(one)}")
                self.found.leave_out(label, "not carried over: in no known geometry")
        self.found.leave_out_data("data", self.aside, "Placemark")

    def _have_read(self, element: Element) -> None:
        self.read.update(id(one) for one in element.iter())

    def _shapes(self, parent: Element, label: Label) -> Iterator[Element]:
        """The geometries of a Placemark, also those in a MultiGeometry; every other is left out."""
        for child in parent:
            if child.tag == "MultiGeometry":
                yield from self._shapes(child, label)
            elif child.tag in _GEOMETRIES:
                yield child
            elif child.tag not in _WITHOUT_PLACE and child.tag not in _ELSEWHERE:
                self._have_read(child)
                what = f"its <{tidy(child.tag)[:40]}> on line {line_of(child)} is no geometry of KML; not carried over"
                self.found.leave_out(label, what)

    def _pieces(self, shapes: Sequence[Element], what: str, label: Label) -> Iterator[LinePiece]:
        for number, shape in enumerate(shapes, start=1):
            own = label.part(what, number, len(shapes), line_of(shape))
            yield LinePiece(own, tuple(self._points(shape, own)))

    def _points(self, shape: Element, label: Label, name: str = "") -> Iterator[DrawnPoint]:
        """The points of a geometry, at heights that count as its own altitude mode says."""
        datum, offset_m = self._mode(shape, label)
        rows = [*(self._track(shape, label) if shape.tag == "Track" else self._coordinates(shape, label))]
        mode = text_of(shape, "altitudeMode")
        if KML_DATUMS.get(mode) is Datum.NONE:
            self._lost_heights(rows, label, f"not carried over: its altitude mode is {mode or _CLAMPED}")
        for number, (lon_deg, lat_deg, *rest) in enumerate(rows, start=1):
            own = label if shape.tag == "Point" else label.part("point", number)
            height_m, point_datum = (rest[0] + offset_m, datum) if rest else (0.0, Datum.NONE)
            yield DrawnPoint(on_earth(lat_deg, lon_deg, own), height_m, point_datum, own, name)

    def _mode(self, shape: Element, label: Label) -> tuple[Datum, float]:
        """What heights of a geometry count from, and what is added to them."""
        modes = list(dict.fromkeys(text_of(mode) for mode in shape.findall("altitudeMode")))
        if len(modes) > 1:
            self.found.leave_out(label, f"has altitude modes {' and '.join(map(tidy, modes))}; the first one counts")
        mode = modes[0] if modes else ""
        if mode not in KML_DATUMS:
            text = f"its altitude mode '{tidy(mode)[:40]}' is none that can be flown; its heights are not carried over"
            self.found.leave_out(label, text)
        datum, text = KML_DATUMS.get(mode, Datum.NONE), text_of(shape, "altitudeOffset")
        offset_m = _number(text, label, "altitudeOffset") if text else 0.0
        if offset_m and datum is Datum.NONE:
            self.found.leave_out(label, f"its altitudeOffset of {offset_m:g} m is not carried over: it has no heights")
        return datum, offset_m

    def _coordinates(self, shape: Element, label: Label) -> Iterator[list[float]]:
        self._only(shape, "coordinates", label)
        for corner in _COMMA.sub(",", text_of(shape, "coordinates")).split():
            yield _numbers(corner.split(","))

    def _track(self, track: Element, label: Label) -> Iterator[list[float]]:
        rows = track.findall("coord")
        self.read.update(map(id, rows))
        filled = [row for row in rows if text_of(row)]
        if len(filled) < len(rows):
            self.found.leave_out(label, f"{len(rows) - len(filled)} of its {len(rows)} places are empty")
        return (_numbers(text_of(row).split()) for row in filled)

    def _only(self, shape: Element, tag: str, label: Label) -> None:
        """Raise ValueError where a geometry has several of what it may have one of."""
        found = shape.findall(tag)
        self.read.update(map(id, found))
        if len(found) > 1:
            raise ValueError(
                f"{label} has {len(found)} <{tag}>, the second on line {line_of(found[1])}; one is allowed"
            )

    def _polygon(self, shape: Element, label: Label, inside: bool | None) -> None:
        outer, holes = (
            [edge for side in shape.findall(sides) for edge in side.findall("LinearRing")]
            for sides in ("outerBoundaryIs", "innerBoundaryIs")
        )
        if not outer:
            self.found.leave_out(label, "a polygon without an outer edge; not carried over")
            return
        if len(outer) > 1:
            text = f"{label} has {len(outer)} outer edges, the second on line {line_of(outer[1])}"
            raise ValueError(f"{text}; draw a polygon for each")
        self.found.add_area(label, self._ring(outer[0], label), [self._ring(edge, label) for edge in holes], inside)

    def _ring(self, edge: Element, label: Label) -> list[Place]:
        rows = [*self._coordinates(edge, label)]
        self._lost_heights(rows, label, AREA_HEIGHTS)
        return [on_earth(lat_deg, lon_deg, label) for lon_deg, lat_deg, *_ in rows]

    def _lost_heights(self, rows: Sequence[Sequence[float]], label: Label, why: str) -> None:
        """Leave out the heights of places, where they have any: converters write 0 for none."""
        if any(height_m for _, _, *rest in rows for height_m in rest):
            self.found.leave_out(label, f"its heights are {why}")


def _segments(track: Element) -> Iterator[Element]:
    """The Tracks of a MultiTrack; one without an altitude mode has that of the MultiTrack."""
    if track.tag == "Track":
        yield track
        return
    mode = track.find("altitudeMode")
    for one in track.findall("Track"):
        if mode is not None and one.find("altitudeMode") is None:
            one.append(mode)
        yield one


def _numbers(parts: list[str]) -> list[float]:
    """Longitude, latitude and perhaps a height. Raises ValueError."""
    try:
        values = list(map(float, parts[:-1] if len(parts) > 2 and not parts[-1] else parts))
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
        raise ValueError(f"'{tidy(','.join(parts))[:60]}' is not longitude, latitude and height")
    return values


def draw_gpx(data: bytes, source: str) -> Drawing:
    """The drawing in a GPX file. Raises `FileFormatError`."""
    sketch = Sketch(source)
    try:
        root = _root(data, "gpx")
        for number, route in enumerate(root.findall("rte"), start=1):
            label = Label.named("route", number, tidy(text_of(route, "name")), line_of(route))
            sketch.add_line(label, [LinePiece(label, _gpx_points(route.findall("rtept"), label))])
        for number, track in enumerate(root.findall("trk"), start=1):
            label = Label.named("track", number, tidy(text_of(track, "name")), line_of(track))
            segments = track.findall("trkseg")
            own = [label.part("segment", n, len(segments), line_of(one)) for n, one in enumerate(segments, start=1)]
            pieces = [
                LinePiece(one, _gpx_points(seg.findall("trkpt"), one)) for one, seg in zip(own, segments, strict=True)
            ]
            sketch.add_line(label, pieces, recorded=True)
        sketch.points.extend(_gpx_points(root.findall("wpt"), None))
    except ValueError as error:
        raise refusal(source, error, "GPX") from error
    _gpx_rest(root, sketch)
    return sketch.drawing()


def _gpx_rest(root: Element, sketch: Sketch) -> None:
    """Leave out the places that are in no route, track or waypoint: shaping points of a navigator, for example."""
    read = {id(one) for path in ("rte/rtept", "trk/trkseg/trkpt", "wpt") for one in root.findall(path)}
    others: dict[str, list[Element]] = {}
    aside: dict[str, list[int]] = {}
    for one in root.iter():
        if id(one) not in read and one.get("lat") is not None and one.get("lon") is not None:
            others.setdefault(one.tag, []).append(one)
        elif one.tag != "ele" and meaning_of(one.tag) and text_of(one):
            aside.setdefault(one.tag, []).append(line_of(one))
    sketch.leave_out_data("element", aside, "point")
    for tag, places in others.items():
        text = f"{counted(len(places), 'place')}, the first on line {line_of(places[0])}; not carried over"
        sketch.leave_out(Label(f"<{tidy(tag)[:40]}>"), text)


def _gpx_points(elements: Iterable[Element], whole: Label | None) -> tuple[DrawnPoint, ...]:
    points = []
    for number, element in enumerate(elements, start=1):
        name = tidy(text_of(element, "name"))
        what = "waypoint" if whole is None else "point"
        label = Label.named(what, number, name, line_of(element), whole)
        with on_line(line_of(element)):
            points.append(_gpx_point(element, label, name))
    return tuple(points)


def _gpx_point(element: Element, label: Label, name: str) -> DrawnPoint:
    lat_deg, lon_deg = (_number(element.get(key, ""), label, key) for key in ("lat", "lon"))
    height = text_of(element, "ele") or element.get("ele", "")  # some programs write it beside lat and lon
    height_m = _number(height, label, "ele") if height else 0.0
    return DrawnPoint(on_earth(lat_deg, lon_deg, label), height_m, Datum.SEA if height else Datum.NONE, label, name)


def _number(text: str, label: Label, key: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{label}: {key} is not a number: '{tidy(text)[:40]}'")
    return value
