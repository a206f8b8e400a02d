"""`report.md`: who reads it knows the conditions of the flight, can repeat it, and knows what every figure means."""

from __future__ import annotations

import json
from pathlib import Path

from gcs.flight.assessment.criterion import Criterion, CriterionName
from gcs.flight.assessment.judge import Verdict
from gcs.flight.monitoring.progress import FlightTimes
from gcs.flight.recording.flight_folder import TRUE_STATES, report_data
from gcs.flight.recording.flight_report import REPEAT, emulation_data, write_report
from gcs.flight.setup.simulator_process import Emulated
from gcs.scenario.schema.scenario import Scenario


def written(folder: Path, scenario: Scenario, *, wind: str | None, gusts: str | None, seed: int = 7) -> str:
    """The report of a flight of two vehicles."""
    criteria = (
        Criterion(CriterionName.POSITION_RMS, "m", 2.0523, 3.5, False, 5),
        Criterion(CriterionName.SEPARATION, "m", 6.267, 0.75, True, 1, 58.485, 2, 4.0),
    )
    verdict = Verdict(criteria, {1: 0.487, 5: 2.0523}, {1: 0.836, 5: 2.671}, 1.989)
    emulation = emulation_data(scenario, Emulated("max", seed, ("3:die@60",), wind, gusts))
    extra = {
        "judged": TRUE_STATES,
        "mode": "stream",
        "navigator": None,
        "skew_s": 0.0074,
        "emulation": emulation,
        "repeat": REPEAT,
    }
    write_report(folder, report_data("my", "c4adf29e0fd0", FlightTimes(0.0, 9.0, 99.0), verdict, extra), verdict)
    return (folder / "report.md").read_text()


def test_the_report_names_gusts_wind_seed_and_how_to_fly_it_again(tmp_path: Path, simulation1: Scenario) -> None:
    text = written(tmp_path, simulation1, wind="3@240", gusts="moderate")
    assert "| gusts | moderate: Dryden, standard deviation 1 m/s along and across the wind |" in text
    assert "| wind | 3 m/s from 240 degrees (the plan assumes: none) |" in text
    assert "| seed of noise and gusts | 7 |" in text
    assert "| sensors | rtk |" in text
    assert "| faults | 3:die@60 |" in text
    assert "the same to the last bit: `gcs refly .`" in text
    kept = json.loads((tmp_path / "report.json").read_text())["emulation"]
    assert (kept["gusts"], kept["gusts_mps"], kept["seed"], kept["wind"]) == ("moderate", 1.0, 7, "3@240")


def test_a_calm_flight_says_so(tmp_path: Path, simulation1: Scenario) -> None:
    text = written(tmp_path, simulation1, wind=None, gusts=None)
    assert "| gusts | none |" in text
    assert "| wind | none |" in text
    numbered = written(tmp_path, simulation1, wind=None, gusts="0.8")
    assert "| gusts | Dryden, standard deviation 0.8 m/s along and across the wind |" in numbered


def test_every_figure_is_defined_and_none_is_on_the_screen_only(tmp_path: Path, simulation1: Scenario) -> None:
    text = written(tmp_path, simulation1, wind=None, gusts="light")
    assert "| formation error | 1.989 m | – | – |" in text
    assert "| time skew (telemetry) | 7.4 ms | – | – |" in text
    for name in ("position error (RMS)", "separation", "formation error", "time skew"):
        assert f"- **{name}**: " in text
    assert "every 0.05 s from T0 to the planned arrival" in CriterionName.POSITION_RMS.definition
    assert "**clearance above ground**" not in text  # not a criterion of this flight
