"""What the planner's process keeps for a flight: new plans with their zones, prepared returns, and what is flown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.recording.flight_folder import PLAN, read_flown_plan
from gcs.flight.setup.plan_worker import PlanWorker
from gcs.physics.states import POSITION
from gcs.plan.formation_orders import Avoid, FlyHome, GoOn, Hold, Slower
from gcs.plan.formation_return import plan_return
from gcs.plan.plan_file import save_plan
from gcs.plan.prepared_returns import PreparedReturn, PreparedReturns
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify

BEHIND = Avoid(0.0, -40.0, 3.0)  # beside the pads, on no way


@pytest.fixture(scope="module")
def home(hop: Plan) -> Plan:
    return plan_return(hop, 12.0)


@pytest.fixture
def folder(hop: Plan, home: Plan, tmp_path: Path) -> Path:
    rows = PreparedReturn(12.0, home, cpu_s=2.0), PreparedReturn(20.0, None, "no way")
    save_plan(hop, verify(hop), tmp_path / PLAN, PreparedReturns(rows))
    return tmp_path


def test_a_zone_counts_from_when_it_was_given_also_in_the_files_of_the_flight(hop: Plan, folder: Path) -> None:
    worker = PlanWorker(hop, folder)
    made = worker.change(BEHIND, 5.0, "plan-2", ((BEHIND.zone, 3.0),))
    assert made.file is not None
    made.file.rename(folder / "plan-2.skein")
    worker.adopt()
    flown = read_flown_plan(folder)
    assert flown.zones_since_s == (3.0,)
    inside = np.full((3, 1, 3), [BEHIND.north_m, BEHIND.east_m, -8.0])
    assert flown.zone_distances_m(np.array([3.5]), inside).max() < 0.0
    assert np.isinf(flown.zone_distances_m(np.array([2.5]), inside)).all()


def test_a_return_of_the_plan_file_is_begun_where_it_goes_on_from_what_is_flown(
    hop: Plan, home: Plan, folder: Path
) -> None:
    worker = PlanWorker(hop, None, folder / PLAN)
    found = worker.fly_home(FlyHome(), 4.0, 15.0, "plan-2")
    assert found is not None
    assert found.plan.content == home.content
    assert found.stream.t_s[0] == 12.0
    assert worker.fly_home(FlyHome(), 4.0, 5.0, "plan-2") is None, "it begins too late"
    assert worker.fly_home(FlyHome(), 12.1, 15.0, "plan-2") is None, "it begins too early"
    worker.change(Slower(0.6), 5.0, "plan-2")
    worker.adopt()
    assert worker.fly_home(FlyHome(), 6.0, 15.0, "plan-3") is None, "the formation is elsewhere by then"
    assert PlanWorker(hop, None, folder / "none.skein").fly_home(FlyHome(), 4.0, 15.0, "plan-2") is None


def test_a_prepared_return_keeps_out_of_zones_that_came_up(hop: Plan, home: Plan, folder: Path) -> None:
    worker = PlanWorker(hop, None, folder / PLAN)
    north_m, east_m, _ = home.states(np.array([home.landing_s - 12.0]))[:, 0, POSITION].mean(axis=0).tolist()
    in_the_way = Avoid(north_m, east_m, 3.0)
    assert worker.fly_home(FlyHome((in_the_way.zone,)), 4.0, 15.0, "plan-2") is None
    beside = worker.fly_home(FlyHome((BEHIND.zone,)), 4.0, 15.0, "plan-2", ((BEHIND.zone, 3.0),))
    assert beside is not None
    assert beside.plan.scenario.no_fly == (BEHIND.zone,)
    assert beside.plan.zones_since_s == (3.0,)
    # The flown plan does not know the zone, and the way home is planned round it.
    planned = worker.change(FlyHome((in_the_way.zone,)), 12.0, "plan-2").plan
    assert verify(planned).ok
    assert planned.scenario.no_fly == (in_the_way.zone,)


def test_a_process_that_takes_the_place_of_another_goes_on_from_what_is_flown(hop: Plan) -> None:
    first = PlanWorker(hop, None)
    held = first.change(Hold(), 6.0, "plan-2")
    first.adopt()
    second = PlanWorker(first._flown, None, None, held.proposal)
    second.adopt()  # asked of the process before
    goes_on = second.change(GoOn(), 20.0, "plan-3").plan
    assert goes_on.hash == first.change(GoOn(), 20.0, "plan-3").plan.hash
    np.testing.assert_allclose(goes_on.states(np.array([goes_on.landing_s - 0.1])), _end_of(hop), atol=1e-6)


def _end_of(plan: Plan) -> np.ndarray:
    return replace(plan).states(np.array([plan.landing_s - 0.1]))
