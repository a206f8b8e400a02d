"""KML, KMZ and GeoJSON as their standards want them."""

from __future__ import annotations

import io
import json
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from gcs.frames import wrapped_deg
from gcs.mission.formats.maps.geojson import write_geojson
from gcs.mission.formats.maps.kml import write_kml, write_kmz
from gcs.mission.formats.maps.tracks import MapFile, MapPoint, Track, build_map
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint
from gcs.plan.trajectory.plan import Plan
from tests.unit.mission.map_tracks import KML, geojson_tracks
from tests.unit.plan.routed import with_route

CLOCKWISE = (GeoPoint(473970000, 85450000), GeoPoint(473980000, 85450000), GeoPoint(473980000, 85460000))
FENCE = Geofence(
    (FencePolygon(CLOCKWISE, True), FencePolygon(CLOCKWISE[::-1], False)),
    (FenceCircle(CLOCKWISE[0], 100.0, False),),
)
TIMES_S = np.array([-3.25, 0.0, 60.5])


def track(lon_deg: list[float]) -> Track:
    return Track(7, TIMES_S, np.array([47.1, 47.2, 47.3]), np.array(lon_deg), np.array([488.5, 490.0, 491.25]))


MAP = MapFile("Six <quadrotors> & a hill", "abc", (track([8.1, 8.2, 8.3]),), FENCE)


def test_kml_places_vehicles_in_time_above_the_sea() -> None:
    document = ElementTree.fromstring(write_kml(MAP)).find("k:Document", KML)
    assert document is not None
    assert document.findtext("k:name", "", KML) == MAP.title
    lines = document.findall("k:Placemark/gx:Track", KML)
    assert [line.findtext("k:altitudeMode", "", KML) for line in lines] == ["absolute"]
    assert [e.text for e in lines[0].findall("k:when", KML)] == [
        "1999-12-31T23:59:56.750Z",
        "2000-01-01T00:00:00.000Z",
        "2000-01-01T00:01:00.500Z",
    ]
    assert [e.text for e in lines[0].findall("gx:coord", KML)] == [
        "8.1 47.1 488.5",
        "8.2 47.2 490.0",
        "8.3 47.3 491.25",
    ]
    rings = document.findall("k:Placemark/k:Polygon/k:outerBoundaryIs/k:LinearRing/k:coordinates", KML)
    assert len(rings) == 3
    for ring in rings:
        corners = (ring.text or "").split()
        assert corners[0] == corners[-1]
    drawn = np.array([[float(x) for x in corner.split(",")] for corner in (rings[2].text or "").split()])
    metres = (drawn[:, :2] - [8.545, 47.397]) * 111_320 * [np.cos(np.radians(47.397)), 1]
    assert np.hypot(*metres.T) == pytest.approx(np.full(len(drawn), 100.0), rel=1e-4)  # seven decimals: 8 mm


def test_kmz_is_kml_in_a_zip() -> None:
    with zipfile.ZipFile(io.BytesIO(write_kmz(MAP))) as archive:
        assert archive.namelist() == ["doc.kml"]
        assert archive.read("doc.kml") == write_kml(MAP)
    assert write_kmz(MAP) == write_kmz(MAP)


def test_geojson_says_longitude_first_and_no_height_above_the_ellipsoid() -> None:
    """RFC 7946, sections 3.1.1 and 4: a third coordinate would be the height above the ellipsoid."""
    feature = json.loads(write_geojson(MAP))["features"][0]
    assert feature["geometry"] == {"type": "LineString", "coordinates": [[8.1, 47.1], [8.2, 47.2], [8.3, 47.3]]}
    assert feature["properties"]["altitude_amsl_m"] == [488.5, 490.0, 491.25]
    assert feature["properties"]["t_s"] == TIMES_S.tolist()


def test_geojson_rings_close_and_run_counterclockwise() -> None:
    """RFC 7946, section 3.1.6."""
    areas = [f["geometry"] for f in json.loads(write_geojson(MAP))["features"] if f["geometry"]["type"] == "Polygon"]
    assert len(areas) == 2
    features = json.loads(write_geojson(MAP))["features"]
    said = [(f["properties"]["inclusion"], f["properties"].get("clockwise")) for f in features[1:]]
    assert said == [(True, True), (False, False), (False, None)]
    assert features[3]["properties"]["radius_m"] == 100.0
    for area in areas:
        shape = shapely.geometry.shape(area)
        assert shape.is_valid
        assert shape.exterior.is_ccw


def test_geojson_is_cut_at_the_antimeridian() -> None:
    """RFC 7946, section 3.1.9: no line runs round the world, and every line has two positions."""
    for lon_deg, pieces in (([179.9, 180.0, -179.9], 2), ([179.9, -179.9, 179.8], 3), ([-179.9, 179.9, 179.8], 2)):
        drawn = MapFile("x", "", (track(lon_deg),))
        geometry = json.loads(write_geojson(drawn))["features"][0]["geometry"]
        assert geometry["type"] == "MultiLineString"
        assert len(geometry["coordinates"]) == pieces
        assert min(map(len, geometry["coordinates"])) >= 2
        assert geojson_tracks(write_geojson(drawn))[0].lon_deg.tolist() == lon_deg


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("west_deg", [8.5, 179.998, -180.002])
def test_geojson_areas_are_cut_at_the_antimeridian_and_run_counterclockwise(west_deg: float, clockwise: bool) -> None:
    """RFC 7946, sections 3.1.6 and 3.1.9, for an area of 0.004 by 0.004 degrees."""
    corners = [(-16.801, west_deg), (-16.801, west_deg + 0.004), (-16.797, west_deg + 0.004), (-16.797, west_deg)]
    places = tuple(GeoPoint.at(lat, float(wrapped_deg(lon))) for lat, lon in corners)
    fence = Geofence(
        (FencePolygon(places[::-1] if clockwise else places, True),), (FenceCircle(places[0], 300.0, False),)
    )
    feature = json.loads(write_geojson(MapFile("x", "", (), fence)))["features"][0]
    assert feature["properties"]["clockwise"] is clockwise
    shape = shapely.geometry.shape(feature["geometry"])
    parts = shapely.get_parts(shape)
    assert len(parts) == (1 if west_deg == 8.5 else 2)
    assert all(part.exterior.is_ccw and np.ptp(np.array(part.exterior.coords)[:, 0]) <= 0.004 + 1e-9 for part in parts)
    assert sum(part.area for part in parts) == pytest.approx(0.004 * 0.004, rel=1e-4)
    assert np.abs(shapely.get_coordinates(shape)[:, 0]).max() <= 180.0
    document = ElementTree.fromstring(write_kml(MapFile("x", "", (), fence)))
    longitudes = [
        float(corner.split(",")[0])
        for ring in document.iter(f"{{{KML['k']}}}coordinates")
        for corner in (ring.text or "").split()
    ]
    assert max(map(abs, longitudes)) <= 180.0


def test_tracks_begin_and_end_with_the_plan(simulation1_plan: Plan) -> None:
    drawn = build_map(simulation1_plan, FENCE)
    assert drawn.geofence is FENCE
    assert drawn.title == simulation1_plan.scenario.title
    for one in drawn.tracks:
        assert (one.t_s[0], one.t_s[-1]) == (simulation1_plan.t_start_s, simulation1_plan.t_end_s)
        assert np.diff(one.t_s).max() <= 1.0 + 1e-9


POINTS = (MapPoint(1, "gate <north> & more", 12.5, 47.1, 8.1, 490.25), MapPoint(2, "", 40.0, 47.2, -8.2, 488.0))


def test_route_points_have_number_name_and_time() -> None:
    drawn = MapFile("x", "abc", (track([8.1, 8.2, 8.3]),), FENCE, POINTS)
    placemark = ElementTree.fromstring(write_kml(drawn)).findall("k:Document/k:Placemark[k:Point]", KML)[0]
    assert placemark.findtext("k:name", "", KML) == "1 gate <north> & more"
    assert placemark.findtext("k:Point/k:coordinates", "", KML) == "8.1,47.1,490.25"
    first, second = json.loads(write_geojson(drawn))["features"][1:3]
    assert first["geometry"] == {"type": "Point", "coordinates": [8.1, 47.1]}
    assert second["properties"] == {
        "kind": "route_point",
        "number": 2,
        "name": "",
        "t_s": 40.0,
        "altitude_amsl_m": 488.0,
    }


def test_a_map_has_the_points_as_they_were_drawn(simulation1_plan: Plan) -> None:
    routed = with_route(simulation1_plan, {60.0: {"name": "gate"}, 130.0: {"radius_m": 20.0}})
    assert build_map(simulation1_plan).points == ()
    first, second = build_map(routed).points
    assert (first.number, first.name, first.t_s, second.title) == (1, "gate", 60.0, "2")
    north_m, _, height_m = routed.scenario.route[0].position_m
    origin = routed.scenario.origin
    assert first.alt_amsl_m == pytest.approx(origin.alt_amsl_m + height_m, abs=0.1)
    assert first.lat_deg == pytest.approx(origin.lat_deg + north_m / 111_200.0, abs=2e-5)
