"""`gcs check` and `gcs export` as people and programs meet them: words, JSON, exit codes."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.cli.missions.check import FINDINGS
from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify

PLANNED = ("--timing", "planned")


@pytest.fixture
def exported(repo_root: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    shutil.copytree(repo_root / "missions" / "simulation1" / "expected", folder)
    return folder


def plans(folder: Path) -> list[str]:
    return [str(p) for p in sorted(folder.glob("*.plan"))]


def test_our_own_export_is_clean(exported: Path, repo_root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["check", *plans(exported), *PLANNED]) == 0
    text = capsys.readouterr().out
    assert re.fullmatch(r"6 missions, 29\d s at planned speeds", text.splitlines()[0])  # landings at LAND_SPEED
    assert re.search(r"separation +│ 0\.\d{3} m +│ 0\.\d{3} m +│ ≥ 0\.3 m +│ ok ", text)
    assert text.splitlines()[-1] == "no findings"
    assert (
        main.run(["check", *plans(exported), "--terrain", str(repo_root / "missions" / "simulation1"), *PLANNED]) == 0
    )
    text = capsys.readouterr().out
    assert re.search(r"clearance[a-z ]+│ \d\.\d{3} m +│ \d\.\d{3} m +│ ≥ 0\.4 m +│ ok ", text), text


def test_the_model_of_the_autopilot_takes_its_time_and_keeps_together(
    exported: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The autopilot is slower than the planned speeds, equally for all vehicles: the separation does not shrink."""
    two = [str(exported / f"uav{n}.plan") for n in (2, 5)]
    assert main.run(["check", *two, "--json"]) == 0
    modelled = json.loads(capsys.readouterr().out)
    assert main.run(["check", *two, "--json", *PLANNED]) == 0
    planned = json.loads(capsys.readouterr().out)
    assert (modelled["timing"], planned["timing"]) == ("autopilot", "planned")
    assert modelled["duration_s"] > planned["duration_s"] + 5.0
    assert modelled["separation_min_m"] > 0.4


def test_findings_have_an_exit_code_of_their_own(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["check", *plans(exported), "--separation", "2", *PLANNED]) == FINDINGS == 11
    text = capsys.readouterr().out
    assert "error [separation] item" in text
    assert "error [rally] rally point 1 is 0.50 m from one of" in text
    assert main.run(["check", *plans(exported), "--separation", "2", "--json", *PLANNED]) == FINDINGS
    found = json.loads(capsys.readouterr().out)
    assert found["ok"] is False
    assert found["separation_asked_m"] == 2.0
    assert found["separation_min_m"] == pytest.approx(0.43, abs=0.1)
    assert {f["rule"] for f in found["findings"]} == {"separation", "rally"}
    assert set(found["findings"][0]) == {"rule", "level", "message", "file", "line", "item", "t_s"}


def test_what_another_program_wrote_otherwise_is_told(
    exported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "spaces.waypoints"
    file.write_text((exported / "uav1.waypoints").read_text().replace("\t", " "))
    assert main.run(["check", str(file), "--json", *PLANNED]) == FINDINGS
    (told,) = (f for f in json.loads(capsys.readouterr().out)["findings"] if f["rule"] == "format")
    assert (told["level"], told["file"], told["line"]) == ("warning", str(file), 2)
    assert re.match(r"columns separated or surrounded by blanks; .* \(\d+ times in this file", told["message"])


def test_a_file_changed_after_its_export_is_told(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exported / "uav1.plan"
    path.write_text(path.read_text() + "\n")
    assert main.run(["check", *plans(exported), *PLANNED]) == FINDINGS
    assert "uav1.plan: warning [changed]" in capsys.readouterr().out


def test_another_autopilot(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables = [str(p) for p in sorted(exported.glob("*.waypoints"))]
    assert main.run(["check", *tables, *PLANNED]) == 0
    assert main.run(["check", *plans(exported), "--autopilot", "px4", *PLANNED]) == 0
    capsys.readouterr()
    path = exported / "uav1.waypoints"
    path.write_text(path.read_text().replace("\t2\t93\t", "\t2\t115\t", 1))
    assert main.run(["check", str(path)]) == FINDINGS
    assert "[command]" not in capsys.readouterr().out
    text = path.read_text().splitlines()
    without_home = "\n".join([text[0], *("\t".join([str(n), *row.split("\t")[1:]]) for n, row in enumerate(text[2:]))])
    path.write_text(without_home)
    assert main.run(["check", str(path), "--autopilot", "px4"]) == FINDINGS
    assert "PX4 does not execute CONDITION_YAW" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["check"], 2, "FILE"),
        (["check", "gone.plan"], 6, "gone.plan: No such file"),
        (["check", "x.plan", "--autopilot", "inav"], 2, "give one of ardupilot, px4"),
        (["check", "x.plan", "--timing", "ideal"], 2, "give one of planned, autopilot"),
        (["check", "x.plan", "--separation", "0"], 2, "give a number from 0.001 to 1000000 m"),
        (["check", "x.plan", "--separation", "nan"], 2, "give a number from 0.001 to 1000000 m"),
        (["export", "x", "--to", "y", "--autopilot", "inav"], 2, "give one of ardupilot, px4"),
        (["export", "x", "--to", "y", "--altitude", "up"], 2, "give one of relative, amsl, terrain"),
        (["export", "x", "--to", "y", "--format", "dxf"], 2, "there is no format 'dxf'"),
        (["export", "x", "--to", "y", "--format", "plan, kml,dxf"], 2, "there is no format 'dxf'"),
    ],
)
def test_what_cannot_be_meant(
    arguments: list[str], code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(arguments) == code
    assert message in capsys.readouterr().err


def test_a_file_that_cannot_be_read_is_named_with_its_line(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exported / "uav2.plan"
    path.write_text(path.read_text().replace('"command": 93', '"command": -93', 1))
    assert main.run(["check", *plans(exported)]) == 6
    err = capsys.readouterr().err
    assert "uav2.plan, line " in err
    assert "mission.items.1.command" in err


@pytest.mark.slow
def test_an_export_tells_what_was_verified(
    simulation1_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.skein"
    save_plan(simulation1_plan, verify(simulation1_plan), path)
    arguments = ["export", str(path), "--to", str(tmp_path / "out"), "--format", "plan", "--format", "param"]
    assert main.run([*arguments, "--autopilot", "px4", "--altitude", "amsl", "--untimed", "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert (told["firmware"], told["altitude"]) == ("px4", "amsl")
    assert set(told["files"]) == {f"uav{n}.{suffix}" for n in range(1, 7) for suffix in ("plan", "params")}
    assert told["returns"]["worst"]["distance_m"] > 0.3
    assert re.fullmatch(r"(WARNING: .*\n)*", err)
    assert main.run([*arguments, "--autopilot", "px4", "--altitude", "amsl", "--untimed"]) == 0
    out, _ = capsys.readouterr()
    proved_m = re.search(r"at least (\d+\.\d{3}) m above ground, proved", out)
    assert proved_m is not None
    assert float(proved_m[1]) >= 0.39
    nearest_m = re.search(r"nearest of all: (\d+\.\d+) m, vehicles \d and \d at ", out)
    assert nearest_m is not None
    assert float(nearest_m[1]) >= 0.3
    assert "return altitudes: " in out
    assert main.run([*arguments[:-2], "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert told["firmware"] == "ardupilot"
    assert [vehicle["sysid"] for vehicle in told["timing"]["vehicles"]] == list(simulation1_plan.sysids)
    assert re.fullmatch(r"(WARNING: .*\n)*", err)
    assert main.run(arguments[:-2]) == 0
    assert "missions, read back and computed as a model of ArduCopter flies them: at least" in capsys.readouterr().out
