"""One flight of a campaign without workers: a varied scenario, one that has no plan, and a flight that hangs."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.campaign.campaign_flight import CampaignPlan, KeepRule, fly_row, prepare
from gcs.campaign.records import INFRASTRUCTURE
from gcs.flight.contingency.choices import FlightMode, TimeKeeping
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.monitoring.progress import Watcher
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify

ROW = {"index": 3, "seed": 5}


@pytest.fixture(scope="module")
def shared(hop: Plan) -> CampaignPlan:
    return prepare(hop, verify(hop), TimeKeeping(FlightMode.STREAM, True), FlightOptions(), Watcher())


@pytest.mark.slow
def test_a_varied_scenario_is_planned_and_flown(shared: CampaignPlan, tmp_path: Path) -> None:
    mass_kg = shared.plan.scenario.vehicle.mass_kg
    plain, heavy = (
        fly_row(shared, ROW | more, KeepRule(), tmp_path).row for more in ({}, {"vehicle.mass_kg": 1.1 * mass_kg})
    )
    assert plain["outcome"] == heavy["outcome"] == "held", (plain, heavy)
    assert plain["separation_m"] != heavy["separation_m"]


def test_a_scenario_without_a_plan_is_an_outcome(shared: CampaignPlan) -> None:
    limit_N = shared.plan.scenario.limits.thrust_N[1]
    found = fly_row(shared, ROW | {"vehicle.mass_kg": limit_N}, KeepRule())
    assert found.row["outcome"] == "no plan"
    assert found.row["reason"]
    assert found.folder_zip is None


@pytest.mark.slow
def test_a_flight_that_hangs_is_a_failure_of_the_machine(shared: CampaignPlan) -> None:
    found = fly_row(shared, ROW, KeepRule(), limit_s=0.5)
    assert found.row["outcome"] == INFRASTRUCTURE
    assert found.row["reason"] == "it did not end within 0.5 s of wall time"
    assert found.row["took_s"] < 300.0
