"""Sessions over real sockets with small vehicles made of the same machines."""

import asyncio
import socket
from contextlib import asynccontextmanager

import pytest

from gcs.autopilots.protocol_timers import CommandTimers, MissionTimers, ProtocolTimers
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, PeerTimeout
from gcs.link.endpoints.endpoint import UdpEndpoint
from gcs.link.protocols.command import CommandRefused, command_ack
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.session.linked_fleet import FrameDirection, LinkedFleet
from gcs.link.session.routing_table import DuplicateSystemId
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import GENERIC_AUTOPILOT, MavResult, MessageId, MissionResult
from gcs.mission.model import Home, MissionItem, VehicleMission
from tests.fleets import in_their_time

QUICK = ProtocolTimers(mission=MissionTimers(reply_s=0.2, item_s=0.1, retries=2, give_up_s=0.5))
PATIENT = ProtocolTimers(mission=MissionTimers(reply_s=1.0, item_s=1.0, retries=8, give_up_s=8.0))


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


PORT = free_port()
SPEC = f"udpin:127.0.0.1:{PORT}"
ITEMS = tuple(MissionItem(16, 3, (0.0, 2.0, 0.0, 0.0), 10 * n, -10 * n, 5.0) for n in range(1, 5))


class Vehicle:
    """Heartbeats, stores a mission, obeys or refuses commands."""

    def __init__(self, sysid, autopilot=GENERIC_AUTOPILOT):
        self.me = Station(sysid, 1)
        self.autopilot = autopilot
        self.codec = Codec(*self.me)
        self.exchange = Exchange(GROUND, me=self.me, timers=PATIENT, estimates=False)
        self.endpoint = UdpEndpoint(f"udpout:127.0.0.1:{PORT}")
        self.machine = None
        self.stored = ()
        self.mute = False
        self.swallow_ack = False
        self.spoil = lambda items: items
        self.refuses = None

    def say(self, *messages):
        for message in messages:
            if not (self.swallow_ack and message.name == "MISSION_ACK"):
                self.endpoint.send(self.codec.encode(message))

    def hear(self, data, _address):
        now_s = asyncio.get_running_loop().time()
        for message in self.codec.decode(data):
            if self.mute or not message.is_for(self.me):
                continue
            if message.name == "MISSION_COUNT":
                self.machine = MissionReceiver(self.exchange)
            elif message.name == "MISSION_ITEM_INT" and message.fields["seq"] == self.refuses:
                result = {"type": MissionResult.UNSUPPORTED, "mission_type": 0}
                self.say(Message("MISSION_ACK", {**GROUND.target, **result}))
                continue
            elif message.name == "MISSION_REQUEST_LIST":
                self.machine = MissionSender(self.stored, self.exchange)
                self.say(*self.machine.start(now_s))
                continue
            elif message.name == "COMMAND_LONG":
                refused = message.fields["command"] == 400
                if refused:
                    text = {"severity": 4, "text": "Arm: not today", "id": 0, "chunk_seq": 0}
                    self.say(command_ack(message, MavResult.FAILED), Message("STATUSTEXT", text))
                elif message.fields["command"] == 512:
                    self.say(command_ack(message, MavResult.ACCEPTED), Message("MISSION_CURRENT", {"seq": 7}))
                continue
            if self.machine is not None:
                self.say(*self.machine.receive(message, now_s))
                if isinstance(self.machine, MissionReceiver) and self.machine.done and not self.machine.error:
                    self.stored = self.spoil(self.machine.items)

    def beat(self):
        fields = {"type": 2, "autopilot": int(self.autopilot), "base_mode": 0x81, "custom_mode": 4}
        self.say(Message("HEARTBEAT", {**fields, "system_status": 4, "mavlink_version": 3}))


@asynccontextmanager
async def flying(*vehicles):
    async def beats():
        while True:
            for vehicle in vehicles:
                vehicle.beat()
            await asyncio.sleep(0.05)

    for vehicle in vehicles:
        await vehicle.endpoint.open(vehicle.hear)
    task = asyncio.ensure_future(beats())
    try:
        yield
    finally:
        task.cancel()
        for vehicle in vehicles:
            vehicle.endpoint.close()


def run(scene):
    in_their_time(scene, 30.0)


def mission(sysid):
    return VehicleMission(sysid, Home(47.0, 8.0, 500.0), ITEMS, (None,) * len(ITEMS))


def test_six_vehicles_on_one_port_are_found_and_loaded_at_once():
    async def scene():
        vehicles = [Vehicle(n, Autopilot.ARDUPILOT if n % 2 else Autopilot.PX4) for n in range(1, 7)]
        frames = []
        async with flying(*vehicles), LinkedFleet(SPEC, on_frame=lambda *a: frames.append(a)).open() as fleet:
            sessions = await fleet.vehicles(range(1, 7), 5.0)
            await asyncio.gather(*(s.upload_mission(mission(s.sysid)) for s in sessions.values()))
            assert all(s.armed and s.custom_mode == 4 for s in sessions.values())
            assert max(s.heartbeat_age_s() for s in sessions.values()) < 2.0
        for vehicle in vehicles:
            home = 1 if vehicle.autopilot == Autopilot.ARDUPILOT else 0
            assert vehicle.stored[home:] == ITEMS
            assert len(vehicle.stored) == len(ITEMS) + home
        assert {d for d, _ in frames} == {FrameDirection.IN, FrameDirection.OUT}
        assert all(len(Codec(1, 1).decode(frame)) == 1 for _, frame in frames)

    run(scene())


def test_a_vehicle_that_stores_something_else_is_found_out():
    async def scene():
        vehicle = Vehicle(1)
        vehicle.spoil = lambda items: (*items[:2], items[1], *items[3:])
        async with flying(vehicle), LinkedFleet(SPEC).open() as fleet:
            session = (await fleet.vehicles({1}, 5.0))[1]
            with pytest.raises(PeerError, match="item 2: latitude"):
                await session.upload_mission(mission(1))

    run(scene())


def test_a_refused_item_is_named():
    async def scene():
        vehicle = Vehicle(1)
        vehicle.refuses = 3
        async with flying(vehicle), LinkedFleet(SPEC).open() as fleet:
            session = (await fleet.vehicles({1}, 5.0))[1]
            with pytest.raises(MissionRefused, match="item 3"):
                await session.upload_mission(mission(1))
            assert session.heartbeat_age_s() < 2.0

    run(scene())


def test_a_lost_ack_is_made_good_by_reading_back():
    async def scene():
        vehicle = Vehicle(1)
        vehicle.swallow_ack = True
        async with flying(vehicle), LinkedFleet(SPEC, timers=QUICK).open() as fleet:
            session = (await fleet.vehicles({1}, 5.0))[1]
            await session.upload_mission(mission(1))
        assert vehicle.stored == ITEMS

    run(scene())


def test_commands_refusals_and_silence():
    async def scene():
        vehicle = Vehicle(3)
        quick = CommandTimers(reply_s=0.1, retries=1)
        async with flying(vehicle), LinkedFleet(SPEC).open() as fleet:
            session = (await fleet.vehicles({3}, 5.0))[3]
            current = await session.request_message(MessageId.MISSION_CURRENT)
            assert current.fields["seq"] == 7
            with pytest.raises(CommandRefused, match="not today"):
                await session.command(400, 1.0)
            with pytest.raises(PeerTimeout, match="vehicle 3"):
                await session.command(300, timers=quick)
            with pytest.raises(PeerTimeout, match="vehicle 3: its attitude"):
                await session.wait_for(lambda m: m.name == "ATTITUDE", 0.1, "its attitude")
            with pytest.raises(PeerTimeout, match="vehicles 4, 5"):
                await fleet.vehicles({3, 4, 5}, 0.3)

    run(scene())


def test_two_vehicles_with_one_id_are_refused():
    async def scene():
        async with flying(Vehicle(2), Vehicle(2)), LinkedFleet(SPEC).open() as fleet:
            with pytest.raises(DuplicateSystemId, match="system id 2"):
                await fleet.vehicles({2, 3}, 5.0)

    run(scene())


def test_another_component_at_another_address_is_no_second_vehicle():
    async def scene():
        vehicle, companion = Vehicle(2), Vehicle(2)
        companion.codec = Codec(2, 191)
        async with flying(vehicle), LinkedFleet(SPEC).open() as fleet:
            session = (await fleet.vehicles({2}, 5.0))[2]
            async with flying(companion):
                await asyncio.sleep(0.2)
            fleet.check()
            assert session.latest["HEARTBEAT"].compid == 1

    run(scene())


def test_a_vehicle_that_falls_silent_ends_the_upload():
    async def scene():
        vehicle = Vehicle(1)
        async with flying(vehicle), LinkedFleet(SPEC, timers=QUICK).open() as fleet:
            session = (await fleet.vehicles({1}, 5.0))[1]
            vehicle.mute = True
            with pytest.raises(PeerTimeout, match="first mission item"):
                await session.upload_mission(mission(1))
            vehicle.mute = False
            await session.upload_mission(mission(1))

    run(scene())
