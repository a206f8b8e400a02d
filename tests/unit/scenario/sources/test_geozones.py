"""Geozones of files become no-fly zones; what a file leaves in doubt makes a zone larger, and is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from implicitdict import ImplicitDict
from uas_standards.eurocae_ed269 import ED269Schema
from uas_standards.eurocae_ed318 import ED318Schema, Polygon, UASZone

from gcs.errors import FileFormatError, ScenarioError
from gcs.frames import ned_to_geodetic
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.scenario.sources import geozone_tables as tables
from gcs.scenario.sources.bundled_missions import bundled_mission
from gcs.scenario.sources.geozones import Geozone, ZoneVolume
from gcs.scenario.sources.load import load_scenario, with_keys
from gcs.scenario.values.navigation_error import navigation_error
from gcs.scenario.values.si import local_origin

Data = dict[str, Any]
FLOWN = 'flown_utc = ["2026-11-28T10:00:00Z", "2026-11-28T12:00:00Z"]'


@pytest.fixture(scope="module")
def base() -> Scenario:
    return load_scenario("gap")


def lon_lat(base: Scenario, *places_m: tuple[float, float]) -> list[list[float]]:
    lat, lon, _ = ned_to_geodetic(np.array([(*place, 0.0) for place in places_m]), local_origin(base))
    return np.stack([lon, lat], axis=1).tolist()


def corner_ring(base: Scenario, north_m: float, east_m: float, half_m: float = 20.0) -> list[list[float]]:
    around = ((-1, -1), (-1, 1), (1, 1), (1, -1), (-1, -1))
    return lon_lat(base, *((north_m + half_m * n, east_m + half_m * e) for n, e in around))


def aside(base: Scenario) -> tuple[float, float]:
    """A place in the box where no vehicle starts or ends."""
    limits = base.limits
    return limits.north_m[1] - 25.0, limits.east_m[0] + 25.0


def ed269(place: Data, volume: Data | None = None, **zone: Any) -> Data:
    limits = {"uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL"}
    limits |= {"upperLimit": 120, "upperVerticalReference": "AGL", **(volume or {})}
    limits = {key: value for key, value in limits.items() if value is not None}
    period = {"permanent": "YES"}
    about = {"identifier": "AB01", "country": "CHE", "type": "COMMON", "restriction": "PROHIBITED"}
    about |= {"applicability": [period], "zoneAuthority": [], **zone}
    return {"title": "t", "features": [{**about, "geometry": [{**limits, "horizontalProjection": place}]}]}


def ed318(geometry: Data, **properties: Any) -> Data:
    about = {"identifier": "AB01", "country": "CHE", "type": "PROHIBITED", "variant": "COMMON", "zoneAuthority": []}
    feature = {"type": "Feature", "properties": {**about, **properties}, "geometry": geometry}
    return {"type": "FeatureCollection", "metadata": {}, "features": [feature]}


Load = Callable[..., Scenario]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    def loaded(document: Data | str, *keys: str) -> Scenario:
        source = bundled_mission(Path("gap"))
        assert source is not None
        text = source.read_text()
        entry = "\n".join(["[[no_fly]]", 'file = "zones.json"', *keys, ""])
        written = document if isinstance(document, str) else json.dumps(document)
        (tmp_path / "zones.json").write_text(written)
        (tmp_path / "scenario.toml").write_text(f"{text}\n{entry}")
        return load_scenario(tmp_path)

    return loaded


def added(base: Scenario, scenario: Scenario) -> int:
    return len(scenario.no_fly) - len(base.no_fly)


def test_samples_are_files_of_the_standards_and_become_zones_where_they_are(base: Scenario, load: Load) -> None:
    north_m, east_m = aside(base)
    ring = corner_ring(base, north_m, east_m)
    polygon = ed269({"type": "Polygon", "coordinates": [ring]})
    circle = ed269({"type": "Circle", "center": lon_lat(base, (north_m, east_m))[0], "radius": 20.0})
    layer = {"upper": 120.0, "upperReference": "AMSL", "lower": 0.0, "lowerReference": "AGL", "uom": "m"}
    drawn = ed318({"type": "Polygon", "coordinates": [ring], "layer": layer})
    extent = {"subType": "Circle", "radius": 20.0}
    point = {"type": "Point", "coordinates": lon_lat(base, (north_m, east_m))[0], "extent": extent, "layer": layer}
    for document in (polygon, circle):
        assert len(ED269Schema.from_dict(document).features) == 1
    assert len(ED318Schema.from_dict(ed318(point)).features) == 1
    feature = drawn["features"][0]  # the schema's own type of a geometry reads points alone
    assert ImplicitDict.parse(feature["properties"], UASZone).identifier == "AB01"
    assert ImplicitDict.parse(feature["geometry"], Polygon).layer.uom == "m"
    for document, corner in ((polygon, 20.0), (circle, 0.0), (drawn, 20.0), (ed318(point), 0.0)):
        scenario = load(document)
        assert added(base, scenario) == 1
        zone = scenario.no_fly[-1]
        assert zone.file is None
        for away_m, is_inside in ((19.99, True), (20.05, False)):
            outside = outside_m(zone, np.zeros(1), np.array([north_m + away_m]), np.array([east_m + 0.9 * corner]))
            assert (outside[0] < 0.0) == is_inside
        (note,) = scenario.geozones
        assert "zone 1 (AB01) of zones.json, PROHIBITED, at all times" in note and "120 m A" in note


def test_a_zone_above_the_box_is_left_out_and_a_centimetre_decides(base: Scenario, load: Load) -> None:
    ring = corner_ring(base, *aside(base))
    place = {"type": "Polygon", "coordinates": [ring]}
    top_m = base.limits.height_m[1] + navigation_error(base).vertical_m
    sea_m = base.origin.alt_amsl_m
    for reference, reached_m, keys in (
        ("AMSL", sea_m + top_m, ()),
        ("AGL", top_m, ()),
        ("WGS84", sea_m + top_m + 90.0, ()),
        ("WGS84", sea_m + top_m + 48.0, ("geoid_m = 48.0",)),
    ):
        for by_m, zones in ((0.01, 0), (-0.01, 1)):
            lower = {"lowerLimit": reached_m + by_m, "lowerVerticalReference": reference, "upperLimit": None}
            scenario = load(ed269(place, lower), *keys)
            assert added(base, scenario) == zones
            kept = (scenario.no_fly[len(base.no_fly) :] or scenario.no_fly_beyond)[0]
            assert kept.height_m == pytest.approx((top_m + by_m, 10_000.0))
            assert any("above all heights of the box" in note for note in scenario.geozones) == (zones == 0)


@pytest.mark.parametrize(
    "volume",
    [
        {"lowerLimit": None},
        {"lowerLimit": 9000.0, "lowerVerticalReference": "QNH"},
        {"lowerLimit": 9000.0, "lowerVerticalReference": None},
        {"lowerLimit": "1.5", "lowerVerticalReference": "AGL", "uomDimensions": "FT"},
        {"lowerLimit": "1.5", "lowerVerticalReference": "AGL", "uomDimensions": None},
        {"upperLimit": 1.0},
        {"upperLimit": None},
        {"upperLimit": 1.0, "upperVerticalReference": "QNH"},
        {"lowerLimit": 500.0, "upperLimit": 100.0},
    ],
)
def test_limits_in_doubt_make_a_zone_lower_and_higher(base: Scenario, load: Load, volume: Data) -> None:
    if isinstance(volume.get("lowerLimit"), str):  # a share of the greatest height: above it in metres, below in feet
        volume = volume | {"lowerLimit": float(volume["lowerLimit"]) * base.limits.height_m[1]}
    scenario = load(ed269({"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]}, volume))
    assert added(base, scenario) == 1
    height_m = scenario.no_fly[-1].height_m
    if volume.get("upperLimit", 120.0) is None or ("QNH" in volume.values() and "upperLimit" in volume):
        assert height_m is None
        assert "without limits in height" in scenario.geozones[0]
    elif volume.get("lowerLimit") == 500.0:
        assert height_m is None
        assert "upper limit is not above the lower one" in scenario.geozones[0]
    elif isinstance(volume.get("lowerLimit"), float) and volume["lowerVerticalReference"] == "AGL":
        assert height_m is not None
        assert height_m[0] == pytest.approx(volume["lowerLimit"] * 0.3048)  # an unknown unit is the foot
    else:
        assert height_m is not None
        assert height_m[0] == -10_000.0
        assert height_m[1] >= max(row[0] for row in base.terrain.mountains.rows) + volume.get("upperLimit", 120.0)


def period(start: str | None, end: str | None, **more: Any) -> Data:
    given = {"permanent": "NO", "startDateTime": start, "endDateTime": end, **more}
    return {key: value for key, value in given.items() if value is not None}


def test_a_zone_holds_where_one_of_its_periods_meets_the_flight(base: Scenario, load: Load) -> None:
    place = {"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]}
    schedule = [{"day": ["SUN"], "startTime": "20:00Z", "endTime": "21:00Z"}]
    for periods, zones in (
        ([period(None, "2026-11-28T09:59:59Z")], 0),
        ([period(None, "2026-11-28T10:00:00Z")], 1),
        ([period("2026-11-28T13:00:00+01:00", None)], 1),
        ([period("2026-11-28T13:00:01+01:00", None)], 0),
        ([period("2026-11-29T00:00:00Z", None), period("2026-11-01T00:00:00Z", "2026-12-01T00:00:00Z")], 1),
        ([period(None, None)], 1),
        ([], 1),
        ([period("2026-11-01T00:00:00Z", "2026-12-01T00:00:00Z", schedule=schedule)], 1),
    ):
        scenario = load(ed269(place, applicability=periods), FLOWN)
        assert added(base, scenario) == zones
        assert added(base, load(ed269(place, applicability=periods))) == 1  # at all times, where no time is given
    assert "whatever its schedule says" in load(ed269(place, applicability=periods), FLOWN).geozones[0]


def test_periods_are_times_of_a_plan_that_may_begin_whenever_it_ends_in_time(base: Scenario, load: Load) -> None:
    """From 10 h to 12 h a flight of `flight_s` may begin up to so much before 12 h."""
    place = {"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]}
    flight_s = base.time.flight_s
    periods = [period("2026-11-28T11:59:00Z", "2026-11-28T13:00:00Z"), period("2026-11-28T15:00:00Z", None)]
    scenario = load(ed269(place, applicability=periods), FLOWN)
    assert scenario.no_fly[-1].in_force_s == pytest.approx((flight_s - 60.0, 10_800.0))
    assert "in force from t =" in scenario.geozones[0]
    always = load(ed269(place, applicability=[period("2026-11-28T08:00:00Z", None)]), FLOWN)
    assert always.no_fly[-1].in_force_s is None


def test_a_zone_of_ones_own_that_the_flight_does_not_meet_counts_in_proofs_alone(base: Scenario) -> None:
    north_m, east_m, _ = base.start.position_m
    disk = {"north_m": north_m, "east_m": east_m, "radius_m": 20.0}
    above = disk | {"height_m": [1000.0, 2000.0]}
    later = disk | {"in_force_s": [9000.0, 9100.0]}
    scenario = with_keys(base, no_fly=[above, later])
    assert not scenario.no_fly
    assert [zone.height_m for zone in scenario.no_fly_beyond] == [(1000.0, 2000.0), None]
    assert [note.split(";")[-1] for note in scenario.geozones] == [" only gcs prove counts it"] * 2
    with pytest.raises(ScenarioError, match="contains vehicle"):
        with_keys(base, no_fly=[disk | {"height_m": [10.0, 2000.0]}])
    with pytest.raises(ScenarioError, match="contains vehicle"):  # a higher box meets it
        with_keys(scenario, limits={"height_m": [0.0, 1500.0]})


def test_what_restricts_nothing_is_permitted_or_is_elsewhere_is_left_out_with_its_reason(
    base: Scenario, load: Load
) -> None:
    place = {"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]}
    far = {"type": "Polygon", "coordinates": [corner_ring(base, 9000.0, 9000.0)]}
    for document, keys, reason in (
        (ed269(place, restriction="NO_RESTRICTION"), (), "no restriction"),
        (ed269(place), ('permitted = ["AB01"]',), "permitted"),
        (ed269(far), (), "beside the box"),
    ):
        scenario = load(document, *keys)
        assert added(base, scenario) == 0
        assert scenario.geozones == (f"zones.json: left out, {reason}: 1",)
    assert "NEW, which counts as prohibited" in load(ed269(place, restriction="NEW")).geozones[0]


def test_a_zone_around_the_start_is_a_mistake_of_the_entry_that_names_the_file(base: Scenario, load: Load) -> None:
    ring = corner_ring(base, base.start.position_m[0], base.start.position_m[1])
    with pytest.raises(ScenarioError, match=r'no_fly\[\d+\]\.file = "zones.json".*which is of this file, contains'):
        load(ed269({"type": "Polygon", "coordinates": [ring]}))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda zone: zone.pop("geometry"), r'zone 1 \(AB01\): has no list "geometry"'),
        (lambda zone: zone["geometry"][0].update(lowerLimit="low"), "lowerLimit is no number: 'low'"),
        (lambda zone: zone["geometry"][0]["horizontalProjection"].update(type="Sector"), "neither Circle nor Polygon"),
        (lambda zone: zone["geometry"][0]["horizontalProjection"]["coordinates"][0][0].pop(), "not \\[longitude"),
        (lambda zone: zone.update(applicability=[period("2026-11-28T10:00", None)]), "has no time zone"),
        (lambda zone: zone.update(applicability=[period("soon", None)]), "'soon' is no time"),
    ],
)
def test_a_file_with_a_zone_that_cannot_be_read_is_refused_with_the_zone(
    base: Scenario, load: Load, spoil: Callable[[Data], object], said: str
) -> None:
    document = ed269({"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]})
    spoil(document["features"][0])
    with pytest.raises(ScenarioError, match=said):
        load(document)


def test_other_files_and_keys_are_refused(base: Scenario, load: Load) -> None:
    place = {"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]}
    swapped = [[lat, lon] for lon, lat in place["coordinates"][0]]
    for document, keys, said in (
        ("{", (), "zones.json"),
        ("[]", (), 'no list "features"'),
        (ed269({"type": "Polygon", "coordinates": [swapped]}), (), "longitude comes first"),
        (ed269(place), ('permitted = ["XX"]',), "the file has no zone XX"),
        (ed269(place), ('flown_utc = ["2026-11-28", "tomorrow"]',), "flown_utc"),
        (ed269(place), ("radius_m = 5.0",), "stands beside file"),
    ):
        with pytest.raises(ScenarioError, match=said):
            load(document, *keys)


def test_both_meanings_of_a_long_straight_edge_are_in_the_zone(base: Scenario) -> None:
    asked = tables._asked(NoFlyZone(file="x"), base)
    lat_deg, lon_deg = base.origin.lat_deg, base.origin.lon_deg
    south, north, west, east = lat_deg - 0.4, lat_deg + 0.001, lon_deg - 0.3, lon_deg + 0.3
    ring = ((north, west), (north, east), (south, east), (south, west))  # in the south the parallel is the outer one
    zone = tables._straight("zone 1", ring, asked)
    share = np.linspace(0.0, 1.0, 101)
    parallel = tables._plane(np.stack([np.full(101, north), west + share * (east - west)], axis=1), asked)
    first, last = tables._plane(np.array(ring[:2]), asked)
    shortest = first + share[:, None] * (last - first)
    assert np.abs(parallel - shortest)[:, 0].max() > 10.0  # metres between the two
    for line in (parallel, shortest):
        assert shapely.distance(zone, shapely.points(line)).max() < 0.02
    near, _ = tables._shapes(Geozone("zone 1", "", "", (), ()), ZoneVolume(ring, None, None, None, 1.0), asked)
    assert near[0].polygon_m is not None


def test_other_mistakes_of_the_scenario_are_told_beside_a_file(base: Scenario, load: Load) -> None:
    document = ed269({"type": "Polygon", "coordinates": [corner_ring(base, *aside(base))]})
    with pytest.raises(ScenarioError, match="wrong_key"):
        load(document, "wrong_key = 1")
    with pytest.raises(ScenarioError, match=r"preflight\.reserve"):
        load(document, "[preflight]", "reserve = 5.0")


def test_latitude_and_longitude_exchanged_is_asked_about(base: Scenario) -> None:
    here = base.model_copy(update={"origin": base.origin.model_copy(update={"lat_deg": 47.0, "lon_deg": 8.0})})
    asked = tables._asked(NoFlyZone(file="x"), here)
    corners = tuple((lon, lat) for lon, lat in corner_ring(here, *aside(here))[:-1])
    for radius_m, places in ((None, corners), (30.0, corners[:1])):
        volume = ZoneVolume(places, radius_m, None, None, 1.0)
        with pytest.raises(FileFormatError, match="Swapped"):
            tables._shapes(Geozone("zone 1", "", "PROHIBITED", (volume,), ()), volume, asked)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_a_polygon_of_any_size_near_the_box_is_covered(data: st.DataObject) -> None:
    scenario = load_scenario("gap")
    asked = tables._asked(NoFlyZone(file="x"), scenario)
    count = data.draw(st.integers(3, 1200))
    size_m = data.draw(st.floats(30.0, 60_000.0))
    rough = np.random.default_rng(data.draw(st.integers(0, 10**6))).uniform(0.7, 1.0, count)
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    middle = np.array(aside(scenario)) + size_m * np.array([0.5, -0.5])
    corners = middle + (size_m * rough)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    degrees = [(lat, lon) for lon, lat in lon_lat(scenario, *map(tuple, corners.tolist()))]
    volume = ZoneVolume(tuple(degrees), None, None, None, 1.0)
    zones, _ = tables._shapes(Geozone("zone 1", "", "PROHIBITED", (volume,), ()), volume, asked)
    region = asked.needed.buffer(100.0, join_style="mitre")
    drawn = shapely.Polygon(corners).buffer(0.0).intersection(region)
    kept = shapely.union_all([shapely.Polygon(zone.polygon_m) for zone in zones])
    assert drawn.is_empty or kept.buffer(0.001).covers(drawn)
    assert all(len(zone.polygon_m or ()) <= 500 for zone in zones)
