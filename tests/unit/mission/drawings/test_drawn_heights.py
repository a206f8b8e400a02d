"""A drawn height is flown, or a sentence says that it is not; a receiver's points without a fix are no places."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.frames import Origin, ned_to_geodetic
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnPoint
from gcs.mission.drawings.labels import Label, sentences
from gcs.mission.drawings.route_formats import drawing_in
from gcs.mission.drawings.to_scenario.placed_route import placed_route
from gcs.mission.drawings.to_scenario.route_flight import route_flight
from gcs.mission.drawings.to_scenario.survey_area import survey_area

PLACES = [(46.1, 9.2), (46.101, 9.2), (46.101, 9.202)]
HEIGHTS_M = st.floats(0.1, 3000.0).map(lambda value: round(value, 2))


def kml(shape: str) -> Drawing:
    return drawing_in(f"<kml><Placemark><name>n</name>{shape}</Placemark></kml>".encode(), "x.kml")


def geojson(kind: str, coordinates: Any, properties: dict[str, Any] | None = None) -> Drawing:
    feature = {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}
    return drawing_in(json.dumps(feature).encode(), "x.geojson")


def gpx_track(points: list[tuple[float, float, float | None]], *, aside: bool = False) -> Drawing:
    rows = []
    for lat, lon, height_m in points:
        inner = "" if height_m is None or aside else f"<ele>{height_m}</ele>"
        rows.append(f'<trkpt lat="{lat}" lon="{lon}"{f" ele={chr(34)}{height_m}{chr(34)}" * aside}>{inner}</trkpt>')
    return drawing_in(f"<gpx><trk><trkseg>{''.join(rows)}</trkseg></trk></gpx>".encode(), "x.gpx")


def said(drawing: Drawing) -> str:
    return " | ".join(sentences(drawing.left_out))


SHAPES = {  # of KML, with heights at the places that the program keeps on the ground
    "line": "<LineString>{mode}<coordinates>{rows}</coordinates></LineString>",
    "point": "<Point>{mode}<coordinates>9.2,46.1,{height}</coordinates></Point>",
    "track": "<Track>{mode}<coord>9.2 46.1 {height}</coord><coord>9.2 46.101 {height}</coord></Track>",
    "area": "<Polygon>{mode}<outerBoundaryIs><LinearRing><coordinates>{rows}</coordinates></LinearRing>"
    "</outerBoundaryIs></Polygon>",
}


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([*SHAPES]), HEIGHTS_M, st.sampled_from(["", "clampToGround", "clampToSeaFloor", "clampedToGround"])
)
def test_heights_of_a_map_that_do_not_count_are_said(shape: str, height_m: float, mode: str) -> None:
    def drawn(height: float) -> str:
        rows = " ".join(f"{lon},{lat},{height}" for lat, lon in PLACES)
        tag = f"<altitudeMode>{mode}</altitudeMode>" if mode else ""
        return said(kml(SHAPES[shape].format(mode=tag, rows=rows, height=height)))

    assert 'Placemark 1 ("n"): its ' in drawn(height_m) and "not carried over" in drawn(height_m)
    assert mode == "clampedToGround" or drawn(0.0) == ""  # converters write 0 for none


@settings(max_examples=30, deadline=None)
@given(HEIGHTS_M, st.sampled_from(["ele", "Elevation", "altitude", "height_m"]))
def test_heights_that_a_geojson_has_in_another_place_are_said(height_m: float, key: str) -> None:
    ring = [[lon, lat, height_m] for lat, lon in (*PLACES, PLACES[0])]
    assert "feature 1: its heights are not carried over" in said(geojson("Polygon", [ring]))
    line = [[lon, lat] for lat, lon in PLACES]
    assert f"property '{key}' of 1 feature: not carried over" in said(geojson("LineString", line, {key: height_m}))
    assert said(geojson("LineString", line, {key: None, "width": 3.0})) == ""


@settings(max_examples=30, deadline=None)
@given(st.lists(HEIGHTS_M, min_size=3, max_size=3))
def test_a_gpx_with_heights_as_attributes_has_heights(heights_m: list[float]) -> None:
    points: list[tuple[float, float, float | None]] = [(*p, h) for p, h in zip(PLACES, heights_m, strict=True)]
    assert gpx_track(points, aside=True).points == gpx_track(points).points
    assert [point.height_m for point in gpx_track(points, aside=True).points] == heights_m


@settings(max_examples=40, deadline=None)
@given(st.lists(st.booleans(), min_size=3, max_size=12))
def test_points_of_a_receiver_without_a_fix_are_no_places(fixes: list[bool]) -> None:
    fixes = [*fixes, True, True]
    points = [(46.1 + n / 1000.0, 9.2, 500.0) if fix else (0.0, 0.0, 0.0) for n, fix in enumerate(fixes)]
    drawing = gpx_track([*points])
    assert [point.place for point in drawing.points] == [point[:2] for point in points if point[0]]
    lost = fixes.count(False)
    assert (f"track 1: {lost} of its {len(points)} points are at 0 N 0 E" in said(drawing)) == bool(lost)


def test_a_line_that_somebody_drew_at_0_n_0_e_is_flown() -> None:
    assert geojson("LineString", [[0.0, 0.0], [0.001, 0.0]]).points[0].place == (0.0, 0.0)


# Points without a height among points with one

AROUND = Origin(46.1, 9.2, 0.0)


def climbing(gaps: set[int], datum: Datum = Datum.SEA, count: int = 9) -> Drawing:
    """A straight route that climbs by a metre every 10 m, with some heights missing."""
    lat, lon, _ = ned_to_geodetic(np.array([[10.0 * n, 5.0 * n, 0.0] for n in range(count)]), AROUND)
    points = [
        DrawnPoint(place, *((0.0, Datum.NONE) if n in gaps else (400.0 + n, datum)), Label("point", n))
        for n, place in enumerate(zip(lat.tolist(), lon.tolist(), strict=True))
    ]
    return Drawing("x.gpx", tuple(points))


@settings(max_examples=60, deadline=None)
@given(st.sets(st.integers(0, 8), max_size=8), st.sampled_from([Datum.SEA, Datum.HOME]))
def test_a_point_without_a_height_is_flown_at_that_of_its_neighbours(gaps: set[int], datum: Datum) -> None:
    known = [n for n in range(9) if n not in gaps]
    whole, bare = climbing(set(), datum), climbing(gaps, datum)
    at = (46.1, 9.2, 300.0)
    route = placed_route(bare, at, None)
    heights_m = [point.height_m for point in placed_route(whole, at, None).points]
    wanted = [heights_m[min(max(n, known[0]), known[-1])] for n in range(9)]
    assert [point.height_m for point in route.points] == pytest.approx(wanted, abs=0.02)
    named = {str(one.label) for one in route.left_out if "has no height; flown at that of" in one.text}
    assert named == {f"point {n}" for n in gaps}
    asked = placed_route(bare, at, 30.0)  # who gives a height gets it
    assert all(asked.points[n].height_m == 30.0 for n in gaps)


def test_heights_that_count_from_different_things_are_not_mixed() -> None:
    points = [*climbing({1}).points[:2], climbing(set(), Datum.HOME).points[2]]
    route = placed_route(Drawing("x", tuple(points)), (46.1, 9.2, 300.0), None)
    assert [(point.key, point.height_m) for point in route.points[:2]] == [("alt_amsl_m", 400.0)] * 2


def test_zeros_and_no_heights_are_no_heights() -> None:
    rows = [(46.1, 9.2, 0.0), (46.101, 9.2, None), (46.102, 9.2, 0.0)]
    assert {point.datum for point in gpx_track([*rows]).points} == {Datum.NONE}


def test_a_speed_that_a_survey_does_not_take_over_is_said() -> None:
    drawing = geojson("Polygon", [[[lon, lat] for lat, lon in (*PLACES, PLACES[0])]])
    fast = Drawing("x.plan", (), drawing.areas, speed_mps=9.0)
    assert "the speed: 9 m/s is not carried over; give it as --speed" in sentences(survey_area(fast).left_out)


def test_a_speed_of_the_whole_file_that_is_too_fast_is_said() -> None:
    drawing = climbing(set(), Datum.HOME)
    fast = replace(drawing, speed_mps=30.0)
    told = "the speed: drawn at 30 m/s, too fast for this vehicle type"
    at = (46.1, 9.2, 300.0)
    assert told in " | ".join(sentences(route_flight(fast, at, count=1, shape="line").left_out))
    own = replace(fast, points=tuple(replace(point, speed_mps=3.0) for point in fast.points))
    assert told not in " | ".join(sentences(route_flight(own, at, count=1, shape="line").left_out))
