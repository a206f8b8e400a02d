"""The navigation error of a scenario, and the separation that a flight is judged by where the scenario gives none."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs.flight.assessment.criterion import Criterion, CriterionName
from gcs.flight.recording.flight_folder import limit_text
from gcs.frames import Origin
from gcs.mission.flight_limits import limits_of
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.template import scenario_text
from gcs.scenario.values.navigation_error import judged_separation_m, navigation_error, vehicle_size_m


def first(folder: Path, more: str = "", separation_m: float = 5.0) -> Scenario:
    """The scenario of `gcs new`, with tables of a user's own at its end."""
    file = folder / "first" / "scenario.toml"
    file.parent.mkdir()
    text = scenario_text(file.parent, Origin(47.39, 8.54, 0.0))
    file.write_text(text.replace("separation_min_m = 5.0", f"separation_min_m = {separation_m}") + more)
    return load_scenario(file)


def test_sensors_and_waypoints_add_as_squares(tmp_path: Path) -> None:
    scenario = first(tmp_path)
    assert scenario.sensors.grade == "gnss" and scenario.mission.tolerance_m == 0.5
    error = navigation_error(scenario)
    assert error.horizontal_m == pytest.approx(math.hypot(2.4, 0.5), abs=5e-3)
    assert error.vertical_m == pytest.approx(math.hypot(2.8, 0.5), abs=5e-3)
    assert error.of_two_m == pytest.approx(math.sqrt(2.0) * error.horizontal_m)


@pytest.mark.parametrize("grade", ["gnss", "rtk"])
def test_a_declared_wind_adds_nothing(grade: str, tmp_path: Path) -> None:
    """As measured: docs/verification.md has the figures."""
    sensors = f'\n[sensors]\ngrade = "{grade}"\n'
    (tmp_path / "calm").mkdir()
    calm = first(tmp_path / "calm", sensors)
    windy = first(tmp_path, f"{sensors}\n[wind]\nspeed_mps = 8.0\nfrom_deg = 240.0\n")
    assert windy.wind is not None and windy.wind.speed_mps == 8.0
    assert navigation_error(windy) == navigation_error(calm)


@pytest.mark.parametrize("grade", ["gnss", "rtk"])
def test_a_flight_is_judged_by_the_planned_separation_less_the_error_of_two(grade: str, tmp_path: Path) -> None:
    scenario = first(tmp_path, f'\n[sensors]\ngrade = "{grade}"\n', separation_m=9.0)
    error_m = math.sqrt(2.0) * math.hypot({"gnss": 2.4, "rtk": 0.05}[grade], 0.5)
    assert judged_separation_m(scenario) == pytest.approx(9.0 - error_m, abs=0.02)
    assert limits_of(scenario).separation_m == judged_separation_m(scenario)
    assert limits_of(scenario).planned_separation_m == 9.0


def test_no_vehicle_is_judged_by_less_than_its_size(tmp_path: Path) -> None:
    scenario = first(tmp_path, separation_m=3.0)
    assert vehicle_size_m(scenario.vehicle) == pytest.approx(0.754)
    assert judged_separation_m(scenario) == pytest.approx(0.75)


def test_a_given_limit_stays(tmp_path: Path) -> None:
    assert judged_separation_m(first(tmp_path, "\n[judge]\nseparation_min_m = 2.0\n")) == 2.0


def test_the_limit_of_the_plan_stands_beside_that_of_the_flight() -> None:
    criterion = Criterion(CriterionName.SEPARATION, "m", 4.0, 1.53, True, planned=5.0)
    assert limit_text(criterion) == "at least 1.53 m (plan: 5 m)"
    assert limit_text(Criterion(CriterionName.SEPARATION, "m", 4.0, 5.0, True, planned=5.0)) == "at least 5 m"
