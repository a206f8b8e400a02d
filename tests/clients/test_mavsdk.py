"""MAVSDK 4, a ground station that nobody here wrote, meets the emulated fleet."""

from __future__ import annotations

import asyncio

import mavsdk
import pytest
from mavsdk.plugins.mission_raw import MissionRaw

from gcs.autopilots.traits import Autopilot
from gcs.frames import ned_to_geodetic
from gcs.link.protocols.mission.item_messages import with_home
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.mission.model import Home, MissionItem, VehicleMission
from gcs.scenario.values import si
from gcs.scenario.values.si import local_origin
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import WorldOptions
from tests.clients.sdk import client, from_raw, to_raw
from tests.fleets import free_port, running_fleet


def missions(scenario) -> dict[int, VehicleMission]:
    """Take-off, two timed legs and a landing for every vehicle, different for each."""
    origin = local_origin(scenario)
    found = {}
    for sysid, pad in zip(si.sysids(scenario), si.pads_ned_m(scenario), strict=True):
        lat, lon, alt = map(float, ned_to_geodetic(pad, origin))
        north = round(lat * 1e7) + 1000 * sysid
        items = (
            MissionItem(22, 3, (0.0,) * 4, 0, 0, 3.0),
            MissionItem(178, 2, (1.0, 1.5 + 0.1 * sysid, -1.0, 0.0), 0, 0, 0.0),
            MissionItem(16, 3, (0.0,) * 4, north, round(lon * 1e7), 3.0 + 0.25 * sysid),
            MissionItem(93, 2, (2.0, -1.0, -1.0, -1.0), 0, 0, 0.0),
            MissionItem(16, 3, (0.0,) * 4, north, round(lon * 1e7) + 500, 4.0),
            MissionItem(21, 3, (0.0,) * 4, 0, 0, 0.0),
        )
        found[sysid] = VehicleMission(sysid, Home(lat, lon, alt), items, (None,) * len(items))
    return found


async def upload_all(port: int, wanted: dict[int, VehicleMission]) -> None:
    async with Ground(f"udpin:127.0.0.1:{port}").open() as ground:
        vehicles = await ground.vehicles(wanted, 20.0)
        await asyncio.gather(*(vehicles[sysid].upload_mission(wanted[sysid]) for sysid in wanted))


def test_mavsdk_finds_six_vehicles_and_reads_the_missions_they_were_sent(simulation1):
    port, wanted = free_port(), missions(simulation1)
    with running_fleet(simulation1, WorldOptions(links=(call(port),), speedup=5.0)):
        asyncio.run(upload_all(port, wanted))
        with client(f"udpin://127.0.0.1:{port}", 6) as systems:
            assert set(systems) == set(wanted)
            for sysid, system in systems.items():
                assert system.autopilot_type() == mavsdk.Autopilot.ARDUPILOT
                read_back = [from_raw(raw) for raw in MissionRaw(system).download_mission()]
                assert compare_missions(wanted[sysid].items, read_back[1:], autopilot=Autopilot.ARDUPILOT) == []


@pytest.mark.parametrize("sysid", [4])
def test_mavsdk_uploads_what_it_reads_back(simulation1, sysid):
    port, wanted = free_port(), missions(simulation1)[sysid]
    with (
        running_fleet(simulation1, WorldOptions(links=(call(port),), speedup=5.0)) as fleet,
        client(f"udpin://127.0.0.1:{port}", 6) as systems,
    ):
        plugin = MissionRaw(systems[sysid])
        sent = with_home(wanted.items, wanted.home)
        plugin.upload_mission([to_raw(seq, item) for seq, item in enumerate(sent)])
        read_back = [from_raw(raw) for raw in plugin.download_mission()]
        assert compare_missions(sent[1:], read_back[1:], autopilot=Autopilot.ARDUPILOT) == []
        assert len(fleet.vehicles[sysid - 1].autopilot.progress.items) == len(sent)
        plugin.clear_mission()
        assert fleet.vehicles[sysid - 1].autopilot.progress.items[1:] == ()  # MAVSDK leaves ArduPilot its home
