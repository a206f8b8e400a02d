"""`gcs new --positions`: vehicles and shapes from spreadsheets saved as CSV, and what is said of wrong ones."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from gcs.cli import main
from gcs.errors import ScenarioError, UsageError
from gcs.frames import Origin, ned_to_geodetic
from gcs.plan.formation.timeline import made_changes
from gcs.plan.plan_file import load_plan
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values import si
from gcs.util.bounded_file import POSITION_SHEET

HEAD = "number,name,x,y,z"
GRID = [(n, 2.5 * (n % 8) - 8.75, 2.5 * (n // 8) - 5.0, 0.0) for n in range(40)]
STAR = [
    (n, 24 * r * math.sin(n * math.pi / 20), 24 * r * math.cos(n * math.pi / 20), 40.0)
    for n, r in enumerate([1, 0.9, 0.8, 0.9] * 10)
]
RING = [(n, 20 * math.cos(n * math.pi / 20), 20 * math.sin(n * math.pi / 20), 40.0) for n in range(40)]


def gcs(line: str) -> int:
    return main.run(line.split())


def sheet(name: str, rows: list[tuple[int, float, float, float]]) -> None:
    lines = [f"{n + 1},D{n + 1:02d},{x:.3f},{y:.3f},{z:.1f}" for n, x, y, z in rows]
    Path(name).write_text("\n".join([HEAD, *lines]) + "\n", encoding="utf-8")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sheet("grid.csv", GRID)
    sheet("star.csv", STAR)
    sheet("ring.csv", RING)


def test_forty_vehicles_and_two_shapes_need_no_typing(capsys: pytest.CaptureFixture[str]) -> None:
    line = "new show --at 46.95,7.44,540 --positions grid.csv --shapes star.csv --shapes ring.csv"
    assert gcs(f"{line} --course east --distance 200 --count 40 --spacing 2.5") == 0
    said = capsys.readouterr().out
    assert "grid.csv: 40 vehicles, at least 2.50 m apart (1 and 2)" in said
    scenario = load_scenario("show")
    assert scenario.formation.sysids == tuple(range(1, 41))
    places = np.array([vehicle.position_m for vehicle in scenario.formation.vehicle])
    expected = np.array([(y, x, 40.0) for _, x, y, _ in GRID])  # in the air at the height of the shapes
    assert places == pytest.approx(expected, abs=1e-3)
    assert [shape.name for shape in scenario.formation.shape] == ["star", "ring"]
    star = np.array([(y, x, 0.0) for _, x, y, _ in STAR])
    assert np.array(scenario.formation.shape[0].offsets_m) == pytest.approx(star - star[0], abs=2e-3)
    assert [change.to for change in scenario.formation.change] == ["star", "ring", "start"]
    assert scenario.end.position_m[1] - scenario.start.position_m[1] == 200.0
    assert scenario.sensors.grade == "rtk"  # 2.5 m are too near for ordinary GNSS
    assert scenario.limits.separation_min_m == 2.5
    assert "separation_min_m is 2.5 m, as --spacing asks" in said


def test_a_spacing_that_no_change_of_shape_keeps_is_written_as_less_and_told_why(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sheet("five.csv", [(n, 2.0 * (n % 3), 2.0 * (n // 3), 0.0) for n in range(5)])
    turn, radius_m = 2.0 * math.pi / 5, 1.0 / math.sin(math.pi / 5)
    upright = [(n, radius_m * math.cos(n * turn), 0.0, 30.0 + radius_m * math.sin(n * turn)) for n in range(5)]
    sheet("upright.csv", upright)
    line = "--positions five.csv --shapes upright.csv --spacing"
    assert gcs(f"new kept {line} 1.5") == 0
    assert load_scenario("kept").limits.separation_min_m == 1.5
    assert "separation_min_m is 1.5 m, as --spacing asks" in capsys.readouterr().out
    assert gcs(f"new less {line} 1.8 --distance 30") == 0
    assert load_scenario("less").limits.separation_min_m == 1.53
    told = (
        'separation_min_m is 1.53 m, less than --spacing 1.8, with which reshape to "upright": vehicles 1 and 2 would'
    )
    assert told in capsys.readouterr().out


def test_places_rounded_to_millimetres_have_the_spacing_that_they_were_drawn_with(
    capsys: pytest.CaptureFixture[str],
) -> None:
    side_m = 5.0 / (2.0 * math.sin(math.pi / 3))
    angles = [2.0 * math.pi * n / 3 for n in range(3)]
    sheet("ring.csv", [(n, side_m * math.cos(a), side_m * math.sin(a), 20.0) for n, a in enumerate(angles)])
    sheet("pads.csv", [(n, 5.0 * n, 0.0, 0.0) for n in range(3)])
    assert gcs("new ring --positions pads.csv --shapes ring.csv --spacing 5") == 0
    assert 4.995 <= load_scenario("ring").limits.separation_min_m <= 5.0
    assert "as --spacing asks" in capsys.readouterr().out


def test_a_figure_stands_where_its_sheet_puts_it_and_holds() -> None:
    """Without a way the leader hovers at its own place of each sheet while the figure stands."""
    line = "--at 46.95,7.44,540 --positions grid.csv --shapes star.csv --shapes ring.csv"
    assert gcs(f"new show {line} --height 25 --spacing 2") == 0
    scenario = load_scenario("show")
    assert scenario.start.position_m == scenario.end.position_m == (GRID[0][2], GRID[0][1], 25.0)
    begins_s = [change.at_s or 0.0 for change in scenario.formation.change]
    changes_s = [change.duration_s for change in made_changes(scenario)]
    for number, (point, rows) in enumerate(zip(scenario.route, (STAR, RING), strict=True)):
        drawn = np.array([(y, x, z) for _, x, y, z in rows])
        figure = np.array(point.position_m) + np.array(scenario.formation.shape[number].offsets_m)
        assert cdist(drawn, figure).min(axis=1).max() < 2e-3
        assert point.at_s is not None and point.hold_s == 10.0
        assert begins_s[number] + changes_s[number] < point.at_s  # complete, and then it stands
        assert begins_s[number + 1] == point.at_s + point.hold_s
    assert begins_s[-1] + changes_s[-1] < scenario.time.flight_s


def test_figures_drawn_at_height_0_stand_at_the_height_of_the_flight(capsys: pytest.CaptureFixture[str]) -> None:
    sheet("flat.csv", [(n, x, y, 0.0) for n, x, y, _ in RING])
    assert gcs("new show --positions grid.csv --shapes flat.csv --height 30") == 0
    assert load_scenario("show").route[0].position_m[2] == 30.0
    assert "heights in the figures count from the flight's 30 m: some are on the ground" in capsys.readouterr().out


def test_pads_of_2_m_are_enough_for_figures_of_less(capsys: pytest.CaptureFixture[str]) -> None:
    """Forty from a grid into an upright ring, a spacing that its straight ways do not keep."""
    sheet("pads.csv", [(n, 2.0 * (n % 8), 2.0 * (n // 8), 0.0) for n in range(40)])
    turns = [n * math.pi / 20 for n in range(40)]
    sheet("upright.csv", [(n, 7.0 + 12.0 * math.cos(a), 4.0, 40.0 + 12.0 * math.sin(a)) for n, a in enumerate(turns)])
    assert gcs("new show --positions pads.csv --shapes upright.csv --spacing 1.5") == 0
    assert "separation_min_m is 1.5 m, as --spacing asks" in capsys.readouterr().out
    changes = made_changes(load_scenario("show"))
    assert all(change.least_gap_m >= 1.5 for change in changes)
    assert max(change.duration_s for change in changes) < 40.0  # not up through nine lanes, and down again


def test_a_flight_may_end_where_it_begins() -> None:
    assert gcs("new hover --distance 0 --count 4") == 0
    scenario = load_scenario("hover")
    assert scenario.start.position_m == scenario.end.position_m
    assert gcs("new grid --positions grid.csv --distance 0") == 0


def test_a_change_takes_the_time_that_it_needs_and_no_vehicle_climbs_too_fast_in_it() -> None:
    sheet("pads.csv", [(n, 3.0 * n, 0.0, 0.0) for n in range(4)])
    sheet("tower.csv", [(n, 3.0 * n, 0.0, 20.0 + 12.0 * n) for n in range(4)])  # nearly straight up
    assert gcs("new show --positions pads.csv --shapes tower.csv --distance 30") == 0
    scenario = load_scenario("show")
    changes = made_changes(scenario)
    at_s = [change.at_s for change in scenario.formation.change]
    assert at_s == [10.0, 10.0 + math.ceil(changes[0].duration_s) + 10.0]
    assert {change.limited_by for change in changes} == {"vertical speed"}
    assert changes[0].duration_s == pytest.approx(35.0 / 16.0 * 36.0 / (0.9 * 1.5), rel=1e-3)


def test_the_same_sheet_in_degrees_is_the_same_formation(capsys: pytest.CaptureFixture[str]) -> None:
    ned = np.array([(y, x, -z) for _, x, y, z in GRID])
    lat, lon, _ = ned_to_geodetic(ned, Origin(46.95, 7.44, 540.0))
    rows = [f"{n + 1};{a:.9f};{b:.9f};0".replace(".", ",") for n, (a, b) in enumerate(zip(lat, lon, strict=True))]
    text = "\n".join(["Nr;Latitude;Longitude;Höhe", *rows])  # decimal commas, and an umlaut as Windows writes it
    assert gcs("new metres --positions grid.csv --at 46.95,7.44,540") == 0
    for encoding in ("cp1252", "utf-16"):
        Path("degrees.csv").write_bytes(text.encode(encoding))
        assert gcs(f"new {encoding} --positions degrees.csv --at 46.95,7.44,540") == 0
        metres, degrees = (si.offsets_ned_m(load_scenario(name)) for name in ("metres", encoding))
        assert degrees == pytest.approx(metres, abs=2e-3)
    capsys.readouterr()
    assert gcs("new here --positions degrees.csv") == 0
    assert "the origin is the place of vehicle 1" in capsys.readouterr().out
    assert load_scenario("here").origin.lat_deg == pytest.approx(float(lat[0]), abs=1e-8)


@pytest.mark.slow
def test_a_planned_figure_stands_in_the_places_of_its_sheet() -> None:
    sheet("four.csv", [(n, 6.0 * n, 0.0, 0.0) for n in range(4)])
    square = [(n, 20.0 + 8.0 * (n % 2), -9.0, 15.0 + 8.0 * (n // 2)) for n in range(4)]
    sheet("square.csv", square)
    assert gcs("new small --positions four.csv --shapes square.csv") == 0
    assert gcs("plan small --to small.skein") == 0
    plan, scenario = load_plan("small.skein")[0], load_scenario("small")
    complete_s = scenario.route[0].at_s
    assert complete_s is not None
    drawn_ned_m = np.array([(y, x, -z) for _, x, y, z in square])
    for t_s in (complete_s, complete_s + 5.0, complete_s + 10.0):
        flown_ned_m = plan.motion(np.array([t_s]))[0][:, 0, :3]
        assert cdist(drawn_ned_m, flown_ned_m).min(axis=1).max() < 0.01


@pytest.mark.slow
def test_a_scenario_from_sheets_plans_at_once() -> None:
    sheet("four.csv", [(n, 6.0 * n, 0.0, 0.0) for n in range(4)])
    sheet("square.csv", [(n, 8.0 * (n % 2), 8.0 * (n // 2), 15.0) for n in range(4)])
    assert gcs("new small --positions four.csv --shapes square.csv --distance 60") == 0
    assert gcs("plan small --to small.skein") == 0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("7,D07,", "6,D07,", "row 8, number: vehicle 6 is there twice; it is in row 7 too"),
        ("7,D07,6.250", "7,D07,8.000", "rows 8 and 9: vehicles 7 and 8 are 0.75 m on the ground"),
        ("7,D07,6.250", "7,D07,6.25m", 'row 8, x: "6.25m" is not a number'),
        ("7,D07,6.250", "7,D07,", "row 8, x: is empty"),
        ("7,D07,6.250", "7,D07,nan", 'row 8, x: "nan" is not a number'),
        ("7,D07,6.250", "7,D07,1e6", "row 8, x: 1e6 is out of range"),
        ("7,D07,", "0,D07,", "row 8, number: 0 is not a system id"),
        ("7,D07,", "7.5,D07,", "row 8, number: 7.5 is not a system id"),
        ("x,y,z", "a,b,c", 'row 1: has no column x, y; its columns are "number"'),
        ("x,y,z", "x,x,z", "row 1: has two columns for x"),
        ("x,y,z", "x,latitude,z", "row 1: has metres and degrees"),
    ],
)
def test_a_wrong_sheet_is_refused_whole_with_its_rows(
    old: str, new: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path("grid.csv").read_text(encoding="utf-8")
    assert old in text
    Path("wrong.csv").write_text(text.replace(old, new, 1), encoding="utf-8")
    assert gcs("new show --positions wrong.csv") == UsageError.exit_code
    assert told in capsys.readouterr().err
    assert not Path("show").exists()


def test_every_mistake_is_told_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    Path("wrong.csv").write_text(f"{HEAD}\n1,a,0,0,0\n1,b,5,x,0\n2,c,,0,0\n1,d,9,9,0\n", encoding="utf-8")
    assert gcs("new show --positions wrong.csv") == UsageError.exit_code
    error = capsys.readouterr().err
    assert "wrong.csv has 3 mistakes; nothing is written" in error
    assert all(f"row {row}" in error for row in (3, 4, 5))


def test_a_vehicle_that_is_missing_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    sheet("short.csv", [row for row in GRID if row[0] != 6])
    assert gcs("new a --positions short.csv --count 40") == UsageError.exit_code
    assert "has 39 vehicles, and --count is 40; missing: 7" in capsys.readouterr().err
    assert gcs("new b --positions grid.csv --shapes short.csv") == UsageError.exit_code
    assert "no row has vehicle 7, which grid.csv has" in capsys.readouterr().err
    assert gcs("new c --positions short.csv --shapes star.csv") == UsageError.exit_code
    assert "row 8: short.csv has no vehicle 7" in capsys.readouterr().err
    assert gcs("new d --positions short.csv") == 0
    assert "WARNING: short.csv has no vehicle 7" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"PK\x03\x04rest", "is a workbook, not CSV"),
        (b"\x00\x01", "is not a text file"),
        (b"", "has no rows"),
        (HEAD.encode(), "has 0 vehicles"),
        (HEAD.encode() + b"".join(b"\n%d,,%d,0,0" % (n, 3 * n) for n in range(1, 256)), "has 255 vehicles"),
        (b" " * (POSITION_SHEET.largest_bytes + 1), "too large"),
    ],
)
def test_a_file_that_is_no_sheet_is_refused(content: bytes, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("odd.csv").write_bytes(content)
    assert gcs("new show --positions odd.csv") == UsageError.exit_code
    assert told in capsys.readouterr().err


def test_options_that_say_the_same_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for more in ("--shape line", "--full"):
        assert gcs(f"new show --positions grid.csv {more}") == UsageError.exit_code
        assert "exclude each other" in capsys.readouterr().err
    assert gcs("new show --shapes star.csv") == UsageError.exit_code
    assert "--shapes needs --positions" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["show", "plan"])
def test_a_sheet_in_place_of_a_scenario_is_told(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs(f"{command} grid.csv") == ScenarioError.exit_code
    assert "gcs new NAME --positions FILE.csv" in capsys.readouterr().err
