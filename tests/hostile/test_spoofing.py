"""A stranger claims the system id of a vehicle: an address changes only with proof, nobody takes over in silence."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.routing_table import SILENT_S
from gcs.link.session.unknown_systems import LinkNotice
from gcs.mavlink import MessageId
from tests.fleets import free_port
from tests.hostile.attacker import ARDUPILOT, Attacker
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments

LAND, PX4 = 9, 12
STOOD_S = 3.3


@contextmanager
def spoofed(stranger: Attacker, sysid: int, rate_hz: float) -> Iterator[None]:
    """The heartbeats and positions of one vehicle from the stranger's port, for as long as the block takes."""
    stop = threading.Event()

    def lie() -> None:
        while not stop.is_set():
            stranger.heartbeat(sysid, mode=LAND, armed=False)
            stranger.say("LOCAL_POSITION_NED", sysid, time_boot_ms=9, x=500.0, y=0.0, z=-1.0, vx=0.0, vy=0.0, vz=0.0)
            time.sleep(1.0 / rate_hz)

    thread = threading.Thread(target=lie, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def names(datagrams: list[bytes], stranger: Attacker) -> list[str]:
    """The messages that were sent to the stranger."""
    return [message.name for data in datagrams for message in stranger.codec.decode(data)]


@pytest.mark.slow
def test_a_vehicle_keeps_its_address_while_the_ground_station_stands_still(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    world, port = vehicles("ardupilot", speedup=3.0)
    with Attacker(port) as stranger, Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        with spoofed(stranger, 1, 1_000.0):
            time.sleep(0.5)
            ground.freeze(STOOD_S)
            ground.until("is claimed from")
            for _ in range(2):
                ground.until("flying")
        heard = names(stranger.heard(), stranger)
        done = ground.ended()
    assert done.code == 0, done.output
    assert set(heard) <= {"COMMAND_LONG"}, "it is asked who it is, nothing else"
    assert len(heard) < 200
    assert "vehicle 1 is claimed from 127.0.0.1:" in done.output
    assert "is at 127.0.0.1" not in done.output
    assert all_down(world)
    assert abs(world.airframes.truth[0, :2] - [60.0, 20.0]).max() < 1.0


@pytest.mark.slow
def test_who_claims_a_vehicle_before_it_is_heard_stops_the_flight_and_gets_nothing(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    port = free_port()
    with Attacker(port) as stranger, Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        with spoofed(stranger, 1, 100.0):
            while not (heard := stranger.heard()):  # until the ground station listens, and answers it
                time.sleep(0.1)
            world, _ = vehicles("ardupilot", port=port)
            done = ground.ended()
        said = names(heard + stranger.heard(), stranger)
    assert done.code != 0, done.output
    assert "two vehicles claim system id 1" in done.output
    assert set(said) <= {"HEARTBEAT", "COMMAND_LONG"}
    assert not any(vehicle.autopilot.armed for vehicle in world.vehicles)


def test_a_false_heartbeat_before_the_vehicle_is_heard_gives_way_to_the_vehicle(vehicles: MakeVehicles) -> None:
    port, told = free_port(), list[LinkNotice]()

    async def scene() -> None:
        async with LinkedFleet(f"udpin:127.0.0.1:{port}", only=(1, 2, 3), on_notice=told.append).open() as fleet:
            with Attacker(port) as stranger:
                stranger.heartbeat(1, mode=LAND, autopilot=PX4)
                finding = asyncio.ensure_future(fleet.vehicles((1, 2, 3), 30.0))
                await asyncio.sleep(0.5)
                assert not finding.done()
                await asyncio.to_thread(vehicles, "ardupilot", port=port)
                sessions = await finding
                assert f":{stranger.address[1]}" not in fleet.where(1)
            fleet.freeze()
            assert sessions[1].autopilot == ARDUPILOT, "nothing of the false heartbeat remains"
            await sessions[1].request_message(MessageId.AUTOPILOT_VERSION)

    asyncio.run(asyncio.wait_for(scene(), 60.0))
    assert [notice.system for notice in told] == [1]
    assert "no longer at" in told[0].text


@pytest.mark.long
def test_a_vehicle_that_restarts_at_another_port_proves_who_it_is(vehicles: MakeVehicles) -> None:
    told = list[LinkNotice]()
    world, port = vehicles("ardupilot")

    async def scene() -> None:
        async with LinkedFleet(f"udpin:127.0.0.1:{port}", only=(1, 2, 3), on_notice=told.append).open() as fleet:
            session = (await fleet.vehicles((1, 2, 3), 30.0))[1]
            fleet.freeze()
            before = fleet.where(1)
            world.stop()
            with Attacker(port) as stranger:
                while session.heartbeat_age_s() < SILENT_S + 1.0:  # it is asked who it is, and does not know
                    stranger.heartbeat(1, mode=LAND)
                    await asyncio.sleep(0.05)
                assert fleet.where(1) == before
                await asyncio.to_thread(vehicles, "ardupilot", port=port)
                await session.wait_for(lambda m: m.name == "HEARTBEAT", 20.0, "the restarted vehicle")
                assert session.custom_mode != LAND
                assert f":{stranger.address[1]}" not in fleet.where(1) != before

    asyncio.run(asyncio.wait_for(scene(), 60.0))
    moved = [notice.text for notice in told if notice.system == 1 and "no longer at" in notice.text]
    assert len(moved) == 1
    assert "it reports the same id" in moved[0]


@pytest.mark.long
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_every_vehicle_spoofed_from_the_first_second_of_the_flight(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str
) -> None:
    world, port = vehicles(autopilot, speedup=3.0)
    with Attacker(port) as stranger, Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("missions read back")
        with spoofed(stranger, 1, 300.0), spoofed(stranger, 2, 300.0), spoofed(stranger, 3, 300.0):
            ground.until("flying")
            for _ in range(3):
                ground.freeze(2.0)
                time.sleep(1.0)
            done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
