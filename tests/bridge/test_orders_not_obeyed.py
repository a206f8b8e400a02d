"""Vehicles that do not do as ordered, or were taken from the ground station: none is left in the air, all is told.

Times in faults are seconds from take-off on; T0 is about 15 s after it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import FlightError, OrderError
from gcs.flight.execution.flight import FlightSequence
from gcs.mavlink import CopterMode
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from sim_bridge.sim.world import World
from tests.bridge.flying import Flown, fly, hop_scenario, step_aside, take_over
from tests.bridge.test_mishaps import came_home, flew_on

STICKS_US = (1500, 1500, 1000, 1500, 1500, 1500, 1500, 1500)
MOVED_US = (1500, 1320, 1600, 1500, 1500, 1500, 1500, 1500)


@pytest.fixture(scope="module")
def px4_hop(repo_root: Path) -> Plan:
    data = json.loads(hop_scenario(load_scenario(repo_root / "missions" / "field")).model_dump_json())
    data["mission"]["autopilot"] = "px4"
    return make_plan(Scenario.model_validate(data))


def all_are_down(flown: Flown) -> None:
    alive = [vehicle for vehicle in flown.world.vehicles if not vehicle.dead]
    assert flown.world.airframes.landed.all()
    assert not any(vehicle.autopilot.armed for vehicle in alive)


REFUSED = "refused MAV_CMD_DO_SET_MODE"
UNHEARD = "did not acknowledge MAV_CMD_DO_SET_MODE"


@pytest.mark.slow
def test_orders_in_a_crisis_that_are_refused_and_never_acknowledged(hop: Plan) -> None:
    """Vehicle 2 dies, the others are ordered to land; for a while vehicle 3 refuses, and vehicle 1 ignores it.

    The orders are repeated until they are carried out; the flight ends with its own exit code.
    """
    flown = fly(hop, "2:die@20", "3:refuse-commands@22..51", "1:ignore-commands@22..70")
    assert isinstance(flown.error, OrderError)
    assert flown.error.exit_code == 12
    assert "did not land when ordered" in flown.error.message
    assert "a repetition was carried out" in flown.error.message
    for sysid, reason in ((1, UNHEARD), (3, REFUSED)):
        failed = [event for event in flown.events if event.sysid == sysid and event.what == "did not land"]
        assert failed
        assert all(f"vehicle {sysid} {reason}" in event.rule for event in failed)
        assert f"(vehicle {sysid} {reason}" in flown.error.message
    assert flown.orders(1) == flown.orders(3) == ["land"]
    all_are_down(flown)


@pytest.mark.slow
def test_a_px4_in_the_failsafe_of_its_fence_is_brought_back(px4_hop: Plan) -> None:
    """It stops and holds outside, as recorded: a text every 2 s, "Failsafe activated", system_status 5."""
    status: set[int] = set()
    texts: list[str] = []

    def look(world: World, flight: FlightSequence) -> None:
        session = flight.sessions[3]
        if session.armed:
            status.add(int(session.latest["HEARTBEAT"].fields["system_status"]))
        texts[:] = [one.text.strip() for _, one in session.texts.kept]

    flown = fly(px4_hop, "3:push=-2,7@23..25.5", safety=True, during=look)
    assert isinstance(flown.error, FlightError)
    assert 5 in status
    assert "Geofence: approaching or outside geofence" in texts
    assert "Failsafe activated" in texts
    taken = next(event for event in flown.events if event.what == "failsafe took over")
    assert taken.rule == "now in HOLD, cause: fence"
    assert flown.orders(3)[0] == "return"
    assert "released" not in flown.orders(3)
    came_home(flown, 3)
    for sysid in (1, 2):
        flew_on(flown, sysid)
    all_are_down(flown)


@pytest.mark.long
def test_a_vehicle_that_a_pilot_took_over_is_watched_and_gets_no_order(hop: Plan) -> None:
    """The pilot chooses RTL, as a failsafe would: no sign of a failsafe, and the sticks move."""
    begun: list[bool] = []

    def pilot(world: World, flight: FlightSequence) -> None:
        t_s = flight.monitor.plan_time_s
        autopilot = world.vehicles[1].autopilot
        if not autopilot.channels_us:
            autopilot.channels_us = STICKS_US
        if not begun and t_s is not None and t_s >= 12.0:
            begun.append(True)
            autopilot.channels_us = MOVED_US
            take_over(world, 2, CopterMode.RTL)

    flown = fly(hop, during=pilot)
    assert isinstance(flown.error, FlightError)
    assert not isinstance(flown.error, OrderError)
    assert flown.happened(2)[0] == "pilot took over"
    assert flown.orders(2) == ["released"]
    assert "RC_CHANNELS" in flown.flight.sessions[2].latest
    assert flown.world.vehicles[1].autopilot.mode.number == CopterMode.RTL  # nobody ordered another mode
    assert np.linalg.norm(flown.places[1, -1] - flown.plan.pads_ned_m[1]) < 1.0
    all_are_down(flown)  # the flight waited for it


@pytest.mark.long
def test_progress_names_the_vehicle_that_a_pilot_still_flies_when_all_others_have_landed(field: Scenario) -> None:
    phases: list[str] = []

    def pilot(world: World, flight: FlightSequence) -> None:
        t_s, mode = flight.monitor.plan_time_s, world.vehicles[1].autopilot.mode.number
        if (now := flight.snapshot().phase) not in phases[-1:]:
            phases.append(now)
        if t_s is not None and t_s > 4.0 and mode == CopterMode.GUIDED:
            take_over(world, 2, CopterMode.LOITER)
        elif "pilot" in phases[-1]:
            take_over(world, 2, CopterMode.LAND)

    flown = fly(make_plan(step_aside(field)), during=pilot)
    assert "released" in flown.orders(2)
    assert phases[-4:-2] == ["landing", "vehicle 2 flown by a pilot"], phases
