"""`gcs new --survey`: from a drawn area to a scenario, and what is said of wrong options and files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import shapely

from gcs.cli import main
from gcs.frames import Origin, place_up_m
from gcs.scenario.sources.load import load_scenario

OUTLINE = [[8.545, 47.397], [8.5476, 47.3972], [8.5474, 47.3988], [8.5452, 47.3986], [8.545, 47.397]]
POND = [[8.5460, 47.3978], [8.5463, 47.3979], [8.5462, 47.3982], [8.5460, 47.3978]]
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
