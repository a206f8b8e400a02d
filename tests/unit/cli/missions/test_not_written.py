"""What was asked for and cannot work: an exit code of its own for missions left out, and refusals before planning."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.cli.missions.export import listed_files
from gcs.errors import NotWritten
from gcs.util.long_work import within


def gcs(*arguments: object) -> int:
    return main.run([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def column_skein(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plan of two vehicles, one behind the other."""
    folder = tmp_path_factory.mktemp("column")
    assert gcs("new", folder / "column", "--count", 2, "--shape", "column", "--spacing", 5, "--distance", 60) == 0
    assert gcs("plan", folder / "column", "--to", folder) == 0
    return folder / "column.skein"


@pytest.fixture
def px4_field(repo_root: Path, tmp_path: Path) -> Path:
    """The mission `field` with PX4 vehicles."""
    folder = tmp_path / "field"
    shutil.copytree(repo_root / "missions" / "field", folder)
    file = folder / "scenario.toml"
    text = file.read_text()
    assert text.count('"ardupilot"') == 1
    file.write_text(text.replace('"ardupilot"', '"px4"'))
    return folder


def test_an_export_without_the_missions_it_was_asked_for_is_an_error(
    column_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    asked = ("export", column_skein, "--to", out, "--autopilot", "px4")
    assert gcs(*asked) == 13
    said, told = capsys.readouterr()
    (near_m,) = re.findall(r"may come within (\S+) m", told)
    assert f"│ {near_m} m " in said
    assert said.index("│ left out") < said.index(f"  {out}/uav1.setpoints")
    assert f"error: {out} has no missions, and 2 other files: not fit for mission mode: vehicles" in told
    assert "next: to write the setpoint stream alone, give --format setpoints; --untimed writes missions" in told
    assert {path.suffix for path in out.iterdir()} == {".setpoints", ".json"}
    assert gcs(*asked, "--json") == 13
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] is False
    assert told["refused"].startswith("not fit for mission mode")
    assert gcs(*asked, "--format", "setpoints") == 0
    assert gcs(*asked, "--untimed") == 0
    assert gcs(*asked, "--format", "plan,setpoints") == 13
    assert {path.suffix for path in out.iterdir()} == {".setpoints", ".json"}


def test_separations_are_said_once_before_anything_is_written(
    column_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert gcs("export", column_skein, "--to", out) == 0
    said, told = capsys.readouterr()
    table, files = said.split(f"  {out}/", 1)
    rows = [float(row) for row in re.findall(r"│ +(\d+\.\d+) m +│ +(?:proved|seen)", table)]
    assert len(rows) == 5  # plan, missions by the model and out of time, both kinds of returns
    assert "│ ok" in table
    assert "left out" not in table
    (least_m,) = re.findall(r"nearest of all: (\d+\.\d+) m, vehicles 1 and 2 at -?\d", table)
    assert float(least_m) == min(rows)
    assert "apart" not in files + told
    assert "come within" not in files + told
    for first in ("waypoints per vehicle", "missions, read back", "largest delay", "return altitudes: "):
        assert first in table
    assert all(line.startswith((f"  {out}/", "time: ")) for line in files.splitlines()[1:])
    assert gcs("export", column_skein, "--to", out, "--json") == 0
    data = json.loads(capsys.readouterr().out)["separations"]
    assert [row["sysids"] for row in data] == 5 * [[1, 2]]
    assert min(row["distance_m"] for row in data) == pytest.approx(float(least_m), abs=6e-3)
    assert json.loads((out / "index.json").read_text())["separations"][0]["what"] == "plan"


def test_missions_alone_that_are_not_fit_have_the_same_code(
    column_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert gcs("export", column_skein, "--to", out, "--autopilot", "px4", "--format", "plan") == 13
    assert NotWritten.exit_code == 13
    assert "not fit for mission mode" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("fly", "MISSION", "--sim", "--mode", "mission"), "missions cannot start together"),
        (("fly", "MISSION", "--link", "udpin:127.0.0.1:0", "--mode", "mission"), "missions cannot start together"),
        (("fly", "MISSION", "--sim", "--fault", "99:die@3"), "99"),
        (("export", "MISSION", "--to", "out", "--gates", "2", "--start", "10:30:00"), "PX4 cannot wait"),
        (("export", "MISSION", "--to", "."), "export"),
    ],
)
def test_what_cannot_work_is_refused_before_anything_is_planned(
    arguments: tuple[str, ...],
    told: str,
    px4_field: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(px4_field.parent)
    assert gcs(*("field" if word == "MISSION" else word for word in arguments)) == 2
    out, err = capsys.readouterr()
    assert "solve 1" not in out
    assert told in err
    assert [path.name for path in px4_field.parent.iterdir()] == ["field"]


def test_the_files_of_forty_vehicles_are_one_line_each_kind() -> None:
    setpoints = sorted(f"uav{n}.setpoints" for n in range(1, 41))
    assert listed_files(["map.kml", *setpoints]) == ["map.kml", "uav1.setpoints to uav40.setpoints, 40 files"]
    assert listed_files(setpoints[:20]) == setpoints[:20]


def test_an_export_without_time_left_writes_nothing_and_names_the_option(
    column_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with within(-1.0):
        assert gcs("export", column_skein, "--to", tmp_path / "out", "--limit", 100) == 4
    told = capsys.readouterr().err
    assert "error: nothing is written: the time limit has passed, while " in told
    assert "next: give more time (--limit)" in told
    assert not (tmp_path / "out").exists()
