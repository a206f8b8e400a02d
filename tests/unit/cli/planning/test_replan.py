"""`gcs replan` goes on from where the leader is, and refuses what it cannot read."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcs.cli import main
from gcs.errors import OutOfTime
from gcs.plan import plan_file
from gcs.plan.plan_file import load_plan, save_plan
from gcs.plan.replanning import replanner
from gcs.plan.verification import verify as verification
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.util import long_work
from gcs.util.long_work import report
from tests.unit.plan.problems import meadow


def gcs(*arguments: object) -> int:
    return main.run([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def file(simulation1: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from gcs.plan.planner import make_plan

    plan = make_plan(meadow(simulation1, time={"flight_s": 30.0}))
    path = tmp_path_factory.mktemp("plans") / "meadow.skein"
    save_plan(plan, verify(plan), path)
    return path


def test_a_plan_goes_on_round_a_disk(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state, disk = "14,6,3.5,1.5,0.4,0", "24,9,2"
    assert gcs("replan", file, "--at", 8, "--state", state, "--disk", disk, "--picture", tmp_path / "map.png") == 0
    told = capsys.readouterr().out
    assert "from the air to the ground" in told
    assert "verified: yes" in told
    new, report = load_plan(file.with_name("meadow-at-8.skein"))
    assert report.ok
    assert new.leader_trajectory.state(8.0)[:6] == pytest.approx([14.0, 6.0, -3.5, 1.5, 0.4, 0.0])
    assert new.scenario.no_fly[0].radius_m == 2.0
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert gcs("fly", file.with_name("meadow-at-8.skein"), "--sim") == 2
    assert "begins in the air, at t = 8 s" in capsys.readouterr().err


@pytest.mark.parametrize("begun", ["load_plan", "Replanner", "verify"])
def test_a_time_limit_ends_it_with_a_sentence_whatever_it_is_doing(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, begun: str
) -> None:
    """Time passes when the work begins, not before."""
    module = {"load_plan": plan_file, "Replanner": replanner, "verify": verification}[begun]
    work, clock = getattr(module, begun), [0.0]
    monkeypatch.setattr(long_work, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def slow(*given: object, **more: object) -> object:
        clock[0] += 61.0
        report("looking at the clock")
        return work(*given, **more)

    monkeypatch.setattr(module, begun, slow)
    assert gcs("replan", file, "--at", 5, "--to", tmp_path / "new.skein", "--limit", 60) == OutOfTime.exit_code
    told = capsys.readouterr().err
    assert "nothing is written: the time limit has passed, while looking at the clock" in told
    assert "give more time (--limit)" in told
    assert not (tmp_path / "new.skein").exists()


def test_as_planned_and_as_json(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("replan", file, "--at", 5, "--out", tmp_path / "new.skein", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ok"]
    assert found["plan"] == str(tmp_path / "new.skein")
    assert found["at_s"] == 5.0
    assert sum(found["iterations"]) < 20


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--at", 5, "--state", "1,2"), 2, "'1,2' is not NORTH,EAST,HEIGHT"),
        (("--at", 5, "--state", "1,2,nan"), 2, "'1,2,nan' is not NORTH"),
        (("--at", 5, "--disk", "1,2,0"), 2, "the radius must be more than 0 m"),
        (("--at", 500), 2, "not within the mission"),
        (("--at", 5, "--state", "14,6,60"), 4, "violates height"),
    ],
)
def test_what_is_wrong_is_told(
    file: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[object, ...], code: int, words: str
) -> None:
    assert gcs("replan", file, *arguments) == code
    assert words in capsys.readouterr().err
