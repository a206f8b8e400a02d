"""`gcs new-vehicle` as it is typed, and a flight of what it wrote."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.energy import charge_needed
from gcs.plan.verification.verify import verify
from gcs.scenario.sources.load import load_scenario

FIVE = ("--mass", "1.2", "--propeller", "5", "--battery", "4S 3300mAh")


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_small_vehicle_is_written_and_its_first_flight_plans(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new-vehicle", "five.toml", *FIVE, "--hover-throttle", "40%", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    low_min, high_min = said["hover_min"]
    assert 4.0 < low_min < high_min < 12.0
    assert run(["new", "plans/small", "--vehicle", "five.toml", "--count", "1", "--distance", "60"]) == 0
    assert 'vehicle_type = "../../five.toml"\n' in Path("plans/small/scenario.toml").read_text(encoding="utf-8")
    scenario = load_scenario(Path("plans/small"))
    assert (scenario.vehicle.name, scenario.vehicle.mass_kg) == ("five", 1.2)
    plan = make_plan(scenario)
    assert verify(plan).ok
    flight_min = (plan.t_end_s - plan.t_start_s) / 60.0
    assert flight_min / high_min < float(charge_needed(plan)[0]) < flight_min / low_min


def test_a_preset_may_be_named_and_a_missing_file_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new", "one", "--vehicle", "f150"]) == 0
    assert load_scenario(Path("one")).vehicle.mass_kg == 0.5
    assert run(["new", "two", "--vehicle", "five.toml"]) != 0
    assert "five.toml" in capsys.readouterr().err
    assert not Path("two").exists()


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (("--size", "100"), "propellers touch"),
        (("--hover-throttle", "90%"), "--hover-throttle 0.9: not from 0.1 to 0.75"),
        (("--battery", "big"), "--battery big: not a battery"),
        (("--mass", "1200"), "--mass 1200: not from 0.02 to 100 kg"),
        (("--autopilot", "inav"), "--autopilot inav: unknown value"),
    ],
)
def test_what_no_vehicle_has_is_refused(more: tuple[str, str], text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new-vehicle", "five.toml", *FIVE, *more]) != 0
    assert text in capsys.readouterr().err
    assert not Path("five.toml").exists()


def test_a_file_is_never_written_over(capsys: pytest.CaptureFixture[str]) -> None:
    Path("five.toml").write_text("mine", encoding="utf-8")
    assert run(["new-vehicle", "five.toml", *FIVE]) != 0
    assert "five.toml exists already" in capsys.readouterr().err
    assert Path("five.toml").read_text(encoding="utf-8") == "mine"
