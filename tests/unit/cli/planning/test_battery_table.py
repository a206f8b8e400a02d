"""What `gcs plan` says of the battery, and what would fit where it is too small."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.cli.planning.plan_tables import say_battery
from gcs.cli.shared.console import Screen
from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.energy import charge_needed
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from tests.unit.plan.problems import changed


def with_battery(plan: Plan, share: float) -> Plan:
    """The plan with a battery of which the flight uses this share."""
    power = plan.scenario.vehicle.power
    assert power is not None
    full_Wh = power.battery_Wh * float(charge_needed(plan).max()) / share
    table = power.model_dump() | {"battery_Wh": full_Wh}
    return replace(plan, scenario=changed(plan.scenario, vehicle={"power": table}))


def test_a_flight_that_fits_is_one_line(simulation1_plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    say_battery(Screen(), with_battery(simulation1_plan, 0.6))
    told = capsys.readouterr()
    assert told.out.startswith("battery: at most 60% used of ")
    assert told.out.count("\n") == 1


def test_one_that_does_not_fit_says_what_would(simulation1_plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    plan = with_battery(simulation1_plan, 1.25)
    say_battery(Screen(), plan)
    told = capsys.readouterr()
    assert "the flight needs 125% of a full battery, 75% may be used" in told.out
    # 60 % of the time from ground to ground, less what is not flight
    whole_s = plan.t_end_s - plan.t_start_s
    fits_s = 0.6 * whole_s - (whole_s - plan.flight_s)
    assert f"sorties of {math.floor(fits_s)} s" in told.out
    assert "flight_s" not in told.out  # 10.9 m/s in the mean
    (enough_Wh,) = map(float, re.findall(r"a battery of (\d+) Wh \(", told.out))
    power = plan.scenario.vehicle.power
    assert power is not None
    assert 0.0 <= enough_Wh - power.battery_Wh * 1.25 / 0.75 < 1.0


def test_no_vehicle_flies_a_plan_that_empties_its_battery(
    simulation1_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = with_battery(simulation1_plan, 1.25)
    save_plan(plan, verify(plan), path := tmp_path / "empty.skein")
    assert run(["fly", str(path), "--sim", "--unverified", "--to", str(tmp_path / "flights")]) == 5
    assert "battery at the last touch-down" in capsys.readouterr().err
    assert not (tmp_path / "flights").exists()
