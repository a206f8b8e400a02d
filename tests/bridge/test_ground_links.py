"""The ground station on every kind of link, several at once, and vehicles that are called something else there."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from gcs.errors import LinkError, PeerTimeout, UsageError
from gcs.link.endpoints.base import parse_link_spec
from gcs.link.endpoints.endpoint import UdpEndpoint
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.link.session.routing_table import DuplicateSystemId
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.mavlink import MessageId
from sim_bridge.fleet import Fleet
from tests.fleets import free_port, in_their_time

LINKS = {
    "udp": ("udpin:0", "udpout:{}"),
    "tcp": ("tcpin:0", "tcp:{}"),
    "serial": ("pty", "serial:{}:115200"),
    "udp6": ("udpin:[::1]:0", "udpout:{}"),
    "tcp6": ("tcpin:[::1]:0", "tcp:{}"),
}


def run(scene: Awaitable[None]) -> None:
    async def bounded() -> None:
        await asyncio.wait_for(scene, 30)

    in_their_time(bounded())


def spec_of(fleet: Fleet, sysid: int, form: str, link: int = 0) -> str:
    return form.format(fleet.places[sysid][link].address)


@pytest.mark.parametrize("kind", LINKS)
@pytest.mark.parametrize("one_port", [True, False], ids=["one for all", "one each"])
def test_every_kind_of_link_alone_and_repeated(make_fleet: Callable[..., Fleet], kind: str, one_port: bool) -> None:
    theirs, ours = LINKS[kind]
    fleet = make_fleet(vehicles=3, links=(theirs,), one_port=one_port, speedup=5.0)

    async def scene() -> None:
        specs = sorted({spec_of(fleet, sysid, ours) for sysid in fleet.sysids})
        assert len(specs) == (1 if one_port else 3)
        async with Ground(specs).open() as ground:
            sessions = await ground.vehicles(fleet.sysids, 10.0)
            for sysid, session in sessions.items():
                told = await session.request_message(MessageId.AUTOPILOT_VERSION)
                assert bytes(told.fields["uid2"])[11:14] == b"%03d" % sysid
                assert ground.where(sysid).startswith(ours.split(":", maxsplit=1)[0])

    run(scene())


def test_vehicles_that_call_an_ipv6_address_are_found_there(make_fleet: Callable[..., Fleet]) -> None:
    port = free_port()
    make_fleet(vehicles=2, links=(f"udpout:[::1]:{port}",))

    async def scene() -> None:
        async with Ground(f"udpin:[::1]:{port}").open() as ground:
            for session in (await ground.vehicles([1, 2], 10.0)).values():
                await session.request_message(MessageId.AUTOPILOT_VERSION)
            assert ground.where(1).startswith("udpin:[::1]:")
            assert ground.local_address == ("::1", port)

    run(scene())


def test_a_vehicle_on_two_links_is_one_vehicle(make_fleet: Callable[..., Fleet]) -> None:
    fleet = make_fleet(vehicles=1, links=("udpin:0", "tcpin:0"))

    async def scene() -> None:
        both = [spec_of(fleet, 1, "udpout:{}", 0), spec_of(fleet, 1, "tcp:{}", 1)]
        async with Ground(both).open() as ground:
            (session,) = (await ground.vehicles([1], 10.0)).values()
            await asyncio.sleep(2.5)  # longer than two addresses have to prove that they are one vehicle
            ground.check()
            await session.request_message(MessageId.AUTOPILOT_VERSION)

    run(scene())


def test_two_vehicles_with_one_id_on_two_links_are_refused(make_fleet: Callable[..., Fleet]) -> None:
    one, other = make_fleet(vehicles=1, seed=1), make_fleet(vehicles=1, seed=2)

    async def scene() -> None:
        async with Ground([spec_of(one, 1, "udpout:{}"), spec_of(other, 1, "udpout:{}")]).open() as ground:
            with pytest.raises(DuplicateSystemId, match="two vehicles claim system id 1"):
                await ground.vehicles([1], 10.0)
                await asyncio.sleep(1.0)  # one was heard before the other
                await ground.vehicles([1], 10.0)

    run(scene())


def test_vehicles_may_be_called_something_else_on_the_link(make_fleet: Callable[..., Fleet]) -> None:
    fleet = make_fleet(vehicles=3, one_port=True)

    async def scene() -> None:
        async with Ground(spec_of(fleet, 1, "udpout:{}")).open() as ground:
            sessions = await ground.vehicles([1, 2], 10.0, systems={1: 3, 2: 1})
            assert {sysid: s.station.sysid for sysid, s in sessions.items()} == {1: 3, 2: 1}
            assert [s.sysid for s in sessions.values()] == [1, 2]
            told = await sessions[1].request_message(MessageId.AUTOPILOT_VERSION)
            assert bytes(told.fields["uid2"])[11:14] == b"003"
            with pytest.raises(UsageError, match="vehicles 1 and 3 would both be system 3"):
                await ground.vehicles([1, 2, 3], 1.0, systems={1: 3, 2: 1})
            with pytest.raises(PeerTimeout, match=r"vehicle 2 \(system 9\)"):
                await ground.vehicles([2], 0.2, systems={2: 9})

    run(scene())


def test_answers_to_another_station_are_not_for_us() -> None:
    port = free_port()

    async def scene() -> None:
        codec, vehicle = Codec(1, 1), UdpEndpoint(f"udpout:127.0.0.1:{port}")
        beat = {"type": 2, "autopilot": 3, "base_mode": 0, "custom_mode": 0, "system_status": 3, "mavlink_version": 3}
        async with Ground(f"udpin:127.0.0.1:{port}").open() as ground:
            await vehicle.open(lambda data, address: None)
            vehicle.send(codec.encode(Message("HEARTBEAT", beat)))
            session = (await ground.vehicles([1], 5.0))[1]
            heard: list[Message] = []
            session.subscribe(heard.append)
            for system, component in ((254, 190), (255, 1), (255, 190), (255, 0), (0, 0)):
                ack = {"command": 400, "result": 0, "target_system": system, "target_component": component}
                vehicle.send(codec.encode(Message("COMMAND_ACK", {**ack, "progress": system % 250})))
            await session.wait_for(lambda m: m.fields.get("target_system") == 0, 5.0, "the last one")
            assert [m.fields["target_system"] for m in heard] == [255, 255, 0]
            vehicle.close()

    run(scene())


def test_what_cannot_be_opened_is_said() -> None:
    async def scene() -> None:
        port = free_port()
        with pytest.raises(LinkError, match=f"no TCP connection to 127.0.0.1:{port}"):
            async with Ground(f"tcp:127.0.0.1:{port}").open():
                pass
        with pytest.raises(LinkError, match="serial line /dev/nothing-there cannot be opened at 57600 baud: No such"):
            async with Ground("/dev/nothing-there").open():
                pass
        assert parse_link_spec("/dev/nothing-there").port == 57600
        with pytest.raises(LinkError) as caught:
            async with Ground("serial:/dev/nothing-there:fast").open():
                pass
        assert "the baud rate is the number after the last colon" in caught.value.hint

    run(scene())


def test_a_connection_that_breaks_is_made_again() -> None:
    async def scene() -> None:
        codec = Codec(1, 1)
        beat = {"type": 2, "autopilot": 3, "base_mode": 0, "custom_mode": 0, "system_status": 3, "mavlink_version": 3}
        writers: list[asyncio.StreamWriter] = []

        async def served(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writers.append(writer)
            writer.write(codec.encode(Message("HEARTBEAT", {**beat, "custom_mode": len(writers)})))

        server = await asyncio.start_server(served, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        async with server, Ground(f"tcp:127.0.0.1:{port}").open() as ground:
            session = (await ground.vehicles([1], 5.0))[1]
            assert session.custom_mode == 1
            writers[0].close()
            await session.wait_for(lambda m: m.name == "HEARTBEAT", 10.0, "the second connection")
            assert session.custom_mode == 2
            writers[1].close()

    run(scene())
