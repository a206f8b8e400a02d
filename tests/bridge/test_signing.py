"""Signing as an attacker meets it: a program without the key changes nothing, and learns nothing new."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest

from gcs.cli.main import run as gcs
from gcs.errors import PeerTimeout
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.link.wire.signing_keys import signing_with
from gcs.mavlink import MessageId
from gcs.mission.model import Home, MissionItem, VehicleMission
from sim_bridge.fleet import Fleet
from tests.fleets import in_their_time

KEY, OTHER_KEY = bytes(range(1, 33)), bytes(range(33, 65))
ITEMS = tuple(MissionItem(16, 3, (0.0,) * 4, 470000000 + n, 80000000, 10.0) for n in range(4))
MISSION = VehicleMission(1, Home(47.0, 8.0, 500.0), ITEMS, (None,) * len(ITEMS))
TARGET = {"target_system": 1, "target_component": 1}


def command(number: int, *params: float) -> Message:
    values = {f"param{n}": p for n, p in enumerate((*params, *(0.0,) * (7 - len(params))), start=1)}
    return Message("COMMAND_LONG", {**TARGET, "command": number, "confirmation": 0, **values})


WICKED = (
    Message("PARAM_SET", {**TARGET, "param_id": "RTL_ALT", "param_value": 7777.0, "param_type": 6}),
    command(176, 1.0, 9.0),  # mode LAND
    command(400, 1.0),  # arm
    Message("MISSION_CLEAR_ALL", {**TARGET, "mission_type": 0}),
    Message("MISSION_COUNT", {**TARGET, "count": 0, "mission_type": 0}),
    Message("SETUP_SIGNING", {**TARGET, "secret_key": [0] * 32, "initial_timestamp": 0}),
    Message("SETUP_SIGNING", {**TARGET, "secret_key": list(OTHER_KEY), "initial_timestamp": 2**47}),
)


def what_it_is(fleet: Fleet) -> tuple[object, ...]:
    """Everything that a stranger might want to change."""
    vehicle = fleet._world.vehicles[0]
    pilot = vehicle.autopilot
    return (
        vehicle._params["RTL_ALT"],
        pilot.mode.name,
        pilot.armed,
        vehicle.store.items(),
        vehicle._signing._key,
    )


@contextmanager
def stranger(fleet: Fleet) -> Iterator[Callable[[bytes], None]]:
    """Another program that reaches the vehicle's port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        yield lambda data: sock.sendto(data, fleet.address(1))


async def signed_session(fleet: Fleet, ground: Ground) -> VehicleSession:
    session = (await ground.vehicles([1], 10.0))[1]
    ticks = signing_with(KEY, 0.0).signature(0.0).ticks
    setup = {**TARGET, "secret_key": list(KEY), "initial_timestamp": ticks - 100_000}
    session.send(Message("SETUP_SIGNING", setup))
    await fleet.until(lambda: fleet._world.vehicles[0]._signing.on)
    return session


def opened(fleet: Fleet, key: bytes | None, **options: object):
    host, port = fleet.address(1)
    signing = signing_with(key, asyncio.get_running_loop().time())
    return Ground(f"udpout:{host}:{port}", signing=signing, **options).open()


@pytest.fixture
def fleet(make_fleet: Callable[..., Fleet]) -> Fleet:
    made = make_fleet(vehicles=1, speedup=5.0)
    made.wait_until(lambda: made.t_s > 6.0)
    return made


@contextmanager
def guarded(fleet: Fleet) -> Iterator[list[bytes]]:
    """The vehicle with our key and our mission; gives every frame that we had sent it."""
    recorded: list[bytes] = []

    async def scene() -> None:
        async with opened(fleet, None) as ground:
            await signed_session(fleet, ground)
        note = lambda way, frame: recorded.append(frame) if way is FrameDirection.OUT else None  # noqa: E731
        async with opened(fleet, KEY, on_frame=note) as ground:
            session = (await ground.vehicles([1], 10.0))[1]
            await session.upload_mission(MISSION)
            session.send(
                Message("PARAM_SET", {**TARGET, "param_id": "RTL_ALT", "param_value": 1234.0, "param_type": 6})
            )
            await session.wait_for(lambda m: m.name == "PARAM_VALUE", 5.0, "the parameter")
            session.send(
                Message("PARAM_SET", {**TARGET, "param_id": "RTL_ALT", "param_value": 2222.0, "param_type": 6})
            )
            await session.wait_for(lambda m: m.name == "PARAM_VALUE", 5.0, "the parameter")

    in_their_time(scene())
    before = what_it_is(fleet)
    assert before[0] == 2222.0
    yield recorded
    start_s = fleet.t_s
    fleet.wait_until(lambda: fleet.t_s > start_s + 2.0)
    assert what_it_is(fleet) == before


def test_unsigned_orders_change_nothing(fleet: Fleet) -> None:
    with guarded(fleet), stranger(fleet) as send:
        codec = Codec(*GROUND)
        for message in WICKED:
            send(codec.encode(message))


def test_orders_signed_with_another_key_change_nothing(fleet: Fleet) -> None:
    with guarded(fleet), stranger(fleet) as send:
        codec, signing = Codec(*GROUND), signing_with(OTHER_KEY, 0.0, 4e9)
        for message in WICKED:
            send(codec.encode(message, signing.signature(1.0)))


def test_what_we_said_ourselves_said_again_changes_nothing(fleet: Fleet) -> None:
    with guarded(fleet) as recorded, stranger(fleet) as send:
        assert len(recorded) > 5
        for frame in recorded:  # the first RTL_ALT among them
            send(frame)


def test_a_signature_does_not_cover_another_message(fleet: Fleet) -> None:
    with guarded(fleet) as recorded, stranger(fleet) as send:
        codec = Codec(*GROUND)
        signature = recorded[-1][-13:]
        for message in WICKED:
            frame = bytearray(codec.encode(message, signing_with(OTHER_KEY, 0.0, 4e9).signature(1.0)))
            frame[-13:] = signature
            send(bytes(frame))


def test_a_foreign_station_changes_nothing(fleet: Fleet) -> None:
    with guarded(fleet), stranger(fleet) as send:
        for station in (Station(254, 190), Station(255, 191), Station(1, 1), Station(2, 1)):
            codec, signing = Codec(*station), signing_with(OTHER_KEY, 0.0, 4e9)
            for message in WICKED:
                send(codec.encode(message))
                send(codec.encode(message, signing.signature(1.0)))


def test_a_vehicle_that_does_not_sign_is_not_believed(fleet: Fleet) -> None:
    async def scene() -> None:
        async with opened(fleet, KEY) as ground:
            with pytest.raises(PeerTimeout, match="no heartbeat from vehicle 1"):
                await ground.vehicles([1], 1.5)
            assert ground.refused_frames > 0

    in_their_time(scene())


def test_whoever_plays_our_vehicle_is_not_believed(fleet: Fleet) -> None:
    """Another program claims to be vehicle 1: it is nearer, claims to be armed, in another mode, and refuses all."""

    async def scene() -> None:
        async with opened(fleet, None) as ground:
            await signed_session(fleet, ground)
        async with opened(fleet, KEY) as ground:
            session = (await ground.vehicles([1], 10.0))[1]
            codec = Codec(1, 1)
            beat = {"type": 2, "autopilot": 3, "base_mode": 0xFF, "custom_mode": 21, "system_status": 5}
            lies = (
                Message("HEARTBEAT", {**beat, "mavlink_version": 3}),
                Message("MISSION_ACK", {"target_system": 255, "target_component": 190, "type": 1, "mission_type": 0}),
            )
            _, port = ground.local_address
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:

                def lie() -> None:
                    signing = signing_with(OTHER_KEY, 0.0, 4e9)
                    for message in lies:
                        sock.sendto(codec.encode(message), ("127.0.0.1", port))
                        sock.sendto(codec.encode(message, signing.signature(1.0)), ("127.0.0.1", port))

                lie()
                await session.upload_mission(MISSION)
                lie()
                await asyncio.sleep(0.3)
            assert ground.refused_frames >= 8
            assert not session.armed
            assert session.custom_mode != 21
            ground.check()

    in_their_time(scene())


def test_what_a_vehicle_said_before_is_not_believed_again(fleet: Fleet) -> None:
    async def scene() -> None:
        async with opened(fleet, None) as ground:
            await signed_session(fleet, ground)
        heard: list[bytes] = []
        note = lambda way, frame: heard.append(frame) if way is FrameDirection.IN else None  # noqa: E731
        async with opened(fleet, KEY, on_frame=note) as ground:
            session = (await ground.vehicles([1], 10.0))[1]
            await session.request_message(MessageId.AUTOPILOT_VERSION)
            old = [f for f in heard if int.from_bytes(f[7:10], "little") == 0]
            refused = ground.refused_frames
            _, port = ground.local_address
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
                for frame in old:
                    sock.sendto(frame, ("127.0.0.1", port))
                await asyncio.sleep(0.3)
            assert ground.refused_frames >= refused + len(old) > refused
            ground.check()

    in_their_time(scene())


def test_commands_sign_with_a_key_from_the_environment_and_never_show_it(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scene() -> None:
        async with opened(fleet, None) as ground:
            await signed_session(fleet, ground)

    in_their_time(scene())
    host, port = fleet.address(1)
    line = ["vehicles", "--link", f"udpout:{host}:{port}", "--listen", "2"]
    monkeypatch.setenv("SKEIN_SIGNING_KEY", KEY.hex())
    assert gcs([*line, "--json"]) == 0
    shown = capsys.readouterr()
    monkeypatch.setenv("SKEIN_SIGNING_KEY", OTHER_KEY.hex())
    assert gcs(line) == 8
    wrong = capsys.readouterr()
    assert "frames were not signed with our key" in wrong.err
    for text in (shown.out, shown.err, wrong.out, wrong.err):
        assert KEY.hex() not in text
        assert OTHER_KEY.hex() not in text
    with suppress(KeyError):
        monkeypatch.delenv("SKEIN_SIGNING_KEY")
