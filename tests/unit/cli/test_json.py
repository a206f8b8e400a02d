"""`--json` prints one JSON object on stdout, and only warnings on stderr, for every command that runs quickly."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify

WARNINGS = re.compile(r"(WARNING: [^\n]+\n)*")


@pytest.fixture
def plan_file(simulation1_plan: Plan, tmp_path: Path) -> Path:
    """A plan in a file without a suffix."""
    path = tmp_path / "plan-of-today"
    save_plan(simulation1_plan, verify(simulation1_plan), path)
    return path


@pytest.mark.parametrize(
    ("line", "code", "key"),
    [
        ("new {out}/first", 0, "scenario"),
        ("show {plan} --picture {out}/map.png", 0, "pads"),
        ("show missions/simulation1", 0, "pads"),
        ("verify {plan}", 0, "checks"),
        ("plan {plan} --to {out}/copy.skein", 0, "hash"),
        ("export {plan} --to {out} --format plan --untimed", 0, "files"),
        ("check missions/simulation1/expected/uav1.plan --timing planned", 0, "findings"),
        ("vehicles --listen 0.05 --link udpin:127.0.0.1:0", 8, "error"),
        ("tell land --listen 0.05 --link udpin:127.0.0.1:0", 8, "error"),
        ("download --to {out} --listen 0.05 --link udpin:127.0.0.1:0", 8, "error"),
        ("fly {plan}", 2, "error"),
        ("replan {plan} --at -900", 2, "error"),
        ("verify README.md", 6, "error"),
        ("prove missions/simulation1/expected/uav1.setpoints --speed 20", 0, "checks"),
        ("replay {out}", 6, "error"),
        ("report {out}", 6, "error"),
        ("restore README.md", 6, "error"),
        ("attach {out}/none", 6, "error"),
        ("plan missions/none", 3, "error"),
    ],
)
def test_one_object_and_only_warnings(
    line: str,
    code: int,
    key: str,
    plan_file: Path,
    repo_root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(repo_root)
    (tmp_path / "out").mkdir()
    assert main.run([*line.format(plan=plan_file, out=tmp_path / "out").split(), "--json"]) == code
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert out.count("\n") == 1
    assert found["ok"] == (code == 0)
    assert key in found
    assert WARNINGS.fullmatch(err), err


def test_planning_is_silent_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main.run(["new", "first"]) == 0
    capsys.readouterr()
    assert main.run(["plan", "first", "--json"]) == 0
    out, err = capsys.readouterr()
    assert len(json.loads(out)["mesh"]) >= 2
    assert err == ""
