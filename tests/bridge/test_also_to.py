"""`--also-to`: another ground station watches a flight, over real UDP, and can neither disturb nor slow it."""

from __future__ import annotations

import asyncio
import itertools
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.cli.main import run
from gcs.flight.execution.takeoff_landing import WATCHED_IDS
from gcs.link.endpoints.endpoint import UdpEndpoint
from gcs.link.session.connection import Connection, listeners
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, MessageId
from gcs.scenario.sources.load import load_scenario
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import free_port, running_fleet

SYSIDS = (1, 2, 3, 4, 5, 6)
SHOWN = ("HEARTBEAT", "GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD")


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """Another ground station's port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        sock.bind(("127.0.0.1", 0))
        sock.setblocking(False)
        yield sock


def name_of(listener: socket.socket) -> str:
    return f"udpout:127.0.0.1:{listener.getsockname()[1]}"


def datagrams(listener: socket.socket) -> Iterator[tuple[bytes, tuple[str, int]]]:
    while True:
        try:
            yield listener.recvfrom(65536)
        except BlockingIOError:
            return


def decoded(listener: socket.socket) -> list[mavlink.MAVLink_message]:
    """What arrived, as pymavlink reads it: every byte of it belongs to a frame."""
    parser, found = mavlink.MAVLink(None), []
    for data, _ in datagrams(listener):
        found += parser.parse_buffer(data) or []
    assert not [message for message in found if message.get_type() == "BAD_DATA"]
    return found


async def watched(
    fleet: World,
    port: int,
    also_to: tuple[str, ...],
    until: Callable[[], bool],
    sysids: tuple[int, ...],
    each_turn: Callable[[], None] = lambda: None,
) -> tuple[list[bytes], list[Message]]:
    """The frames that came from the vehicles of a flight, and what its first session heard."""
    frames: list[bytes] = []
    heard: list[Message] = []

    def note(direction: FrameDirection, frame: bytes) -> None:
        if direction is FrameDirection.IN:
            frames.append(frame)

    known = Connection((f"udpin:127.0.0.1:{port}",), also_to=also_to)
    async with known.open(note, vehicles=sysids) as linked:
        sessions = await linked.vehicles(sysids, 60.0)
        for session in sessions.values():
            session.subscribe(heard.append)
            for number in (MessageId.LOCAL_POSITION_NED, MessageId.ATTITUDE, *WATCHED_IDS):
                await session.set_message_interval(number, 10.0)
        async with asyncio.timeout(120.0):
            while not until():
                each_turn()
                await asyncio.sleep(0.01)
    return frames, heard


def test_every_frame_of_every_vehicle_arrives_and_pymavlink_reads_it(repo_root: Path, listener: socket.socket) -> None:
    scenario, port = load_scenario(repo_root / "missions" / "simulation1"), free_port()
    messages: list[mavlink.MAVLink_message] = []

    def all_seen() -> bool:
        messages.extend(decoded(listener))
        seen = {(m.get_srcSystem(), m.get_type()) for m in messages if getattr(m, "lat", 1)}
        return seen >= {(n, name) for n in SYSIDS for name in SHOWN}

    with running_fleet(scenario, WorldOptions((call(port),), speedup=10.0)) as fleet:
        frames, _ = asyncio.run(watched(fleet, port, (name_of(listener),), all_seen, SYSIDS))
    messages.extend(decoded(listener))
    assert {m.get_srcSystem() for m in messages} == set(SYSIDS)  # nothing that the ground station sent
    assert [bytes(m.get_msgbuf()) for m in messages] == frames  # byte for byte, in order
    places = [m for m in messages if m.get_type() == "GLOBAL_POSITION_INT" and m.lat]
    assert all(abs(m.lat / 1e7 - scenario.origin.lat_deg) < 0.01 for m in places)


def test_nothing_that_comes_back_reaches_a_vehicle(repo_root: Path, listener: socket.socket) -> None:
    """The watching station commands every vehicle to arm and to terminate its flight, from the first copy on."""
    scenario, port = load_scenario(repo_root / "missions" / "simulation1"), free_port()
    station, answered = mavlink.MAVLink(None, srcSystem=254, srcComponent=190), 0

    def answer() -> None:
        nonlocal answered
        for data, sender in datagrams(listener):
            for command in (MavCommand.COMPONENT_ARM_DISARM, MavCommand.NAV_LAND):
                order = station.command_long_encode(data[5], 1, command, 0, 1, 0, 0, 0, 0, 0, 0)
                listener.sendto(order.pack(station), sender)
                listener.sendto(b"\xff" * 400, sender)
                answered += 1

    with running_fleet(scenario, WorldOptions((call(port),), speedup=10.0)) as fleet:
        frames, heard = asyncio.run(watched(fleet, port, (name_of(listener),), lambda: answered > 400, SYSIDS, answer))
    acknowledged = {m.fields["command"] for m in heard if m.name == "COMMAND_ACK"}
    assert acknowledged <= {MavCommand.SET_MESSAGE_INTERVAL}
    assert frames
    assert not any(m.fields["base_mode"] & 128 for m in heard if m.name == "HEARTBEAT")


def test_a_listener_that_reads_nothing_or_is_not_there_costs_no_frame(repo_root: Path) -> None:
    scenario, port = load_scenario(repo_root / "missions" / "simulation1"), free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        deaf.bind(("127.0.0.1", 0))
        gone = f"udpout:127.0.0.1:{free_port()}"
        nowhere = "udpout:192.0.2.1:14550"  # an address that leads nowhere
        frames: list[bytes] = []
        with running_fleet(scenario, WorldOptions((call(port),), speedup=20.0)) as fleet:
            copies = (name_of(deaf), gone, nowhere)
            frames, heard = asyncio.run(watched(fleet, port, copies, lambda: fleet.t_s > 12.0, SYSIDS))
    numbers: dict[int, list[int]] = {}
    for frame in frames:
        numbers.setdefault(frame[5], []).append(frame[4])
    for sent in numbers.values():  # the sequence numbers of each vehicle have no gap
        assert all((later - before) % 256 == 1 for before, later in itertools.pairwise(sent))
    assert len(heard) > 1000


def test_a_copy_never_waits() -> None:
    """A socket whose buffer is full drops the frame and says so; it does not raise, and does not block."""

    async def lost() -> int:
        copy = UdpEndpoint(listeners(["udpout:127.0.0.1:9"], [])[0])
        await copy.open(None)
        assert copy._port is not None and not os.get_blocking(copy._port.file)
        copy.send(b"x" * 70_000)  # more than a datagram holds
        copy.close()
        return copy.lost

    assert asyncio.run(lost()) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--sim", "--also-to", "udpin:127.0.0.1:14550"), "cannot call a ground station"),
        (("--sim", "--also-to", "14550"), "does not name a link"),
        (("--link", "udpin:0.0.0.0:14550", "--also-to", "udpout:127.0.0.1:14550"), "the vehicles are on udpin"),
        (("--link", "udpin:127.0.0.1:14550", "--also-to", "udpout:localhost:14550"), "the vehicles are on udpin"),
    ],
)
def test_a_wrong_address_is_refused_before_anything_is_planned(
    arguments: tuple[str, ...], said: str, repo_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["fly", str(repo_root / "missions" / "simulation1"), *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error and "next: " in error


@pytest.mark.slow
def test_a_whole_flight_of_emulated_vehicles_is_watched(
    short_mission: Path, tmp_path: Path, listener: socket.socket, capsys: pytest.CaptureFixture[str]
) -> None:
    """`gcs fly --sim --also-to`: heartbeats and positions of every vehicle, armed and in the air."""
    messages: list[mavlink.MAVLink_message] = []
    over = threading.Event()

    def read() -> None:
        while not over.wait(0.01):
            messages.extend(decoded(listener))

    reader = threading.Thread(target=read)
    reader.start()
    try:
        options = ("--sim", "--speedup", "max", "--to", str(tmp_path), "--also-to", name_of(listener))
        assert run(["fly", str(short_mission), *options]) == 0, capsys.readouterr().err
    finally:
        over.set()
        reader.join()
    armed = {m.get_srcSystem() for m in messages if m.get_type() == "HEARTBEAT" and m.base_mode & 128}
    high = {m.get_srcSystem() for m in messages if m.get_type() == "GLOBAL_POSITION_INT" and m.relative_alt > 1500}
    assert armed == high == set(SYSIDS)


def test_an_unknown_host_is_said_before_a_simulator_is_started(
    hop_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flights = tmp_path / "flights"
    options = ("--sim", "--to", str(flights), "--also-to", "udpout:no-such-host.invalid:14550")
    assert run(["fly", str(hop_skein), *options]) == 7
    assert "frames cannot be copied to udpout:no-such-host.invalid:14550" in capsys.readouterr().err
    assert not list(flights.glob("*/simulator.log"))


def test_a_flight_that_is_taken_up_again_can_be_watched_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["attach", "--also-to", "udpin:127.0.0.1:14550"]) == 2
    assert "cannot call a ground station" in capsys.readouterr().err


def test_another_host_may_have_the_same_port() -> None:
    assert [spec.host for spec in listeners(["udpout:192.0.2.1:14550"], ["udpin:0.0.0.0:14550"])] == ["192.0.2.1"]
