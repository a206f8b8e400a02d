"""`gcs new --survey`: from a drawn area to a scenario, and what is said of wrong options and files."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import shapely

from gcs.cli import main
from gcs.frames import Origin, ned_to_geodetic, place_up_m
from gcs.scenario.schema.vehicle_types import preset_file
from gcs.scenario.sources.load import load_scenario

OUTLINE = [[8.545, 47.397], [8.5476, 47.3972], [8.5474, 47.3988], [8.5452, 47.3986], [8.545, 47.397]]
POND = [[8.5460, 47.3978], [8.5463, 47.3979], [8.5462, 47.3982], [8.5460, 47.3978]]
RIDGE = Path(__file__).parents[4] / "missions" / "ridge" / "ridge.tif"
LINE = "new field --survey area.geojson --swath 12"


def gcs(line: str) -> int:
    return main.run(line.split())


def draw(*polygons: list[list[list[float]]]) -> None:
    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": rings}}
        for rings in polygons
    ]
    Path("area.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    draw([OUTLINE, POND])


def test_a_drawn_area_becomes_a_scenario_where_it_was_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs(f"{LINE} --height 30 --count 4") == 0
    scenario = load_scenario(Path("field"))
    assert scenario.survey is not None
    lon, lat = shapely.Polygon(OUTLINE).exterior.coords.xy
    origin = scenario.origin
    drawn = place_up_m(lat, lon, 0.0, Origin(origin.lat_deg, origin.lon_deg, origin.alt_amsl_m))[:, :2]
    assert shapely.hausdorff_distance(shapely.Polygon(drawn), shapely.Polygon(scenario.survey.polygon_m)) < 0.01
    assert len(scenario.survey.hole) == 1
    assert {point.position_m[2] for point in scenario.route} == {30.0}
    assert len(scenario.formation.sysids) <= 4
    told = capsys.readouterr().out
    assert "3.1" in told and "ha" in told and "hole: not surveyed, and crossed" in told


def test_at_is_where_it_starts_and_ends() -> None:
    assert gcs(f"{LINE} --at 47.3965,8.545,410") == 0
    scenario = load_scenario(Path("field"))
    assert scenario.origin.alt_amsl_m == 410.0
    assert scenario.start.position_m == scenario.end.position_m == (0.0, 0.0, 15.0)


def test_holes_that_are_avoided_are_no_fly_zones() -> None:
    assert gcs(f"{LINE} --holes avoid") == 0
    assert len(load_scenario(Path("field")).no_fly) == 1


def test_the_angle_is_that_of_the_passes() -> None:
    assert gcs(f"{LINE} --angle 30") == 0
    (shape,) = load_scenario(Path("field")).formation.shape
    assert shape.heading_deg is not None and shape.heading_deg % 180.0 == 30.0


def test_a_survey_is_as_fast_as_its_vehicles(capsys: pytest.CaptureFixture[str]) -> None:
    usual = preset_file("quad500").read_text(encoding="utf-8")
    for name, most_mps in (("slow", 2.0), ("fast", 12.0)):
        text = usual.replace("speed_ned_mps = [5.0, 5.0,", f"speed_ned_mps = [{most_mps}, {most_mps},")
        assert text != usual
        Path(f"{name}.toml").write_text(text, encoding="utf-8")
    assert gcs(f"{LINE} --vehicle slow.toml") == 0
    slow_s = load_scenario(Path("field")).time.flight_s
    assert gcs(f"{LINE.replace('field', 'quick')} --vehicle fast.toml --speed 9") == 0
    assert load_scenario(Path("quick")).time.flight_s < slow_s / 2.0
    assert gcs(f"{LINE.replace('field', 'no')} --vehicle slow.toml --speed 4") == 2
    assert "(slow.toml) survey with at most 1.8 m/s" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("new field --survey area.geojson", "--survey needs --swath"),
        ("new field --swath 12", "--swath needs --survey"),
        (f"{LINE} --overlap 120%", "not a share up to 90%"),
        (f"{LINE} --overlap 20", "not a share up to 90%"),
        (f"{LINE} --angle steep", "--angle steep: not a course"),
        (f"{LINE} --holes over", "--holes"),
        (f"{LINE} --spacing 4", "--survey and --spacing exclude each other"),
        (f"{LINE} --speed 9", "at most 4.5 m/s"),
        (f"{LINE} --at 46,8", "from --at"),
    ],
)
def test_a_wrong_option_is_refused(line: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs(line) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not Path("field").exists()


def test_an_area_that_crosses_itself_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    draw([[OUTLINE[0], OUTLINE[2], OUTLINE[1], OUTLINE[3], OUTLINE[0]]])
    assert gcs(LINE) == 2
    assert "Self-intersection" in capsys.readouterr().err


@pytest.mark.parametrize("count", [0, 2])
def test_a_file_without_exactly_one_area_is_refused(count: int, capsys: pytest.CaptureFixture[str]) -> None:
    draw(*[[OUTLINE]] * count)
    assert gcs(LINE) != 0
    assert "area.geojson" in capsys.readouterr().err


FIELD = [[46.1, 9.2], [46.1, 9.2012], [46.101, 9.2012], [46.101, 9.2]]
AROUND = [[46.0985, 9.198], [46.0985, 9.203], [46.1025, 9.203], [46.1025, 9.198]]
ZONE = [[46.1004, 9.2004], [46.1004, 9.2007], [46.1006, 9.2007], [46.1006, 9.2004]]
WAYPOINT = {"type": "SimpleItem", "command": 16, "doJumpId": 1, "frame": 3, "params": [0, 0, 0, 0, 46.1, 9.2, 20]}
CORRIDOR = {"complexItemType": "CorridorScan", "polyline": [[46.1, 9.2], [46.102, 9.2]], "CorridorWidth": 60}
SURVEY = {"complexItemType": "survey", "polygon": FIELD}


def plan_file(
    pattern: dict[str, object] | None, *polygons: tuple[list[list[float]], bool], disk_m: float = 0.0
) -> None:
    items = [WAYPOINT, *([{"type": "ComplexItem", **pattern}] if pattern else [])]
    circles = [{"circle": {"center": [46.1008, 9.2009], "radius": disk_m}, "inclusion": False}] if disk_m else []
    plan = {
        "fileType": "Plan",
        "version": 1,
        "mission": {"version": 2, "firmwareType": 3, "plannedHomePosition": [46.1, 9.2, 500], "items": items},
        "geoFence": {
            "version": 2,
            "polygons": [{"polygon": edge, "inclusion": inside} for edge, inside in polygons],
            "circles": circles,
        },
    }
    Path("drawn.plan").write_text(json.dumps(plan), encoding="utf-8")


def test_everything_else_of_a_drawing_is_kept_or_said(capsys: pytest.CaptureFixture[str]) -> None:
    plan_file(None, (FIELD, True), (ZONE, False), disk_m=8.0)
    assert gcs("new field --survey drawn.plan --swath 12") == 0
    scenario = load_scenario(Path("field"))
    told = capsys.readouterr().out
    assert scenario.origin.alt_amsl_m == 500.0 and "0 m above the sea; for" not in told
    polygon, disk = scenario.no_fly
    assert polygon.polygon_m is not None and disk.radius_m == 8.0
    assert scenario.survey is not None
    zones = [shapely.Polygon(polygon.polygon_m), shapely.Point(disk.north_m, disk.east_m).buffer(7.9)]
    assert all(scenario.survey.area.intersection(zone).area < 1.0 for zone in zones)
    assert "2 no-fly zones" in told and "passes see about" in told
    assert "item 1 (NAV_WAYPOINT): not flown" in told and "fence polygon 1: surveyed" in told


@pytest.mark.parametrize(("pattern", "hectares"), [(SURVEY, 1.0314), (CORRIDOR, 222.3 * 60.0 / 10_000.0)])
def test_what_a_plan_itself_surveys_is_the_area_and_its_fence_is_kept(
    pattern: dict[str, object], hectares: float
) -> None:
    plan_file(pattern, (AROUND, True))
    assert gcs("new field --survey drawn.plan --swath 12") == 0
    scenario = load_scenario(Path("field"))
    assert scenario.survey is not None
    assert scenario.survey.area.area / 10_000.0 == pytest.approx(hectares, rel=0.002)
    (fence,) = scenario.keep_in
    assert fence.area.area / 10_000.0 == pytest.approx(17.189, rel=0.002)


def test_zones_that_leave_no_single_field_are_refused_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    across = [[46.1004, 9.19], [46.1004, 9.21], [46.1006, 9.21], [46.1006, 9.19]]
    plan_file(SURVEY, (across, False))
    assert gcs("new field --survey drawn.plan --swath 12") == 2
    assert "fence polygon 1 divide it into 2 parts" in capsys.readouterr().err


def test_a_fence_too_near_for_the_turns_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    near = [[46.09999, 9.19999], [46.09999, 9.20121], [46.10101, 9.20121], [46.10101, 9.19999]]
    plan_file(SURVEY, (near, True))
    assert gcs("new field --survey drawn.plan --swath 12") != 0
    error = capsys.readouterr().err
    assert "drawn.plan" in error and "fence polygon 1" in error and "keep_in" not in error


def test_over_an_elevation_model_the_height_is_that_above_the_ground(capsys: pytest.CaptureFixture[str]) -> None:
    """A field of 100 m by 80 m at the foot of a ridge."""
    at = Origin(-33.42, -70.58, 740.0)
    corners_m = np.array([[60.0, -40.0, 0.0], [160.0, -40.0, 0.0], [160.0, 40.0, 0.0], [60.0, 40.0, 0.0]])
    lat, lon, _ = ned_to_geodetic(corners_m, at)
    edge = [[float(a), float(b)] for a, b in zip(lon, lat, strict=True)]
    draw([[*edge, edge[0]]])
    assert gcs(f"{LINE} --height 30 --terrain {RIDGE}") == 0
    scenario = load_scenario(Path("field"))
    ground = scenario.terrain.relief
    assert ground is not None and scenario.survey is not None and scenario.survey.height_above_ground_m == 30.0
    for place in (scenario.start, *scenario.route):
        north_m, east_m, up_m = place.position_m
        assert place.height_above_ground_m == 30.0
        assert up_m - float(ground.height_m(np.array(north_m), np.array(east_m))) == pytest.approx(30.0, abs=0.01)
    told = capsys.readouterr().out
    written = Path("field/scenario.toml").read_text(encoding="utf-8")
    assert f'file = "{os.path.relpath(RIDGE, "field")}"' in written  # the folder may be moved with its model
    assert "flown 30 m above the ground" in told and f"that of --terrain: {scenario.origin.alt_amsl_m:g} m" in told


def test_a_fence_is_not_surveyed_in_place_of_a_pattern_without_corners(capsys: pytest.CaptureFixture[str]) -> None:
    item = {"type": "ComplexItem", "complexItemType": "survey", "version": 5, "polygon": []}
    mission = {"version": 2, "firmwareType": 3, "plannedHomePosition": [47.397, 8.545, 410], "items": [item]}
    polygon = {"version": 1, "inclusion": True, "polygon": [corner[::-1] for corner in OUTLINE[:-1]]}
    fence = {"version": 2, "polygons": [polygon], "circles": []}
    text = json.dumps({"fileType": "Plan", "version": 1, "mission": mission, "geoFence": fence})
    Path("area.plan").write_text(text, encoding="utf-8")
    assert gcs("new field --survey area.plan --swath 12") == 2
    assert "item 1 (survey): has no corner" in capsys.readouterr().err


def test_what_a_pattern_says_beside_its_area_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    polygon = [corner[::-1] for corner in OUTLINE[:-1]]
    item = {"type": "ComplexItem", "complexItemType": "survey", "version": 5, "polygon": polygon}
    mission = {"version": 2, "firmwareType": 3, "plannedHomePosition": [47.397, 8.545, 410], "items": [item]}
    text = json.dumps({"fileType": "Plan", "version": 1, "mission": mission})
    Path("area.plan").write_text(text, encoding="utf-8")
    assert gcs("new field --survey area.plan --swath 12") == 0
    told = capsys.readouterr().out
    assert "item 1 (survey): its heights, camera and angle are not carried over; give --height" in told
    assert "flown 15 m above the origin (--height)" in told


@pytest.mark.parametrize(("options", "told"), [("--count 5 --holes avoid", True), ("--count 1 --holes avoid", False)])
def test_fewer_vehicles_than_asked_for_are_explained(
    options: str, told: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gcs(f"{LINE} {options}") == 0
    used, out = len(load_scenario(Path("field")).formation.sysids), capsys.readouterr().out
    assert (used < 5) or not told
    assert (f"{used} of 5 vehicles: all 5 abreast would see about " in out) == told
