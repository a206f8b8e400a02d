"""Every element of a drawn file is flown, kept as an area, or left out with a sentence, in every format."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Datum, Drawing
from gcs.mission.drawings.labels import sentences
from gcs.mission.drawings.route_formats import drawing_in
from gcs.mission.drawings.to_scenario.route_flight import route_flight

Place = tuple[float, float]


def kml(placemarks: str) -> Drawing:
    return drawing_in(f"<kml><Document>{placemarks}</Document></kml>".encode(), "x.kml")


def coordinates(places: list[Place], height: str = "") -> str:
    return "<coordinates>" + " ".join(f"{lon},{lat}{height}" for lat, lon in places) + "</coordinates>"


def line(north: float, count: int = 2, east: float = 9.2) -> list[Place]:
    return [(round(46.1 + north / 1000.0 + n / 1000.0, 6), east) for n in range(count)]


def square(north: float) -> list[Place]:
    low = 46.1 + north / 1000.0
    return [(low, 9.3), (low, 9.301), (low + 0.0005, 9.301), (low + 0.0005, 9.3), (low, 9.3)]


def said(drawing: Drawing) -> str:
    return " | ".join(sentences(drawing.left_out))


# Each kind of element as each format has it; an element has a name by which it is found again.


def kml_element(kind: str, number: int, name: str) -> str:
    if kind in ("line", "fourth"):
        shape = f"<LineString>{coordinates(line(10 * number, 3))}</LineString>"
    elif kind == "empty":
        shape = "<LineString><coordinates> </coordinates></LineString>"
    elif kind == "area":
        edge = f"<LinearRing>{coordinates(square(number))}</LinearRing>"
        shape = f"<Polygon><outerBoundaryIs>{edge}</outerBoundaryIs></Polygon>"
    elif kind == "point":
        shape = f"<Point>{coordinates(line(10 * number, 1, 9.4))}</Point>"
    elif kind == "pieces":
        apart = (line(10 * number), line(10 * number + 5))
        shape = "<MultiGeometry>" + "".join(f"<LineString>{coordinates(one)}</LineString>" for one in apart)
        shape += "</MultiGeometry>"
    elif kind == "nested":
        inner = f"<LineString>{coordinates(line(10 * number, 3))}</LineString>"
        return (
            f"<Folder><Folder><Placemark><name>{name}</name>{'<MultiGeometry>' * 3}{inner}{'</MultiGeometry>' * 3}"
            + ("</Placemark></Folder></Folder>")
        )
    elif kind == "hollow":
        shape = ("<MultiTrack/>", "<MultiGeometry/>", "<Polygon/>")[number % 3]
    elif kind == "meaning":
        data = '<ExtendedData><Data name="Speed"><value>7</value></Data></ExtendedData>'
        shape = f"{data}<LineString>{coordinates(line(10 * number, 3))}</LineString>"
    else:
        shape = f"<MultiPolygon><x>{coordinates(square(number))}</x></MultiPolygon>"
    return f"<Placemark><name>{name}</name>{shape}</Placemark>"


def json_element(kind: str, number: int, name: str) -> dict[str, Any]:
    def flipped(places: list[Place]) -> list[list[float]]:
        return [[lon, lat] for lat, lon in places]

    geometry: dict[str, Any] | None = {
        "line": {"type": "LineString", "coordinates": flipped(line(10 * number, 3))},
        "empty": {"type": "LineString", "coordinates": []},
        "area": {"type": "Polygon", "coordinates": [flipped(square(number))]},
        "point": {"type": "Point", "coordinates": flipped(line(10 * number, 1, 9.4))[0]},
        "pieces": {
            "type": "MultiLineString",
            "coordinates": [flipped(line(10 * number)), flipped(line(10 * number + 5))],
        },
        "nested": {"type": "GeometryCollection", "geometries": [collected({"type": "LineString"}, number)]},
        "hollow": [
            {"type": "GeometryCollection", "geometries": [{"type": "GeometryCollection", "geometries": []}]},
            {"type": "MultiPolygon", "coordinates": []},
            {"type": "MultiLineString", "coordinates": []},
        ][number % 3],
        "meaning": {"type": "LineString", "coordinates": flipped(line(10 * number, 3))},
        "fourth": {"type": "LineString", "coordinates": [[*p, 400, 17] for p in flipped(line(10 * number, 3))]},
    }.get(kind)
    properties = {"name": name} | ({"Speed": 7} if kind == "meaning" else {})
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    return {"type": "FeatureCollection", "features": [feature]} if kind == "nested" else feature


def collected(geometry: dict[str, Any], number: int) -> dict[str, Any]:
    drawn = geometry | {"coordinates": [[lon, lat] for lat, lon in line(10 * number, 3)]}
    return {"type": "GeometryCollection", "geometries": [drawn]}


def gpx_element(kind: str, number: int, name: str) -> str:
    def points(tag: str, places: list[Place]) -> str:
        return "".join(f'<{tag} lat="{lat}" lon="{lon}"/>' for lat, lon in places)

    if kind in ("line", "fourth", "nested"):
        return f"<rte><name>{name}</name>{points('rtept', line(10 * number, 3))}</rte>"
    if kind == "empty":
        return f"<rte><name>{name}</name></rte>"
    if kind == "point":
        lat, lon = line(10 * number, 1, 9.4)[0]
        return f'<wpt lat="{lat}" lon="{lon}"><name>{name}</name></wpt>'
    if kind == "pieces":
        segments = (f"<trkseg>{points('trkpt', line(10 * number + n))}</trkseg>" for n in (0, 5))
        return f"<trk><name>{name}</name>{''.join(segments)}</trk>"
    if kind == "meaning":
        extra = "<extensions><speed>7</speed></extensions>"
        return f"<rte><name>{name}</name>{points('rtept', line(10 * number, 3))}{extra}</rte>"
    if kind == "hollow":
        return f"<trk><name>{name}</name>{'<trkseg/>' * (number % 3)}</trk>"
    return f"<extensions><{name}>{points(name, line(number))}</{name}></extensions>"


def gpx(elements: list[tuple[str, str]]) -> bytes:
    written = [(kind, gpx_element(kind, n, name)) for n, (kind, name) in enumerate(elements, start=1)]
    order = ("point", "line", "fourth", "nested", "empty", "meaning", "pieces", "hollow", "area", "unknown")
    rows = (one for kind in order for own, one in written if own == kind)
    return "\n".join(["<gpx>", *rows, "</gpx>"]).encode()


WRITERS: dict[str, Callable[[list[tuple[str, str]]], bytes]] = {
    "kml": lambda elements: "\n".join(
        ["<kml>", *(kml_element(kind, n, name) for n, (kind, name) in enumerate(elements, start=1)), "</kml>"]
    ).encode(),
    "geojson": lambda elements: (
        '{"type": "FeatureCollection", "features": [\n'
        + ",\n".join(json.dumps(json_element(kind, n, name)) for n, (kind, name) in enumerate(elements, start=1))
        + "\n]}"
    ).encode(),
    "gpx": gpx,
}
KINDS = st.sampled_from(
    ["line", "empty", "area", "point", "pieces", "unknown", "nested", "hollow", "meaning", "fourth"]
)
NAME, LINE = re.compile(r"e[0-9]+x"), re.compile(r", lines? ([0-9]+)")


@pytest.mark.parametrize("suffix", WRITERS)
@settings(max_examples=60, deadline=None)
@given(kinds=st.lists(KINDS, min_size=1, max_size=8))
def test_every_element_of_a_map_is_found_again(suffix: str, kinds: list[str]) -> None:
    elements = [(kind, f"e{number}x") for number, kind in enumerate(kinds, start=1)]
    data = WRITERS[suffix](elements)
    drawing = drawing_in(data, f"x.{suffix}")
    kept = [str(drawing.line), *(str(area.label) for area in drawing.areas), *(point.name for point in drawing.points)]
    kept += [str(point.label) for point in drawing.points]
    found = " | ".join([*kept, said(drawing)])
    assert all(name in found for _, name in elements)
    pieces = [name for kind, name in elements if kind == "pieces"]
    word = "segment" if suffix == "gpx" else "line"
    assert all(
        f"{word} 2 of " in one
        for one in said(drawing).split(" | ")
        if any(p in one for p in pieces) and "begins" in one
    )
    assert said(drawing).count(" m from the end of ") == len(pieces)  # of every line in pieces, one is left out
    meaning = re.search(r"peed' of ([0-9]+) [a-zA-Z]+: not carried over: a speed", said(drawing))
    assert (int(meaning[1]) if meaning else 0) == kinds.count("meaning")
    if suffix == "geojson":
        assert said(drawing).count("the numbers after its heights") == kinds.count("fourth")
    rows = data.decode().split("\n")
    for sentence in sentences(drawing.left_out, drawing.unit):  # each speaks of the line of its element
        own, on = NAME.search(sentence.split(": ")[0]), LINE.search(sentence.split(": ")[0])
        if own and not sentence.startswith(("data", "property", "element", "<")):
            assert on and own[0] in rows[int(on[1]) - 1]
    for label in [
        *([drawing.line] if drawing.line else []),
        *(area.label for area in drawing.areas),
        *(point.label for point in drawing.points),
    ]:
        if own := NAME.search(str(label)):
            assert own[0] in rows[int(drawing.where(label).rpartition(" ")[2]) - 1]


COMMANDS = st.sampled_from(
    [16, 16, 16, 17, 18, 19, 20, 22, 82, 92, 93, 112, 115, 177, 178, 183, 189, 201, 206, 2000, 9999]
)


@settings(max_examples=80, deadline=None)
@given(st.lists(COMMANDS, min_size=1, max_size=12), st.lists(st.booleans(), max_size=3), st.integers(0, 2))
def test_every_item_fence_and_rally_point_of_a_plan_is_found_again(
    commands: list[int], inclusions: list[bool], rally: int
) -> None:
    items: list[dict[str, Any]] = [
        {
            "type": "SimpleItem",
            "command": command,
            "doJumpId": n,
            "frame": 3,
            "params": [0, 3.0 * (command == 178), 0, 0, 46.1 + n / 1000.0, 9.2, 20.0],
        }
        for n, command in enumerate(commands, start=1)
    ]
    pattern = {"type": "ComplexItem", "complexItemType": "StructureScan", "polygon": square(3)[:-1]}
    polygons = [{"polygon": square(n)[:-1], "inclusion": one} for n, one in enumerate(inclusions)]
    plan = {
        "fileType": "Plan",
        "version": 1,
        "mission": {
            "version": 2,
            "firmwareType": 3,
            "plannedHomePosition": [46.1, 9.2, 500],
            "items": [*items, pattern],
        },
        "geoFence": {"version": 2, "polygons": polygons, "circles": [{"circle": {"center": [46.2, 9.2], "radius": 5}}]},
        "rallyPoints": {"version": 2, "points": [[46.1, 9.2, 20]] * rally},
    }
    drawing = drawing_in(json.dumps(plan).encode(), "x.plan")
    labels = {str(point.label) for point in drawing.points} | {str(one.label) for one in drawing.left_out}
    labels |= {str(area.label) for area in (*drawing.areas, *drawing.surveys)}
    changed = {f"item {n} " for n, command in enumerate(commands, start=1) if command == 178}  # speeds of later points
    for n in range(1, len(commands) + 2):
        assert f"item {n} " in changed or any(label.startswith(f"item {n} ") for label in labels)
    assert {f"fence polygon {n}" for n in range(1, len(inclusions) + 1)} | {"fence circle 1"} <= labels
    assert {f"rally point {n}" for n in range(1, rally + 1)} <= labels


@settings(max_examples=60, deadline=None)
@given(st.lists(COMMANDS, min_size=1, max_size=12))
def test_every_row_of_a_table_is_found_again(commands: list[int]) -> None:
    rows = ["QGC WPL 110", "0\t1\t0\t16\t0\t0\t0\t0\t46.1\t9.2\t500\t1"]
    for n, command in enumerate(commands, start=1):
        cells = (n, 0, 3, command, 0, 3 * (command == 178), 0, 0, round(46.1 + n / 1000, 6), 9.2, 20, n % 2)
        rows.append("\t".join(map(str, cells)))
    drawing = drawing_in("\n".join(rows).encode(), "x.waypoints")
    labels = [str(point.label) for point in drawing.points] + [str(one.label) for one in drawing.left_out]
    for n, command in enumerate(commands, start=1):
        assert command == 178 or any(label.startswith(f"item {n} ") for label in labels)


# One line of a file in pieces


def test_pieces_that_touch_are_one_line_also_in_another_direction_and_order() -> None:
    a, b, c, d = line(0, 4)
    stored = {
        "type": "MultiLineString",
        "coordinates": [[p[::-1] for p in piece] for piece in ([a, b], [d, c], [c, b])],
    }
    drawing = drawing_in(json.dumps(stored).encode(), "x.geojson")
    assert [point.place for point in drawing.points] == [a, b, c, d]
    assert [str(point.label) for point in drawing.points][:2] == [
        "point 1 of line 1 of feature 1",
        "point 2 of line 1 of feature 1",
    ]
    assert "line 3 of feature 1: flown backwards, flown after line 1 of feature 1" in said(drawing)


def test_a_pause_of_a_receiver_is_bridged_with_its_length() -> None:
    points = "".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lat, lon in line(0))
    later = "".join(f'<trkpt lat="{lat + 0.0004:.6f}" lon="{lon}"/>' for lat, lon in line(1))
    drawing = drawing_in(f"<gpx><trk><trkseg>{points}</trkseg><trkseg>{later}</trkseg></trk></gpx>".encode(), "x")
    assert len(drawing.points) == 4
    assert "segment 2 of track 1: joined to segment 1 of track 1 over a gap of 44." in said(drawing)


def test_what_is_no_geometry_is_said_and_hides_nothing() -> None:
    shapes = [
        {"type": "Circle", "coordinates": [9.2, 46.1]},
        {"type": "LineString", "coordinates": [[9.2, 46.1], [9.2, 46.2]]},
    ]
    drawing = drawing_in(json.dumps({"type": "GeometryCollection", "geometries": shapes}).encode(), "x")
    assert len(drawing.points) == 2 and said(drawing) == "feature 1: of the unknown type 'Circle'; not carried over"
    bare = kml(f"<Placemark><name>e</name></Placemark><Folder><LineString>{coordinates(line(0))}</LineString></Folder>")
    assert said(bare).split(" | ") == [
        'Placemark 1 ("e"): has no geometry; not carried over',
        "<coordinates> on line 1: not carried over: in no known geometry",
    ]


def test_a_line_without_points_does_not_hide_the_route() -> None:
    empty = "<Placemark><name>empty</name><LineString><coordinates>\n</coordinates></LineString></Placemark>"
    drawing = kml(f"{empty}<Placemark><LineString>{coordinates(line(0, 3))}</LineString></Placemark>")
    assert len(drawing.points) == 3
    assert said(drawing) == 'Placemark 1 ("empty"): has no point; not carried over'


# What KML has in several places


def test_every_track_of_a_multitrack_has_its_own_altitude_mode() -> None:
    def track(mode: str, north: float, height_m: float) -> str:
        places = "".join(f"<gx:coord>{lon} {lat} {height_m}</gx:coord>" for lat, lon in line(north))
        return f"<gx:Track>{f'<altitudeMode>{mode}</altitudeMode>' * bool(mode)}{places}</gx:Track>"

    tracks = track("absolute", 0, 520), track("relativeToGround", 1, 20), track("", 2, 20)
    drawing = kml(f"<Placemark><gx:MultiTrack>{''.join(tracks)}</gx:MultiTrack></Placemark>")
    assert [point.datum for point in drawing.points] == [Datum.SEA] * 2 + [Datum.GROUND] * 2 + [Datum.NONE] * 2


def test_an_offset_counts_and_an_unknown_mode_is_said() -> None:
    def mode(name: str, offset: str = "") -> str:
        shape = f"<altitudeMode>{name}</altitudeMode>{offset}{coordinates(line(0), ',430')}"
        return f"<Placemark><LineString>{shape}</LineString></Placemark>"

    raised = kml(mode("absolute", "<gx:altitudeOffset>50</gx:altitudeOffset>"))
    assert [point.height_m for point in raised.points] == [480.0, 480.0]
    flat = kml(mode("relativeToSeaFloor", "<gx:altitudeOffset>50</gx:altitudeOffset>"))
    assert {point.datum for point in flat.points} == {Datum.NONE}
    assert "altitude mode 'relativeToSeaFloor' is none that can be flown" in said(flat)
    assert "its altitudeOffset of 50 m is not carried over" in said(flat)


def test_every_ring_of_a_boundary_counts() -> None:
    def ring(north: float) -> str:
        return f"<LinearRing>{coordinates(square(north))}</LinearRing>"

    polygon = "<Placemark><Polygon><outerBoundaryIs>{}</outerBoundaryIs><innerBoundaryIs>{}</innerBoundaryIs>"
    polygon += "</Polygon></Placemark>"
    (area,) = kml(polygon.format(ring(0), ring(1) + ring(2))).areas
    assert len(area.holes) == 2
    with pytest.raises(FileFormatError, match="Placemark 1 has 2 outer edges, the second on line 1; draw a polygon"):
        kml(polygon.format(ring(0) + ring(5), ring(1)))
    with pytest.raises(FileFormatError, match="has 2 <coordinates>"):
        kml(f"<Placemark><LineString>{coordinates(line(0)) * 2}</LineString></Placemark>")


# Formats and encodings


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize(
    "text",
    [
        "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t46.1\t9.2\t500\t1\n1\t0\t3\t16\t0\t0\t0\t0\t46.1\t9.2\t20\t1\n",
        '{"type":"Point","coordinates":[9.2,46.1]}',
        '<?xml version="1.0" encoding="{}"?><g:gpx xmlns:g="x"><g:wpt lat="46.1" lon="9.2"/></g:gpx>',
        "<kml><Placemark><Point><coordinates>9.2,46.1</coordinates></Point></Placemark></kml>",
    ],
)
def test_a_drawing_may_be_in_any_encoding_of_unicode(text: str, encoding: str) -> None:
    declared = text.replace("{}", "UTF-16" if "16" in encoding else "UTF-8") if "xml " in text else text
    (point,) = drawing_in(declared.encode(encoding), "x").points
    assert point.place == (46.1, 9.2)


def test_heights_that_are_all_0_are_none() -> None:
    shape = f"<altitudeMode>absolute</altitudeMode>{coordinates(line(0), ',0')}"
    drawing = kml(f"<Placemark><LineString>{shape}</LineString></Placemark>")
    assert {point.datum for point in drawing.points} == {Datum.NONE}
    assert "heights: all are 0 m above the sea" in said(drawing)


# Speeds


@pytest.mark.parametrize(
    ("kind", "speed", "text"),
    [
        (10.000001, 10.0, "unknown speed type 10"),
        (2.5, 3.0, "unknown speed type 2.5"),
        (float("nan"), 3.0, "unknown speed type nan"),
        (1, 0.0, "ArduCopter ignores 0 m/s; its minimum is 0.2 m/s"),
        (1, -1.0, "changes no speed"),
        (2, 3.0, "the speed of climbs and descents is not carried over"),
        (1, 40.0, "40 m/s; ArduCopter allows at most"),
    ],
)
def test_speeds_are_judged_by_the_rules_of_check(kind: float, speed: float, text: str) -> None:
    rows = [
        "QGC WPL 110",
        "0\t1\t0\t16\t0\t0\t0\t0\t46.1\t9.2\t500\t1",
        f"1\t0\t3\t178\t{kind}\t{speed}\t0\t0\t0\t0\t0\t1",
    ]
    rows.append("2\t0\t3\t16\t0\t0\t0\t0\t46.1\t9.2\t20\t1")
    drawing = drawing_in("\n".join(rows).encode(), "x.waypoints")
    assert f"item 1 (DO_CHANGE_SPEED): {text}" in said(drawing)
    assert [point.speed_mps for point in drawing.points] == [40.0 if speed == 40.0 else None]


def test_a_climb_between_pieces_is_said() -> None:
    a, b, c = line(0, 3)
    pieces = [[[*a[::-1], 520.0], [*b[::-1], 520.0]], [[*b[::-1], 580.0], [*c[::-1], 580.0]]]
    drawing = drawing_in(json.dumps({"type": "MultiLineString", "coordinates": pieces}).encode(), "x.geojson")
    assert len(drawing.points) == 4
    assert "joined to line 1 of feature 1 over 60.0 m of height that nobody drew" in said(drawing)


@pytest.mark.parametrize("suffix", ["geojson", "kml"])
def test_an_inclusion_that_says_neither_is_said(suffix: str) -> None:
    if suffix == "kml":
        data = '<ExtendedData><Data name="inclusion"><value>yes</value></Data></ExtendedData>'
        drawing = kml(f"<Placemark>{data}{kml_element('area', 1, '').split('</name>')[1]}")
    else:
        edge = [place[::-1] for place in square(1)]
        feature = {"type": "Feature", "properties": {"inclusion": "yes"}}
        feature["geometry"] = {"type": "Polygon", "coordinates": [edge]}
        drawing = drawing_in(json.dumps(feature).encode(), "x.geojson")
    assert [area.inside for area in drawing.areas] == [None]
    assert "its inclusion 'yes' is neither true nor false" in said(drawing)


def test_the_place_in_a_file_of_one_line_is_its_column() -> None:
    texts = [
        '{"type":"Feature","geometry":{"type":"LineString","coordinates":[[9.2,46.1],[9.2,46.101]]}}',
        '{"type":"Feature","geometry":null}',
        '{"type":"Feature","geometry":{"type":"Point","coordinates":[9.2,"x"]}}',
    ]
    before = '{"type":"FeatureCollection","features":['
    text = f"{before}{','.join(texts[:2])}]}}"
    drawing = drawing_in(text.encode(), "x.geojson")
    column = text.index(texts[1]) + 1
    assert sentences(drawing.left_out, drawing.unit)[0].startswith(f"feature 2, column {column}: has no place")
    assert drawing.where(drawing.points[1].label) == f"x.geojson, column {len(before) + 1}"
    with pytest.raises(FileFormatError, match=rf"^x\.geojson, column {len(before) + 1}: feature 1 is not longitude"):
        drawing_in(f"{before}{texts[2]}]}}".encode(), "x.geojson")


def test_a_building_is_no_area_to_survey() -> None:
    item = {"type": "ComplexItem", "complexItemType": "StructureScan", "version": 3}
    item["polygon"] = [[46.1, 9.2], [46.1003, 9.2], [46.1003, 9.2004]]
    mission = {"version": 2, "firmwareType": 3, "plannedHomePosition": [46.1, 9.2, 500], "items": [item]}
    drawing = drawing_in(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}).encode(), "x.plan")
    assert drawing.surveys == ()
    assert "item 1 (structure): its outline is that of a building" in said(drawing)


@pytest.mark.parametrize(
    ("cell", "text"), [("99\t16", "has frame 99, which is no place"), ("3\t16", "expected|must be a number")]
)
def test_a_refused_item_has_its_line_and_what_to_do(cell: str, text: str) -> None:
    height = "20" if "99" in cell else "20m"
    row = f"1\t0\t{cell}\t0\t0\t0\t0\t46.1\t9.2\t{height}\t1"
    with pytest.raises(FileFormatError, match=rf"^x\.waypoints, line 3: .*({text})") as refused:
        drawing_in(f"QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t46.1\t9.2\t500\t1\n{row}\n".encode(), "x.waypoints")
    assert refused.value.hint


def test_a_fence_in_a_list_is_read_by_the_rules_of_check() -> None:
    """Without its first vertex at its end, its return point would be a corner."""
    rows = "46.1005 9.2006\n46.1 9.2\n46.101 9.2\n46.101 9.2012\n46.1 9.2012\n"
    with pytest.raises(FileFormatError, match="line 5: the last point does not repeat the first vertex, line 2"):
        drawing_in(rows.encode(), "x.fen")
    assert len(drawing_in(f"{rows}46.1 9.2\n".encode(), "x.fen").areas[0].corners) == 4
    assert len(drawing_in(rows.encode(), "x.poly").areas[0].corners) == 5


def test_holes_of_a_no_fly_zone_are_said() -> None:
    edge, hole = (
        [[9.3, 46.1], [9.302, 46.1], [9.302, 46.102]],
        [[9.3015, 46.1005], [9.3018, 46.1005], [9.3018, 46.101]],
    )
    zone = {"type": "Feature", "properties": {"inclusion": False, "name": "wood"}}
    zone["geometry"] = {"type": "Polygon", "coordinates": [[*ring, ring[0]] for ring in (edge, hole)]}
    route = {"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[9.2, 46.1], [9.2, 46.101]]}}
    drawing = drawing_in(json.dumps({"type": "FeatureCollection", "features": [route, zone]}).encode(), "x.geojson")
    flight = route_flight(drawing)
    assert len(flight.areas.no_fly) == 1
    assert 'feature 2 ("wood"): its holes are no-fly zone too' in " | ".join(map(str, flight.left_out))


def test_a_fence_polygon_without_corners_is_left_out_with_its_line() -> None:
    items = [
        {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, 0, 46.1 + n / 1000.0, 9.2, 20]}
        for n in range(2)
    ]
    mission = {"version": 2, "firmwareType": 3, "plannedHomePosition": [46.1, 9.2, 500], "items": items}
    drawn = [[46.09, 9.19], [46.12, 9.19], [46.12, 9.21], [46.09, 9.21]]
    polygons = [{"version": 1, "inclusion": True, "polygon": polygon} for polygon in ([], drawn)]
    plan = {"fileType": "Plan", "version": 1, "mission": mission, "geoFence": {"version": 2, "polygons": polygons}}
    text = json.dumps(plan, indent=1)
    drawing = drawing_in(text.encode(), "x.plan")
    assert [str(area.label) for area in drawing.areas] == ["fence polygon 2"]
    line_number = next(n for n, row in enumerate(text.split("\n"), start=1) if '"polygons"' in row) + 1
    assert f"line {line_number}: geoFence.polygons.0: has no corner; skipped" in said(drawing)
    polygons[0]["polygon"] = drawn[:2]
    with pytest.raises(FileFormatError, match="3 corners or more, got 2"):
        drawing_in(json.dumps(plan).encode(), "x.plan")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "a.gpx",
            '<gpx version="1.1"><trk><trkseg>\n<trkpt lat="46.1" lon="9.2"/>\n<trkpt lat="46.101" lon="9.2">\n'
            "<speed>4</speed></trkpt></trkseg></trk></gpx>",
            "element 'speed' of 1 point, line 4: not carried over",
        ),
        (
            "a.geojson",
            '{"type": "FeatureCollection", "features": [\n{"type": "Feature", "properties": {"speed": 3},\n"geometry": '
            '{"type": "LineString", "coordinates": [[9.2, 46.1], [9.2, 46.101]]}}]}',
            "property 'speed' of 1 feature, line 2: not carried over",
        ),
    ],
)
def test_data_that_is_left_out_is_named_with_its_first_line(name: str, text: str, words: str) -> None:
    drawing = drawing_in(text.encode(), name)
    assert any(words in sentence for sentence in sentences(drawing.left_out, drawing.unit))
