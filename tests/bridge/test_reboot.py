"""A vehicle restarts in the middle of an upload, and is afterwards what a real one would be."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from gcs.autopilots.protocol_timers import MissionTimers, ProtocolTimers
from gcs.errors import PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.link.wire.message import Message
from gcs.mavlink import CopterMode
from gcs.mission.model import Home, MissionItem, VehicleMission
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.personality import by_name
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import OFF_S, WorldOptions
from tests.fleets import free_port, running_fleet

SYSID, LOST = 2, 3
TIMERS = ProtocolTimers(mission=MissionTimers(reply_s=0.3, item_s=0.3, retries=3, give_up_s=1.5))
ITEMS = tuple(MissionItem(16, 3, (0.0, 2.0, 0.0, 0.0), 473977420 + 10 * n, 85455940, 5.0) for n in range(6))
PARAM = {"ardupilot": ("RTL_ALT", 2100.0, 6), "px4": ("RTL_RETURN_ALT", 21.0, 9)}


def mission(scenario: Scenario, items: tuple[MissionItem, ...]) -> VehicleMission:
    origin = scenario.origin
    home = Home(origin.lat_deg, origin.lon_deg, origin.alt_amsl_m)
    return VehicleMission(SYSID, home, items, (None,) * len(items))


def heights(items: tuple[MissionItem, ...]) -> list[float]:
    return [item.alt_m for item in items]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_restart_in_an_upload_keeps_what_was_stored(simulation1: Scenario, autopilot: str) -> None:
    port = free_port()
    old, new = ITEMS, tuple(replace(item, alt_m=9.0) for item in ITEMS[:5])
    faults = parse_faults([f"{SYSID}:reboot@upload:{LOST}"], [SYSID])
    options = WorldOptions(links=(call(port),), speedup=5.0, personality=by_name(autopilot))

    async def talk() -> None:
        async with Ground(f"udpin:127.0.0.1:{port}", timers=TIMERS).open() as ground:
            session = (await ground.vehicles([SYSID], 20.0))[SYSID]
            await session.upload_mission(mission(simulation1, old))
            name, value, kind = PARAM[autopilot]
            one = {"target_system": SYSID, "target_component": 1, "param_id": name}
            session.send(Message("PARAM_SET", {**one, "param_value": value, "param_type": kind}))
            await session.wait_for(lambda m: m.name == "PARAM_VALUE" and m.fields["param_id"] == name, 5.0, name)
            fleet.injector.add(1, faults[SYSID][0], fleet.t_s)
            before = fleet.vehicles[1]
            with pytest.raises(PeerTimeout):
                items = session.as_sent(new, mission(simulation1, new).home)
                await session.run(MissionSender(items, Exchange(session.station, timers=TIMERS, estimates=False)))
            restarted_s = fleet.vehicles[1].on_from_s
            assert fleet.vehicles[1] is not before
            assert fleet.vehicles[1].instruments.simulated_s(0) == pytest.approx(restarted_s, abs=1e-9)
            home_first = autopilot == "ardupilot"
            stored = heights(fleet.vehicles[1].autopilot.progress.items[home_first:])
            kept = LOST - home_first  # items are numbered from home on
            assert stored == ([9.0] * kept + [5.0] * (5 - kept) if home_first else [5.0] * 6)
            beat = await session.wait_for(lambda m: m.name == "HEARTBEAT", 10.0, "a sign of life")
            assert not beat.fields["base_mode"] & 128
            await session.upload_mission(mission(simulation1, new))  # and now it holds the whole
            session.send(Message("PARAM_REQUEST_READ", {**one, "param_index": -1}))
            told = await session.wait_for(lambda m: m.name == "PARAM_VALUE", 5.0, name)
            assert told.fields["param_value"] == value

    with running_fleet(simulation1, options) as fleet:
        asyncio.run(talk())


def test_a_restart_in_flight_stops_the_motors_and_the_clock_begins_anew(simulation1: Scenario) -> None:
    faults = parse_faults([f"{SYSID}:reboot@6"], [SYSID])
    options = WorldOptions(links=(call(free_port()),), faults=faults, record_truth=True)
    with running_fleet(simulation1, options, paused=True) as fleet:
        pilot = fleet.vehicles[1].autopilot
        pilot.set_mode(fleet.t_s, CopterMode.GUIDED)
        pilot.arm(fleet.t_s, fleet.airframes.estimate[1])
        pilot.take_off(fleet.t_s, 3.0)
        while not pilot.flying:
            fleet.step()
        taken_off_s = fleet.t_s
        while fleet.t_s < taken_off_s + 6.0:
            assert fleet.vehicles[1].autopilot is pilot
            fleet.step()
        fleet.step()
        fleet.step()
        vehicle = fleet.vehicles[1]
        assert vehicle.autopilot is not pilot
        assert not vehicle.autopilot.armed
        assert vehicle.autopilot.mode.number == CopterMode.STABILIZE
        quiet = [len(vehicle.step(fleet.t_s, 0.0, True)) for _ in range(3)]
        while fleet.t_s < taken_off_s + 6.0 + OFF_S + 0.1:
            fleet.step()
        assert quiet == [0, 0, 0]
        assert fleet.airframes.landed[1]
        assert fleet.airframes.rotors_radps[1].max() == 0.0
