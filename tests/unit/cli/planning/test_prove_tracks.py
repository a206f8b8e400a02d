"""`gcs prove`: its verdicts as a table, as JSON and as exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.cli import main


@pytest.fixture
def crossing(tmp_path: Path) -> list[str]:
    """Two vehicles that cross 0.453 m apart at t = 4.925 s, half way between two samples."""
    (tmp_path / "a.csv").write_text("t,x,y,z\n0,0,0,10\n10,20,0,10\n")
    (tmp_path / "b.csv").write_text("t,x,y,z\n0,9.7,-10,10.4\n10,9.7,10,10.4\n")
    return ["prove", *(str(tmp_path / name) for name in ("a.csv", "b.csv")), "--frame", "enu"]


def test_a_proof_ends_with_0(crossing: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([*crossing, "--separation", "0.45", "--height", "5", "12"]) == 0
    out = capsys.readouterr().out
    assert "≥ 0.4528 m" in out
    assert "no limit is stated: speed, acceleration, jerk, thrust, tilt, ground, no-fly zones" in out
    assert "proved: yes, 2 vehicles from 0 s to 10 s" in out


def test_a_violation_ends_with_5_and_names_the_pair_and_the_instant(
    crossing: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run([*crossing, "--separation", "0.5"]) == 5
    error = capsys.readouterr().err
    assert "separation: 0.453 m at t = 4.9" in error
    assert "(vehicles a and b), at least 0.5 m required" in error


def test_json_has_every_check(crossing: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([*crossing, "--separation", "0.5", "--vertical-scale", "2", "--json"]) == 5
    data = json.loads(capsys.readouterr().out)
    separation = next(check for check in data["checks"] if check["name"] == "separation")
    assert (data["ok"], separation["verdict"], separation["vehicles"]) == (False, "violated", ["a", "b"])
    assert separation["seen"] == pytest.approx((0.3**2 / 2 + 0.2**2) ** 0.5, abs=2e-3)


def test_the_spans_in_which_it_must_not_be_broken_off_are_named(
    crossing: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run([*crossing, "--separation", "0.45", "--abort", "hold"]) == 0
    assert "separation, broken" in capsys.readouterr().out
    line = [*crossing, "--separation", "0.45", "--abort", "land"]
    assert main.run(line) == 5
    said = capsys.readouterr()
    assert "4.11 s to 4.40 s: separation, broken off to land 0.212" in said.out
    assert "not proved: separation, broken off to land" in said.err
    assert main.run([*line, "--json"]) == 5
    (span,) = json.loads(capsys.readouterr().out)["unsafe"]
    assert (span["vehicles"], span["verdict"]) == (["a", "b"], "violated")
    assert (span["start_s"], span["end_s"]) == (pytest.approx(4.118, abs=0.011), pytest.approx(4.398, abs=0.011))
    assert span["seen"] == pytest.approx(0.2121, abs=5e-3)


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        (["--separation", "-1"], 2, "--separation"),
        (["--clearance", "3", "--separation", "1"], 2, "give the scenario"),
        ([], 2, "no separation is stated"),
        (["--separation", "1", "--acceleration", "3"], 2, "straight between samples"),
        (["--separation", "1", "--scenario", "none"], 3, "none"),
    ],
)
def test_what_cannot_be_proved_is_refused(
    crossing: list[str], capsys: pytest.CaptureFixture[str], line: list[str], code: int, words: str
) -> None:
    assert main.run([*crossing, *line]) == code
    assert words in capsys.readouterr().err


def test_a_broken_file_ends_with_6(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t,x,y,z\n0,0,0,ten\n")
    assert main.run(["prove", str(file), "--frame", "enu"]) == 6
    assert "a.csv, line 2: z must be a finite number, got 'ten'" in capsys.readouterr().err
