"""Missions on board: once all vehicles hover, an early start replaces the one on board of all of them, or of none."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.progress import Step
from gcs.mavlink import MissionType
from gcs.mission.waypoints.mission_items import build_missions, starting_at
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from sim_bridge.sim.world import World
from tests.bridge.flying import Flown, fly, hop_scenario

LIMIT_S = 20.0
PROVISIONAL_S = 120.0  # after the upload: however slow the machine is, all hover long before
TAKEN_OFF_S = 18.0  # of emulated time: all are armed and climb


class Hovering:
    """Notes the fleet's time when all vehicles hover; a vehicle may refuse items from the take-off on."""

    def __init__(self, refusing: int | None = None) -> None:
        self.refusing = refusing
        self.from_s: float | None = None
        self.provisional_s: int | None = None

    def __call__(self, world: World, flight: FlightSequence) -> None:
        if flight.step is Step.TAKEOFF:
            assert flight._start is not None
            self.provisional_s = flight._start.unix_s
            if self.refusing is not None:
                world.vehicles[world.sysids.index(self.refusing)].store.rejects = True
        if flight.step is Step.FLY and self.from_s is None:
            self.from_s = flight.time.now_s()


@pytest.fixture(scope="module")
def six(repo_root: Path) -> Plan:
    """The hop of six vehicles in two rows."""
    data = hop_scenario(load_scenario(repo_root / "missions" / "field")).model_dump(mode="json")
    data["formation"]["vehicle"] = [
        {"sysid": n, "position_m": [-6.0 * ((n - 1) // 3), 6.0 * ((n - 1) % 3), 8.0]} for n in range(1, 7)
    ]
    return make_plan(Scenario.model_validate(data))


def started(flight: FlightSequence) -> bool:
    return flight.monitor.t0_unix_s is not None


def start_s(flown: Flown) -> float:
    assert flown.flight.monitor.t0_unix_s is not None
    return flown.flight.monitor.t0_unix_s + flown.flight.loads[0].mission.leaves_s


def all_wait_until(flown: Flown, unix_s: float) -> bool:
    """Whether the mission of every vehicle, as it truly is on board, waits for this second, and was verified so."""
    missions = build_missions(flown.plan, firmware=Autopilot.ARDUPILOT)
    wanted = [starting_at(mission, round(unix_s)).items[1].params for mission in missions]
    stores = [vehicle.store for vehicle in flown.world.vehicles]
    held = flown.flight.held
    assert held is not None
    assert held.digests == {load.sysid: load.digest(flown.plan.hash) for load in flown.flight.loads}
    assert [load.mission.items[1].params for load in flown.flight.loads] == wanted
    return [store.items(MissionType.MISSION)[2].params for store in stores] == wanted


@pytest.mark.slow
def test_six_missions_start_soon_after_the_last_vehicle_hovers(six: Plan) -> None:
    """A fifth of all messages is lost."""
    hovering = Hovering()
    flown = fly(
        six,
        f"all:loss=0.2@{TAKEN_OFF_S:g}",
        during=hovering,
        mode=FlightMode.MISSION,
        enough=started,
        start_after_takeoff_s=PROVISIONAL_S,
    )
    assert flown.error is None
    assert flown.stopped
    assert hovering.from_s is not None
    assert 0.0 < start_s(flown) - hovering.from_s <= LIMIT_S
    assert all_wait_until(flown, start_s(flown))
    assert "start their missions at" in str(flown.events[0])


@pytest.mark.long
def test_if_one_vehicle_refuses_the_new_start_all_keep_the_old_one(hop: Plan) -> None:
    hovering = Hovering(refusing=2)
    flown = fly(
        hop,
        during=hovering,
        mode=FlightMode.MISSION,
        enough=started,
        start_after_takeoff_s=PROVISIONAL_S,
    )
    assert flown.error is None
    assert start_s(flown) == hovering.provisional_s
    assert all_wait_until(flown, start_s(flown))
    assert "keep their start" in str(flown.events[0])
    assert "refused" in str(flown.events[0])
