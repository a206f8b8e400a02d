"""Files that each release wrote are read for ever, as docs/releases.md promises. They never change once it is out."""

from __future__ import annotations

from pathlib import Path

import pytest

import gcs
from gcs.cli import main
from gcs.errors import FileFormatError

HERE = Path(__file__).resolve().parent
RELEASES = sorted(folder for folder in HERE.iterdir() if (folder / "plan.skein").is_file())


def test_every_release_is_here() -> None:
    assert [folder.name for folder in RELEASES] == ["0.1.0"]


@pytest.fixture(params=RELEASES, ids=lambda folder: folder.name)
def release(request: pytest.FixtureRequest) -> Path:
    folder: Path = request.param
    return folder


def test_its_scenarios_are_read(release: Path) -> None:
    full = gcs.load_scenario(release / "full.toml")
    assert full.formation.count == 6 and full.no_fly
    assert gcs.load_scenario(release / "scenario.json") == gcs.load_plan(release / "plan.skein")[0].scenario


def test_its_plan_is_read_and_proved_again_or_says_what_to_do(release: Path) -> None:
    try:
        plan, report = gcs.load_plan(release / "plan.skein")
    except FileFormatError as refused:  # of a later format
        assert "plan" in refused.hint
        return
    assert report.ok, report.failures
    assert plan.scenario.name == "short" and plan.sysids == (1, 2, 3)


def test_its_missions_and_setpoints_are_read(release: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missions = sorted((release / "missions").glob("*.plan"))
    assert main.run(["check", *map(str, missions), "--separation", "2"]) == 0, capsys.readouterr().out
    waypoints = sorted((release / "missions").glob("*.waypoints"))
    assert main.run(["check", *map(str, waypoints), "--separation", "2"]) == 0, capsys.readouterr().out
    setpoints = sorted((release / "missions").glob("*.setpoints"))
    tracks = gcs.read_tracks(setpoints).tracks
    assert gcs.prove(tracks, gcs.TrackLimits(separation_m=2.5)).ok


def test_its_record_of_a_flight_is_read(release: Path) -> None:
    reports = gcs.load_record(release / "record.parquet")
    assert tuple(reports.sysids) == (1, 2, 3) and len(reports.t_s) > 1000
