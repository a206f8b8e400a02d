"""`gcs new` writes the formation that its options name, at places as people write them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gcs.cli import main
from gcs.cli.planning import new
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.template import SHAPES
from gcs.scenario.values import si


def gcs(line: str) -> int:
    return main.run(line.split())


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_scenario_one_has_in_mind_plans_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    wanted = "--count 4 --shape line --spacing 8 --course north-east --distance 400"
    assert gcs(f"new plans/line --at 47.39,8.54 {wanted}") == 0
    assert "0 m above the sea" in capsys.readouterr().out
    scenario = load_scenario("plans/line")
    assert (scenario.origin.lat_deg, scenario.origin.lon_deg) == (47.39, 8.54)
    assert scenario.title == "line: four quadrotors in a line"
    north_m, east_m, height_m = scenario.end.position_m
    assert math.hypot(north_m, east_m) == pytest.approx(400.0, abs=0.01)
    assert (math.degrees(math.atan2(east_m, north_m)), height_m) == (pytest.approx(45.0), 15.0)
    abreast = np.array([math.cos(math.radians(135.0)), math.sin(math.radians(135.0)), 0.0])
    assert si.offsets_ned_m(scenario) == pytest.approx(8.0 * np.outer([0, 1, -1, 2], abreast), abs=1e-9)
    assert scenario.no_fly == ()
    assert gcs("plan plans/line --to plans --json") == 0
    assert json.loads(capsys.readouterr().out)["plan"] == "plans/line.skein"
    assert Path("plans/line.skein").is_file()


@pytest.mark.parametrize("at", ["47.39,8.54,450", "47.39 8.54 450", "47.39, 8.54, 450", "47.39,8.54 450"])
def test_places_take_commas_and_spaces(at: str) -> None:
    assert gcs(f"new --at {at} first") == 0
    assert gcs(f"new second --full --at={at.replace(' ', ',').replace(',,', ',')}") == 0
    for name in ("first", "second"):
        origin = load_scenario(name).origin
        assert (origin.lat_deg, origin.lon_deg, origin.alt_amsl_m) == (47.39, 8.54, 450.0)


def test_places_in_the_south_and_west_are_no_options() -> None:
    assert gcs("new first --at -33.4,-70.6") == 0
    assert gcs("new second --at -33.4 -70.6 740 --count 2") == 0
    assert load_scenario("first").origin.lon_deg == -70.6
    assert load_scenario("second").origin.alt_amsl_m == 740.0


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("full", ["", "--full"])
def test_every_shape_is_a_valid_scenario_in_every_direction(shape: str, full: str) -> None:
    for course in ("south", "wnw", "-45", "123.4"):
        line = f"new {shape}{course.strip('-.')[:2]} --shape {shape} --course {course} --count 7 --height 30 {full}"
        assert gcs(line) == 0


def test_short_and_full_are_the_same_flight(capsys: pytest.CaptureFixture[str]) -> None:
    shown = []
    for folder, full in (("a/first", ""), ("b/first", "--full")):
        assert (
            gcs(f"new {folder} --count 3 --shape column --spacing 6 --course sw --distance 50 --height 40 {full}") == 0
        )
        capsys.readouterr()
        assert gcs(f"show {folder} --json") == 0
        shown.append(json.loads(capsys.readouterr().out))
    assert shown[0] == shown[1]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--at 47.39", "--at 47.39: not a place"),
        ("--at here", "--at here: not a place"),
        ("--shape star", "give one of triangle, line, column, vee, grid, circle, sphere"),
        ("--course sideways", "--course sideways: not a course"),
        ("--spacing 0", "--spacing 0: not from 0.1 to 1000 m"),
        ("--count 0", "--count 0: not from 1 to 10000"),
        ("--spacing 0.1 --count 2", "such a flight is not possible"),
        ("--shape sphere --count 30 --spacing 4 --height 60", "vehicles of 0.75 m would take off 0.677 m apart"),
    ],
)
def test_what_is_no_flight_writes_nothing(options: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs(f"new first {options}") == 2
    err = capsys.readouterr().err
    assert told in err
    assert "line " not in err  # of a file that was not written
    assert not Path("first").exists()


def test_the_words_for_shapes_are_those_of_scenarios() -> None:
    assert new.SHAPES == SHAPES


def test_the_separation_beside_a_typed_spacing_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new plans/near --count 4 --spacing 1.5") == 0
    scenario = load_scenario("plans/near")
    assert (scenario.formation.shape[0].spacing_m, scenario.limits.separation_min_m) == (1.5, 0.75)
    told = "vehicles stand 1.5 m apart; separation_min_m is 0.75 m, less, for room to change the shape"
    assert told in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("count", "course"),
    [pytest.param(1, "north", marks=pytest.mark.long), (5, "east"), pytest.param(4, "225", marks=pytest.mark.long)],
)
def test_every_shape_plans_and_exports(shape: str, count: int, course: str) -> None:
    assert gcs(f"new x --count {count} --shape {shape} --spacing 6 --course {course} --distance 80") == 0
    assert gcs("plan x --to .") == 0
    assert gcs("export x.skein --to out") == 0


@pytest.mark.parametrize(("spacing", "grade"), [("4.9", "rtk"), ("5", "gnss")])
@pytest.mark.parametrize("full", ["", "--full"])
def test_vehicles_too_near_for_ordinary_gnss_have_better_sensors(
    spacing: str, grade: str, full: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the sensors that every scenario had, their position errors left nothing of their distance."""
    assert gcs(f"new near --count 4 --shape line --spacing {spacing} {full}") == 0
    assert load_scenario("near").sensors.grade == grade
    said = 'vehicles stand too near for ordinary GNSS: the scenario has sensors.grade = "rtk"'
    assert capsys.readouterr().out.count(said) == (grade == "rtk")
    assert gcs("new alone --count 1") == 0
    assert load_scenario("alone").sensors.grade == "gnss"


def test_a_wedge_is_a_vee(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new plans/mine --count 5 --shape wedge") == 2
    assert "next: give --shape vee, or one of triangle, line, " in capsys.readouterr().err
    assert gcs("new plans/mine --count 5 --shape star") == 2
    assert "next: give one of triangle, line, " in capsys.readouterr().err


def test_show_says_that_a_formation_turns_with_its_course(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new plans/mine --count 5 --shape vee") == 0
    path = Path("plans/mine/scenario.toml")
    path.write_text(path.read_text().replace("[formation] ", '[formation]\nframe = "course"\n#'))
    capsys.readouterr()
    assert gcs("show plans/mine") == 0
    assert "none, but it turns with the leader's course, within 5 degrees" in capsys.readouterr().out


def test_a_climb_that_wind_makes_too_quick_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new plans/mine --count 5") == 0
    path = Path("plans/mine/scenario.toml")
    wind = "\n[wind]\nspeed_mps = 3\nfrom_deg = 240\n"
    path.write_text(path.read_text() + wind)
    assert gcs("show plans/mine") == 0
    path.write_text(path.read_text().replace("takeoff_s = 25.0", "takeoff_s = 20.0"))
    capsys.readouterr()
    assert gcs("show plans/mine") == 3
    told = capsys.readouterr().err
    assert "because a smooth step in wind is 2.19 times as fast in its middle as on average" in told
    assert "next: set ground_phases.takeoff_s to 22" in told
