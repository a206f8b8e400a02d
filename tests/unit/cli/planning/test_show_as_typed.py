"""`gcs show` of forty vehicles: every pad on paper, and mistakes told of the key that is wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from gcs.cli import main

GRID = [(n + 1, 2.5 * (n % 8), 2.5 * (n // 8)) for n in range(40)]
STAR = [(n, 3.0 * east, 3.0 * north) for n, east, north in GRID]


def gcs(line: str) -> int:
    return main.run(line.split())


@pytest.fixture(autouse=True)
def show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    for name, rows in (("grid.csv", GRID), ("star.csv", STAR)):
        lines = [f"{n},{east:.2f},{north:.2f}" for n, east, north in rows]
        Path(name).write_text("\n".join(["number,x,y", *lines]) + "\n", encoding="utf-8")
    assert gcs("new show --positions grid.csv --shapes star.csv") == 0
    capsys.readouterr()


def edit(old: str, new: str) -> None:
    file = Path("show/scenario.toml")
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")


def errors(capsys: pytest.CaptureFixture[str]) -> list[str]:
    assert gcs("show show") == 3
    return capsys.readouterr().err.splitlines()


def test_a_file_has_every_pad_and_so_has_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("show show --pads pads.csv") == 0
    told = capsys.readouterr().out
    assert "│ 40      │" in told
    assert " more" not in told
    assert told.splitlines()[-1] == "pads: pads.csv"
    with Path("pads.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert gcs("show show --json --pads pads.csv") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["pads_file"] == "pads.csv"
    assert [{name: float(value) for name, value in row.items()} for row in rows] == shown["pads"]
    assert len(rows) == 40


def test_a_terminal_has_twenty_and_names_the_file_that_has_all(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert gcs("show show") == 0
    told = capsys.readouterr().out
    assert "│ 20      │" in told
    assert "│ 21      │" not in told
    assert told.splitlines()[-1] == "and 20 more: --pads pads.csv writes all 40"
    assert gcs("show show --pads pads.xlsx") == 2
    assert "next: write --pads pads.csv" in capsys.readouterr().err


def test_one_vehicle_too_high_is_one_mistake_of_this_vehicle(capsys: pytest.CaptureFixture[str]) -> None:
    edit("{ sysid = 5, position_m = [0.0, 10.0, 15.0] }", "{ sysid = 5, position_m = [0.0, 10.0, 90.0] }")
    error, step = errors(capsys)
    assert "formation.vehicle[4].position_m[2] = 90.0: puts vehicle 5 outside the box, height" in error
    assert step.startswith("next: set formation.vehicle[4].position_m[2] to 15, as the others have, or limits.height_m")
    edit("{ sysid = 5, position_m = [0.0, 10.0, 90.0] }", "{ sysid = 5, position_m = [0.0, 10.0, 3.0] }")
    error, step = errors(capsys)
    assert "formation.vehicle[4].position_m[2] = 3.0: vehicle 5 would be 2.00 m too low" in error
    assert step == "next: set formation.vehicle[4].position_m[2] to 5 or more"


def test_a_missing_vehicle_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    edit("  { sysid = 17, position_m = [5.0, 0.0, 15.0] },\n", "")
    error, _ = errors(capsys)
    assert "has 40 places for 39 vehicles; vehicle 17 is missing in formation.vehicle" in error


def test_a_start_that_is_moved_says_at_once_what_moves_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    edit("start = { position_m = [0.0, 2.5, 15.0] }", "start = { position_m = [-300.0, 2.5, 20.0] }")
    told = "\n".join(errors(capsys))
    assert "differs from [0, 2.5, 15], the position of the leader, vehicle 2" in told
    assert "move [start] back, or every vehicle by 300 m south, 5 m up" in told
    assert "and move every vehicle by " in told
    assert "limits.north_m" in told


@pytest.mark.parametrize("name", ["grid.csv", "grid.xlsx"])
def test_a_sheet_in_place_of_a_mission_or_scenario_is_told_where_it_goes(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if name.endswith("xlsx"):
        Path(name).write_bytes(b"PK\x03\x04\x14\x00\x06\x00\xff\xfe")
    for line, code, kind in ((f"check {name}", 6, "mission"), (f"show {name}", 3, "scenario")):
        assert gcs(line) == code
        error, step = capsys.readouterr().err.splitlines()
        assert error.startswith(f"error: {name}: is a sheet, not a {kind}")
        assert "gcs new NAME --positions FILE.csv" in step


def test_a_scenario_in_place_of_a_mission_is_told_what_checks_it(capsys: pytest.CaptureFixture[str]) -> None:
    Path("field.toml").write_text("schema_version = 1\n")
    assert gcs("check field.toml") == 6
    error, step = capsys.readouterr().err.splitlines()
    assert error.startswith("error: field.toml: is a scenario, not a mission")
    assert "gcs plan" in step
