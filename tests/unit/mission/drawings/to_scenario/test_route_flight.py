"""A drawing becomes a scenario that loads: places, heights, times and areas as they were drawn."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError, UsageError
from gcs.frames import Origin, ned_to_geodetic
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnArea, DrawnPoint
from gcs.mission.drawings.labels import Label, LeftOut, sentences
from gcs.mission.drawings.route_formats import drawing_in, read_drawing
from gcs.mission.drawings.to_scenario.route_flight import (
    RouteFlight,
    flight_time_s,
    is_passed_at_speed,
    route_flight,
    route_text,
    turns_rad,
)
from gcs.mission.formats.maps.geojson import write_geojson
from gcs.mission.formats.maps.kml import write_kml, write_kmz
from gcs.mission.formats.maps.tracks import MapFile, Track
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.registry import FORMATS, Content
from gcs.mission.geofence import FenceCircle, Geofence, GeoPoint
from gcs.mission.model import Home, MissionItem
from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.template import scenario_text

FILES = Path(__file__).parents[1] / "files"
HOME = Home(47.4, 8.5, 480.0)
AROUND = Origin(47.4, 8.5, 480.0)


def place(north_m: float, east_m: float) -> tuple[float, float]:
    lat, lon, _ = ned_to_geodetic(np.array([north_m, east_m, 0.0]), AROUND)
    return float(lat), float(lon)


def point(north_m: float, east_m: float, height_m: float = 20.0, datum: Datum = Datum.HOME, **more: Any) -> DrawnPoint:
    return DrawnPoint(place(north_m, east_m), height_m, datum, Label("item", round(north_m)), **more)


def drawing(*points: DrawnPoint, **more: Any) -> Drawing:
    return Drawing("drawn.plan", points, **({"home": HOME} | more))


def square(size_m: float, north_m: float = 0.0, east_m: float = 0.0) -> tuple[tuple[float, float], ...]:
    corners = ((0, 0), (size_m, 0), (size_m, size_m), (0, size_m))
    return tuple(place(north_m + north, east_m + east) for north, east in corners)


def text_of(flight: RouteFlight) -> str:
    origin = flight.route.origin
    place = origin.lat_deg, origin.lon_deg, origin.alt_amsl_m
    return scenario_text(Path("drawn"), Origin(*place), flight=flight, template="template_route.toml")


@pytest.fixture
def loaded(tmp_path: Path) -> Any:
    def load(flight: RouteFlight) -> Scenario:
        file = tmp_path / "scenario.toml"
        file.write_text(text_of(flight), encoding="utf-8")
        return load_scenario(file)

    return load


@pytest.mark.parametrize("name", sorted(file.name for file in FILES.iterdir()))
def test_every_drawing_becomes_a_scenario_whose_lines_a_person_can_read(name: str, loaded: Any) -> None:
    flight = route_flight(read_drawing(FILES / name), count=3, shape="line")
    scenario = loaded(flight)
    assert scenario.title == f"drawn: three quadrotors in a line along {name}"
    assert len(scenario.route) == len(flight.route.points) - (1 if flight.route.returns else 2)
    text = text_of(flight)
    assert all(f"#   {sentence}\n" in text for sentence in sentences(flight.left_out, flight.drawing.unit))
    assert all(str(point.drawn.label) in text for point in flight.route.points)


def test_points_are_where_they_were_drawn_at_their_own_heights(loaded: Any) -> None:
    flight = route_flight(
        drawing(point(0, 0), point(100, 0, 520.0, Datum.SEA), point(100, 150, 30.0, Datum.GROUND), point(0, 150, 25.0))
    )
    scenario = loaded(flight)
    assert scenario.origin.model_dump() == {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 480.0}
    assert scenario.start.position_m == pytest.approx((0.0, 0.0, 20.0), abs=0.02)
    assert scenario.route[0].position_m == pytest.approx((100.0, 0.0, 40.0), abs=0.02)
    assert scenario.route[1].position_m == pytest.approx((100.0, 150.0, 30.0), abs=0.02)
    assert [place.height_above_ground_m for place in (scenario.start, *scenario.route)] == [None, None, 30.0]
    assert scenario.end.position_m == pytest.approx((0.0, 150.0, 25.0), abs=0.02)
    assert [str(one) for one in flight.left_out] == [
        "heights: above the ground count from level ground at the origin's altitude; for the true ground give "
        "--terrain DEM"
    ]


def test_another_origin_keeps_every_altitude_above_the_sea(loaded: Any) -> None:
    scenario = loaded(route_flight(drawing(point(0, 0), point(200, 0)), (*place(50, 0), 470.0)))
    assert scenario.start.position_m == pytest.approx((-50.0, 0.0, 30.0), abs=0.02)


@pytest.mark.parametrize("ends", ["at the start", "with a return"])
def test_a_route_that_comes_back_ends_at_its_start(ends: str, loaded: Any) -> None:
    corners = [point(0, 0), point(100, 0), point(100, 100)]
    drawn = drawing(*corners, point(1, 1)) if ends == "at the start" else drawing(*corners, returns=True)
    flight = route_flight(drawn)
    scenario = loaded(flight)
    assert 'end = "start"' in text_of(flight)
    assert scenario.end.position_m == scenario.start.position_m
    assert len(scenario.route) == 2


def test_speeds_and_holds_make_the_time_and_stand_at_their_points(loaded: Any) -> None:
    drawn = drawing(
        point(0, 0, hold_s=9.0),
        point(100, 0, speed_mps=2.0),
        point(200, 0, speed_mps=2.0, hold_s=30.0, name="Bend"),
        point(200, 100, speed_mps=12.0),
        point(300, 100, speed_mps=12.0),
    )
    flight = route_flight(drawn)
    scenario = loaded(flight)
    assert [p.speed_mps for p in scenario.route] == [2.0, None, None]
    assert [p.hold_s for p in scenario.route] == [None, 30.0, None]
    assert [p.name for p in scenario.route] == [None, "Bend", None]
    assert "# speed_mps = 4.0" in text_of(flight)
    legs_s = 100.0 / 2.0 + 100.0 / 2.0 + 100.0 / 4.0 + 100.0 / 4.0
    assert legs_s + 30.0 < scenario.time.flight_s <= legs_s + 30.0 + 15.0
    said = [str(one) for one in flight.left_out]
    assert said[0].startswith("item 0: the hold is not carried over")
    assert said[1] == "item 200: drawn at 12 m/s, too fast for this vehicle type; 4 m/s here"


def test_fences_are_areas_to_stay_in_and_no_fly_zones(loaded: Any) -> None:
    drawn = drawing(
        point(0, 0),
        point(200, 0),
        areas=(
            DrawnArea(square(800, -300, -300), Label("fence polygon", 1), True, (square(30, 100, 100),)),
            DrawnArea(square(40, 200, 200), Label("fence polygon", 2), False),
            DrawnArea(square(40, 60, 60), Label("Placemark", 3)),
            DrawnArea(square(900, -350, -350), Label("Placemark", 4)),
            DrawnArea((place(100, -100),), Label("fence circle", 1), False, radius_m=25.0),
            DrawnArea((place(0, 0),), Label("fence circle", 2), True, radius_m=500.0),
        ),
    )
    flight = route_flight(drawn)
    scenario = loaded(flight)
    areas = [area.area for area in scenario.keep_in]
    assert [round(area.area) for area in areas[:2]] == pytest.approx([800**2, 900**2], rel=1e-4)
    assert areas[2].area == pytest.approx(32 * 500.0**2 * math.sin(2 * math.pi / 64), rel=1e-4)
    disk, other, hole = scenario.no_fly[1], scenario.no_fly[0], scenario.no_fly[2]
    assert (disk.north_m, disk.east_m, disk.radius_m) == pytest.approx((100.0, -100.0, 25.0), abs=0.02)
    assert np.array(other.polygon_m).min(axis=0) == pytest.approx([200.0, 200.0], abs=0.05)
    assert np.array(hole.polygon_m).min(axis=0) == pytest.approx([100.0, 100.0], abs=0.05)
    assert [str(one.label) for one in flight.left_out] == ["Placemark 3"]


def test_a_hole_is_kept_though_another_polygon_of_the_same_name_is_left_out(loaded: Any) -> None:
    """The polygons of one Placemark have one name."""
    areas = (
        DrawnArea(square(900, -350, -350), Label("Placemark", 1), holes=(square(30, 200, 200),)),
        DrawnArea(square(40, 60, 60), Label("Placemark", 1), holes=(square(5, 70, 70),)),
    )
    flight = route_flight(drawing(point(0, 0), point(100, 0), areas=areas))
    (hole,) = loaded(flight).no_fly
    assert np.array(hole.polygon_m).min(axis=0) == pytest.approx([200.0, 200.0], abs=0.05)
    assert [str(one.label) for one in flight.left_out] == ["Placemark 1"]


def test_fences_that_only_together_contain_the_route_are_joined(loaded: Any) -> None:
    two = (
        DrawnArea(square(300, -100, -100), Label("polygon", 1), True),
        DrawnArea(square(300, 100, -100), Label("polygon", 2), True),
    )
    flight = route_flight(drawing(point(0, 0), point(350, 0), areas=two), count=2)
    (area,) = loaded(flight).keep_in
    assert area.area.area == pytest.approx(500.0 * 300.0, rel=1e-3)
    with pytest.raises(FileFormatError, match=r"item 500 is 100\.0 m outside polygon 1 and the other areas"):
        route_flight(drawing(point(0, 0), point(500, 0), areas=two))
    apart = (two[0], DrawnArea(square(100, 300, -50), Label("polygon", 3), True))
    with pytest.raises(FileFormatError, match="polygon 1 and polygon 3, which are apart"):
        route_flight(drawing(point(0, 0), point(350, 0), areas=apart))


@pytest.mark.parametrize(
    ("drawn", "reason"),
    [
        (drawing(), "it has no point to fly to"),
        (drawing(point(0, 0)), "only one place to fly to"),
        (drawing(point(0, 0), point(0, 0.1), home=None), "only one place to fly to"),
        (drawing(point(0, 0), point(90, 0, 0.0)), "item 90 is 0.0 m above the origin; a vehicle flies at 1 m or more"),
        (drawing(point(0, 0), point(90, 0, 470.0, Datum.SEA)), "item 90 is -10.0 m above the origin"),
        (drawing(point(0, 0), point(90, 0, 2000.0)), "item 90 is 2,000 m above the origin; the limit is 1,500 m"),
        (drawing(point(0, 0), point(90, 0, 1e300)), r"item 90 is at 1e\+300 m, beyond any flight"),
        (drawing(point(0, 0), point(40_000, 0)), "km long and takes 12,005 s; the longest flight is 7200 s"),
        (drawing(point(0, 0), point(150_000, 0)), r"item 150000 is 150 km from the origin \(planned home\); the limit"),
        (
            drawing(
                point(0, 0), point(90, 0), areas=(DrawnArea((place(90, 5),), Label("circle", 1), False, radius_m=20.0),)
            ),
            "item 90 lies in circle 1, a no-fly zone",
        ),
        (
            drawing(
                point(0, 0), point(90, 0), areas=(DrawnArea(square(50, 50, 50)[::2] * 2, Label("polygon", 1), False),)
            ),
            "polygon 1 crosses itself",
        ),
        (drawing(*(point(n, 10 * (n % 2)) for n in range(110))), "has 110 points, and a route has at most 102"),
    ],
)
def test_what_makes_no_flight_is_refused_with_the_reason(drawn: Drawing, reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason):
        route_flight(drawn)


def test_a_fence_too_narrow_for_the_formation_is_refused_in_the_words_of_the_drawing() -> None:
    areas = (
        DrawnArea(square(900, -400, -400), Label("fence polygon", 1), True),
        DrawnArea(square(100), Label("fence polygon", 2), True),
        DrawnArea((place(-10, 20),), Label("fence circle", 1), False, radius_m=12.0),
    )
    with pytest.raises(UsageError) as refused:
        route_text(Path("drawn"), route_flight(drawing(point(5, 5), point(90, 5), areas=areas)))
    told = refused.value.message
    assert told.startswith("drawn.plan: a vee of 6, 10 m apart, is not possible:")
    assert "fence polygon 2: leaves out vehicle" in told and "fence circle 1: contains vehicle" in told
    assert not re.search(r"keep_in|no_fly|scenario\.toml|fence polygon 1", told)
    assert "--count" in refused.value.hint and "--spacing" in refused.value.hint and "--shape" in refused.value.hint


def test_reasons_name_points_and_areas_of_the_drawing() -> None:
    areas = (DrawnArea(square(900, -400, -400), Label("fence polygon", 1), True),)
    flight = route_flight(drawing(point(0, 0), point(100, 0), point(100, 100), areas=areas))
    told = [
        Mistake(("keep_in", 0, "polygon_deg"), "a", [[47.1, 8.5]]),
        Mistake(("route", 0, "position_m", 2), "b, far from [start]", 3.0),
        Mistake(("end",), "c"),
        Mistake(("keep_in", 7), "d"),
    ]
    assert flight.in_words(told) == "fence polygon 1: a\nitem 100: b, far from item 0\nitem 100: c\nkeep_in[7]: d"


def test_what_was_left_out_is_said_where_no_route_is_left() -> None:
    drawn = drawing(left_out=(LeftOut(Label.named("Placemark", 1, "empty", 3), "has no point; not carried over"),))
    with pytest.raises(FileFormatError, match=r'it has no point to fly to \(Placemark 1 \("empty"\): has no point'):
        route_flight(drawn)


@pytest.mark.parametrize("datum", [Datum.SEA, Datum.GROUND, Datum.HOME])
def test_points_on_or_under_the_ground_take_the_height_that_is_asked_for(datum: Datum) -> None:
    low_m = {Datum.SEA: 3.0}.get(datum, 0.0)
    high_m = {Datum.SEA: 500.0}.get(datum, 20.0)
    drawn = drawing(point(0, 0, low_m, datum), point(90, 0, high_m, datum))
    for at in (None, (*place(0, 0), 480.0)):
        flight = route_flight(drawn, at, 30.0)
        assert flight.route.places_m[:, 2] == pytest.approx([30.0, 20.0], abs=0.01)
        assert "flown at 30 m" in str(flight.left_out[0])


def test_the_hint_for_a_low_point_is_what_was_not_yet_given() -> None:
    drawn = drawing(point(0, 0, 3.0, Datum.SEA), point(90, 0, 500.0, Datum.SEA))
    for at, hints in ((None, "or give the altitude of the ground: --at"), ((*place(0, 0), 480.0), "or correct")):
        with pytest.raises(FileFormatError) as refused:
            route_flight(drawn, at)
        assert "give --height METRES" in refused.value.hint and hints in refused.value.hint


def test_points_without_heights_get_one_and_points_on_the_ground_too_if_asked() -> None:
    flat = drawing(point(0, 0, 0.0, Datum.NONE), point(90, 0, 0.0, Datum.NONE), home=None)
    flight = route_flight(flat)
    assert [p.height_m for p in flight.route.points] == [15.0, 15.0]
    assert "heights: no point has a height; flown 15 m above the origin (--height)" in sentences(flight.left_out)
    ground = drawing(point(0, 0, 0.0), point(90, 0, 20.0))
    assert [p.height_m for p in route_flight(ground, None, 12.0).route.points] == [12.0, 20.0]


def test_points_on_the_ground_take_the_height_asked_for_whatever_it_counts_from() -> None:
    # Converters write [lon, lat, 0] for no height: above the sea that is far below the ground.
    places = ((0, 0, 0.0), (90, 0, 0.0), (90, 90, 510.0))
    zeros = drawing(*(point(*one, Datum.SEA) for one in places), home=None)
    at = (*place(0, 0), 488.0)
    with pytest.raises(FileFormatError, match="-488") as refused:
        route_flight(zeros, at)
    hint = "give --height METRES for such points, or correct the altitude of the ground in --at"
    assert refused.value.hint == hint  # the ground was given
    flight = route_flight(zeros, at, 30.0)
    assert [(p.key, p.height_m) for p in flight.route.points] == [
        ("height_m", 30.0),
        ("height_m", 30.0),
        ("alt_amsl_m", 510.0),
    ]
    assert "items 0 and 90: a height of 0 m above the sea is under the ground; flown at 30 m" in sentences(
        flight.left_out
    )
    below_home = drawing(point(0, 0, 5.0), point(90, 0, 20.0))
    assert [p.key for p in route_flight(below_home, (*place(0, 0), 490.0), 30.0).route.points] == [
        "height_m",
        "alt_amsl_m",
    ]


def test_one_place_is_flown_to_from_home() -> None:
    flight = route_flight(drawing(point(120, 0, 30.0), returns=True))
    assert flight.route.places_m == pytest.approx(np.array([[0.0, 0.0, 30.0], [120.0, 0.0, 30.0]]), abs=0.02)


def test_a_home_far_away_is_not_the_origin() -> None:
    flight = route_flight(drawing(point(0, 0), point(90, 0), home=Home(-35.36, 149.16, 584.0)))
    assert flight.route.origin.lat_deg == pytest.approx(47.4)
    assert str(flight.left_out[0].label) == "the planned home"


def test_names_cannot_write_into_the_scenario(loaded: Any) -> None:
    nasty = '"]\n[limits] # @COUNT@ \\ "" \x1b[2J\u2028 ' + "'" * 3
    shapes = [{"type": "Point", "coordinates": [8.5, lat]} for lat in (47.4, 47.401, 47.402)]
    spots = [{"type": "Feature", "properties": {"name": nasty}, "geometry": shape} for shape in shapes]
    data = json.dumps({"type": "FeatureCollection", "features": spots}).encode()
    scenario = loaded(route_flight(drawing_in(data, 'a "b" @COUNT@.json')))
    assert scenario.formation.count == 6
    assert scenario.route[0].name == re.sub(r"[\n\x1b\u2028]", " ", nasty)


def test_a_long_track_is_thinned_and_begins_in_the_air(loaded: Any) -> None:
    flown = [(0.0, 0.0, up) for up in (0.0, 10.0, 20.0)]
    flown += [(5.0 * n, 60.0 * math.sin(n / 30.0), 20.0) for n in range(1, 300)] + [(1495.0, -31.0, 0.0)]
    spots = [point(north, east, 480.0 + up, Datum.SEA) for north, east, up in flown]
    flight = route_flight(drawing(*spots, home=None, recorded=True))
    scenario = loaded(flight)
    assert scenario.origin.alt_amsl_m == 480.0
    assert 5 < len(scenario.route) < 40
    assert scenario.start.position_m[2] == pytest.approx(20.0, abs=0.01)
    assert any("points are flown; no other is more than 1 m" in str(one) for one in flight.left_out)


places = st.tuples(st.floats(-2000.0, 2000.0), st.floats(-2000.0, 2000.0), st.floats(5.0, 100.0))


@settings(deadline=None, max_examples=20)
@given(st.lists(places, min_size=2, max_size=12), st.sampled_from(["plan", "waypoints"]), st.floats(0.0, 60.0))
def test_missions_that_this_program_writes_are_read_as_they_were(
    route: list[tuple[float, float, float]], form: str, hold_s: float
) -> None:
    items = []
    for north_m, east_m, up_m in route:
        lat_deg, lon_deg = place(north_m, east_m)
        where = round(lat_deg * 1e7), round(lon_deg * 1e7)
        items.append(MissionItem(16, 3, (hold_s, 0.0, 0.0, 0.0), *where, up_m))
    row = next(one for one in FORMATS if one.name == form and one.content is Content.MISSION)
    written = row.write(MissionFile("x", Autopilot.ARDUPILOT, HOME, tuple(items)))
    read = drawing_in(written.encode() if isinstance(written, str) else written, "x")
    assert read.home == HOME
    for item, drawn in zip(items, read.points, strict=True):
        assert drawn.place == (item.lat_degE7 / 1e7, item.lon_degE7 / 1e7)
        assert (drawn.height_m, drawn.datum) == (item.alt_m, Datum.HOME)
        assert drawn.hold_s == (hold_s if hold_s >= 0.1 else 0.0)


@pytest.mark.parametrize("write", [write_kml, write_kmz, write_geojson])
def test_maps_that_this_program_writes_are_the_flight_of_the_first_vehicle(write: Any, loaded: Any) -> None:
    north_m = np.concatenate([np.zeros(6), np.arange(0.0, 210.0, 10.0), np.full(6, 200.0)])
    up_m = np.concatenate([np.linspace(0.0, 20.0, 6), np.full(21, 20.0), np.linspace(20.0, 0.0, 6)])
    tracks = []
    for sysid, east_m in ((1, 0.0), (2, 10.0)):
        lat, lon, alt = ned_to_geodetic(np.column_stack([north_m, np.full(33, east_m), -up_m]), AROUND)
        tracks.append(Track(sysid, np.arange(33.0), lat.round(7), lon.round(7), alt.round(3)))
    zone = FenceCircle(GeoPoint(474_010_000, 85_010_000), 20.0, inclusion=False)
    written = write(MapFile("Two", "0" * 64, tuple(tracks), Geofence(circles=(zone,))))
    flight = route_flight(drawing_in(written.encode() if isinstance(written, str) else written, "x"), count=2)
    assert flight.route.places_m == pytest.approx(np.array([[0.0, 0.0, 20.0], [200.0, 0.0, 20.0]]), abs=0.03)
    assert flight.route.origin.alt_amsl_m == pytest.approx(480.0, abs=0.01)
    scenario = loaded(flight)
    assert scenario.end.position_m == pytest.approx((200.0, 0.0, 20.0), abs=0.05)
    assert len(scenario.no_fly) == 1


SEEDS = [file.read_bytes() for file in sorted(FILES.iterdir())]
WORDS = [b"0", b"-1", b"1e308", b"nan", b"null", b"[]", b'"', b"<", b"&amp;", b"\0", b"\xff", b"9" * 20, b"47.3977"]


@settings(deadline=None, max_examples=60)
@given(st.sampled_from(SEEDS), st.data())
def test_damaged_drawings_are_read_or_refused_with_a_sentence(seed: bytes, data: st.DataObject) -> None:
    tokens = [found.span() for found in re.finditer(rb"[-\w.]+", seed)]
    for first, last in sorted(data.draw(st.lists(st.sampled_from(tokens), min_size=1, max_size=3)), reverse=True):
        seed = seed[:first] + data.draw(st.sampled_from(WORDS)) + seed[last:]
    cut = data.draw(st.sampled_from([len(seed), len(seed), len(seed) // 2]))
    try:
        tomllib.loads(route_flight(drawing_in(seed[:cut], "x")).keys()["TABLES"])
    except FileFormatError as refused:
        assert refused.message.startswith("x")


STRAIGHT = np.array([[0.0, 0.0, 10.0], [300.0, 0.0, 10.0], [600.0, 0.0, 10.0]])


def test_a_straight_route_takes_its_length_over_its_speed_and_one_start_and_stop() -> None:
    assert flight_time_s(STRAIGHT, np.array([4.0, 4.0]), 1.2, np.zeros(3)) == 155.0  # 150 s and 4 s


def test_a_hold_costs_its_time_and_a_stop() -> None:
    assert flight_time_s(STRAIGHT, np.array([4.0, 4.0]), 1.2, np.array([0.0, 20.0, 0.0])) == 180.0  # 154 + 20 + 4


def test_each_leg_has_its_own_speed() -> None:
    assert flight_time_s(STRAIGHT, np.array([4.0, 2.0]), 1.2, np.zeros(3)) == 230.0  # 75 + 150 + 3


def test_a_climb_takes_the_time_of_its_height() -> None:
    climb = np.array([[0.0, 0.0, 10.0], [1.0, 0.0, 130.0]])
    assert flight_time_s(climb, np.array([4.0]), 1.2, np.zeros(2)) == 105.0  # 100 + 4


def test_turns_are_the_angles_between_legs() -> None:
    square = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [10.0, 0.0, 0.0], [10.0, -5.0, 0.0]])
    assert np.degrees(turns_rad(square)) == pytest.approx([90.0, 180.0, 0.0], abs=1e-5)
    assert is_passed_at_speed(np.radians(29.0)) and not is_passed_at_speed(np.radians(31.0))
