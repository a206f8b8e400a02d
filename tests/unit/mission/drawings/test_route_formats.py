"""Drawn files of other programs: what is read of them, what is said about them, and what is refused."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Datum, Drawing
from gcs.mission.drawings.labels import Label, LeftOut, sentences
from gcs.mission.drawings.route_formats import ROUTE_FORMATS, RouteFormat, drawing_in, read_drawing
from gcs.mission.drawings.to_scenario.route_flight import route_flight

FILES = Path(__file__).parent / "files"


def drawn(name: str) -> Drawing:
    return read_drawing(FILES / name)


def kml(placemarks: str) -> Drawing:
    return drawing_in(f"<kml><Document>{placemarks}</Document></kml>".encode(), "x.kml")


def test_a_plan_has_points_with_heights_holds_speeds_and_its_survey_as_stored() -> None:
    drawing = drawn("valley.plan")
    assert [point.label.number for point in drawing.points] == [2, 4, 6, 7, 7, 10]
    assert [point.height_m for point in drawing.points] == [20.0, 25.0, 520.0, 30.0, 30.0, 30.0]
    assert [point.datum for point in drawing.points] == [Datum.HOME] * 2 + [Datum.SEA] + [Datum.HOME] * 2 + [
        Datum.GROUND
    ]
    assert [point.speed_mps for point in drawing.points] == [None] + [3.0] * 5
    assert [point.hold_s for point in drawing.points] == [0.0, 5.0, 0.0, 0.0, 0.0, 0.0]
    assert [point.radius_m for point in drawing.points] == [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]
    assert [point.name for point in drawing.points] == ["", "", "", "survey", "survey", ""]
    assert drawing.points[3].place == (47.3985, 8.5485)
    assert drawing.returns
    assert drawing.speed_mps == 5.0
    assert drawing.home is not None and drawing.home.alt_amsl_m == 488.0
    fence, disk = drawing.areas
    assert fence.inside and len(fence.corners) == 4
    assert not disk.inside and (disk.corners, disk.radius_m) == (((47.399, 8.547),), 20.0)


def test_what_a_plan_loses_is_said_with_number_and_name() -> None:
    labels = [str(one.label) for one in drawn("valley.plan").left_out]
    assert labels == [
        "item 1 (NAV_TAKEOFF)",
        "item 5 (DO_SET_ROI)",
        "item 7 (survey)",
        "item 11 (NAV_RETURN_TO_LAUNCH)",
        "rally point 1",
    ]


def test_a_table_of_items_stays_at_heights_of_0_holds_and_ends_at_its_landing() -> None:
    drawing = drawn("mission_planner.waypoints")
    assert [point.height_m for point in drawing.points] == [20.0, 25.0, 25.0, 25.0, 25.0]
    assert [point.hold_s for point in drawing.points] == [0.0, 16.0, 0.0, 0.0, 0.0]
    assert [point.speed_mps for point in drawing.points] == [None, None, 9.0, 9.0, 9.0]
    assert not drawing.returns
    said = sentences(drawing.left_out)
    assert "item 7 (DO_JUMP): the jump is not carried over; for several rounds write loops" in said
    assert "item 10 (NAV_WAYPOINT): after item 9 (NAV_LAND), where the route ends; not carried over" in said


def test_a_map_has_a_line_areas_with_holes_and_names_of_the_points_on_it() -> None:
    drawing = drawn("pond.kml")
    assert len(drawing.points) == 5
    assert {point.datum for point in drawing.points} == {Datum.SEA}
    assert [point.name for point in drawing.points] == ["", "", "Boathouse", "", ""]
    assert [(len(area.corners), len(area.holes), area.inside) for area in drawing.areas] == [(4, 1, None), (3, 0, None)]
    assert [str(one.label) for one in drawing.left_out] == ['Placemark 3 ("Far away")']


def test_a_kmz_is_the_kml_in_it() -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("images/icon.png", b"")
        archive.writestr("files/map.kml", (FILES / "pond.kml").read_bytes())
    assert drawing_in(buffer.getvalue(), "x").points == drawn("pond.kml").points


def test_a_route_comes_before_tracks_and_waypoints_name_its_points() -> None:
    drawing = drawn("walk.gpx")
    assert [point.name for point in drawing.points] == ["Gate", "Bench", "Tree"]
    assert [point.datum for point in drawing.points] == [Datum.SEA, Datum.SEA, Datum.NONE]
    assert not drawing.recorded
    assert [str(one.label) for one in drawing.left_out] == ['track 1 ("Morning")']


def test_waypoints_alone_are_a_route_in_their_order() -> None:
    points = "".join(f'<wpt lat="{47 + n / 1000}" lon="8"><name>P{n}</name></wpt>' for n in range(3))
    assert [point.name for point in drawing_in(f"<gpx>{points}</gpx>".encode(), "x").points] == ["P0", "P1", "P2"]


def test_a_geojson_has_lines_areas_and_features_without_a_place() -> None:
    drawing = drawn("fields.geojson")
    assert [point.height_m for point in drawing.points] == [520.0, 520.0, 525.0]
    assert [len(area.holes) for area in drawing.areas] == [1]
    assert [str(one.label) for one in drawing.left_out] == ["feature 3", "heights"]


def test_a_sequence_of_points_is_a_route() -> None:
    spots = ",".join(f'{{"type":"Point","coordinates":[8,{47 + n / 1000}]}}' for n in range(4))
    text = f'{{"type":"GeometryCollection","geometries":[{spots}]}}'
    assert [point.place[0] for point in drawing_in(text.encode(), "x").points] == [47.0, 47.001, 47.002, 47.003]


@pytest.mark.parametrize(
    ("mode", "datum"),
    [("absolute", Datum.SEA), ("relativeToGround", Datum.GROUND), ("clampToGround", Datum.NONE), ("", Datum.NONE)],
)
def test_heights_of_a_map_count_as_its_mode_says(mode: str, datum: Datum) -> None:
    coordinates = "<coordinates>8.5, 47.1 ,30  8.6,47.1,30</coordinates>"
    drawing = kml(f"<Placemark><LineString><altitudeMode>{mode}</altitudeMode>{coordinates}</LineString></Placemark>")
    assert {point.datum for point in drawing.points} == {datum}
    assert [point.place for point in drawing.points] == [(47.1, 8.5), (47.1, 8.6)]


def test_a_track_of_a_receiver_is_a_recorded_line() -> None:
    track = "<altitudeMode>absolute</altitudeMode><when>x</when>"
    track += "<gx:coord>8.5 47.1 500</gx:coord><gx:coord>8.6 47.1 501</gx:coord>"
    drawing = kml(f"<Folder><Placemark><gx:Track>{track}</gx:Track></Placemark></Folder>")
    assert drawing.recorded
    assert [point.height_m for point in drawing.points] == [500.0, 501.0]


def test_equal_sentences_are_one_with_all_numbers() -> None:
    said = [LeftOut(Label("item", n, "(DO_SET_ROI)"), "lost") for n in (2, 4, 5, 6, 6, 9)] + [
        LeftOut(Label("the origin"), "is new")
    ]
    assert sentences(said) == ["items 2, 4 to 6 and 9 (DO_SET_ROI): lost", "the origin: is new"]


LINE = "<Placemark><LineString><coordinates>{}</coordinates></LineString></Placemark>"
ITEM = '{"type":"SimpleItem","command":16,"frame":%s,"params":[0,0,0,null,%s]}'
PLAN = (
    '{"fileType":"Plan","version":1,'
    '"mission":{"version":2,"firmwareType":12,"plannedHomePosition":[47,8,0],"items":[%s]}}'
)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        ("", "is empty"),
        ("a letter", "is no drawing"),
        ("{", "line 1: not JSON"),
        ("{}", "is neither a .plan nor GeoJSON"),
        ("<kml", ", line 1: not XML"),
        ("<svg/>", "its root is <svg>"),
        ('<!DOCTYPE k [<!ENTITY a "ha">]><kml>&a;</kml>', "document type or entities"),
        ("<kml>" + "<a>" * 100 + "</a>" * 100 + "</kml>", "nested too deeply"),
        (f"<kml>{LINE.format('8.5,x,0')}</kml>", "'8.5,x,0' is not longitude, latitude and height"),
        (f"<kml>{LINE.format('8.5,147,0 8.5,147,1')}</kml>", "latitude 147, longitude 8.5 is not on Earth"),
        ('<gpx><wpt lat="47" lon="east"/></gpx>', "waypoint 1: lon is not a number: 'east'"),
        ('{"type":"Point","coordinates":[630000,5200000]}', "save the drawing in degrees"),
        ('{"type":"Point","coordinates":[8,null]}', "is not longitude, latitude and height"),
        ('{"type":"Feature","crs":"EPSG:2056","geometry":null}', "another reference system"),
        ("47.1 8.1\n47.2 8.1\n47.1 8.1\n", "the polygon has 2 corners"),
        ("47.1 8.1\n47.2 8.1 3\n47.1 8.1\n", "file, line 2: 3 columns instead of 2"),
        ("RALLY 47.1 8.1 30 0 0 0\n", "holds rally points, and no route"),
        (PLAN % (ITEM % (1, "47,8,20")), "item 1 (NAV_WAYPOINT) has frame 1, which is no place on Earth"),
        (PLAN % (ITEM % (3, "null,8,20")), "mission.items.0: the position is missing or not a number"),
        (
            PLAN
            % '{"type":"ComplexItem","complexItemType":"survey","TransectStyleComplexItem":{"Items":[{"type":"x"}]}}',
            "mission.items.0.TransectStyleComplexItem.Items.0",
        ),
        ("PK\x03\x04", "is no KMZ"),
    ],
)
def test_what_is_no_drawing_is_refused_with_the_reason(data: str, reason: str) -> None:
    with pytest.raises(FileFormatError) as refused:
        drawing_in(data.encode(), "file")
    assert reason in refused.value.message


def test_patterns_that_a_plan_does_not_store_are_said() -> None:
    pattern = '{"type":"ComplexItem","complexItemType":"%s","version":3}'
    points = f"{ITEM % (3, '47,8,20')},{ITEM % (3, '47.001,8,20')}"
    drawing = drawing_in((PLAN % f"{points},{pattern % 'StructureScan'},{pattern % 'fwLandingPattern'}").encode(), "x")
    assert [str(point.label) for point in drawing.points] == ["item 1 (NAV_WAYPOINT)", "item 2 (NAV_WAYPOINT)"]
    assert [str(one) for one in drawing.left_out] == [
        "item 3 (structure): the file does not store its points; replace it by waypoints",
        "item 4 (fwLandingPattern): landing patterns are not carried over; the formation lands below its last point",
    ]


def test_a_map_with_a_member_of_its_own_is_no_mission() -> None:
    """An older mission file has a version and no type."""
    text = '{"version":2,"type":"LineString","coordinates":[[8,47,500],[8,47.001,500]]}'
    assert [point.height_m for point in drawing_in(text.encode(), "x").points] == [500.0, 500.0]


def test_a_row_of_a_program_comes_before_those_of_the_table() -> None:
    own = RouteFormat((".own",), "Nothing", lambda file: file.is_xml, lambda data, source: Drawing(source, ()))
    assert drawing_in((FILES / "pond.kml").read_bytes(), "x", (own, *ROUTE_FORMATS)).points == ()
    with pytest.raises(FileFormatError) as refused:
        drawing_in(b"a letter", "x", (own,))
    assert refused.value.hint == "give a drawing: .own"


@pytest.mark.parametrize("is_fence", [False, True])
def test_a_list_of_points_is_an_area_and_no_route(is_fence: bool) -> None:
    back = "47.15 8.15\n" * is_fence
    text = f"#saved by Mission Planner\n{back}47.1 8.1\n47.2 8.1\n47.2 8.2\n47.1 8.1\n"
    drawing = drawing_in(text.encode(), "field.poly")
    (area,) = drawing.areas
    assert area.corners == ((47.1, 8.1), (47.2, 8.1), (47.2, 8.2))
    assert drawing.where(area.label) == f"field.poly, line {2 + is_fence}"
    said = sentences(drawing.left_out)
    assert said == ["line 2: the return point of a fence; not carried over"] * is_fence
    with pytest.raises(FileFormatError, match="is no route: it has no point to fly to"):
        route_flight(drawing)
