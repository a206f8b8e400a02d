"""The UDP endpoint on real sockets."""

import asyncio

import pytest

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.endpoint import UdpEndpoint


class Inbox:
    def __init__(self):
        self.got = []
        self.arrived = asyncio.Event()

    def __call__(self, data, address):
        self.got.append((data, address))
        self.arrived.set()

    async def have(self, count):
        async with asyncio.timeout(5):
            while len(self.got) < count:
                self.arrived.clear()
                await self.arrived.wait()
        return self.got


async def listening():
    """An endpoint on a port that was free a moment ago."""
    probe = asyncio.DatagramProtocol()
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(lambda: probe, local_addr=("127.0.0.1", 0))
    port = transport.get_extra_info("sockname")[1]
    transport.close()
    await asyncio.sleep(0)
    endpoint, inbox = UdpEndpoint(f"udpin:127.0.0.1:{port}"), Inbox()
    await endpoint.open(inbox)
    return endpoint, inbox, port


def test_each_caller_is_answered_at_its_own_address():
    async def scene():
        ground, heard, port = await listening()
        callers = [(UdpEndpoint(f"udpout:127.0.0.1:{port}"), Inbox()) for _ in range(3)]
        try:
            for n, (caller, inbox) in enumerate(callers):
                await caller.open(inbox)
                caller.send(b"I am %d" % n)
            for data, address in await heard.have(3):
                ground.send(b"you are " + data[-1:], address)
            for n, (_, inbox) in enumerate(callers):
                assert (await inbox.have(1))[0][0] == b"you are %d" % n
        finally:
            for caller, _ in callers:
                caller.close()
            ground.close()

    asyncio.run(scene())


def test_a_caller_follows_whoever_answers():
    async def scene():
        first, heard_first, port = await listening()
        second, heard_second, _ = await listening()
        caller, inbox = UdpEndpoint(f"udpout:127.0.0.1:{port}"), Inbox()
        await caller.open(inbox)
        try:
            caller.send(b"hello")
            ((_, address),) = await heard_first.have(1)
            second.send(b"me now", address)
            await inbox.have(1)
            caller.send(b"and you")
            assert (await heard_second.have(1))[0][0] == b"and you"
        finally:
            for endpoint in (first, second, caller):
                endpoint.close()

    asyncio.run(scene())


def test_a_burst_of_a_whole_fleet_is_not_lost():
    async def scene():
        ground, heard, port = await listening()
        caller = UdpEndpoint(f"udpout:127.0.0.1:{port}")
        await caller.open(Inbox())
        try:
            for n in range(1000):
                caller.send(n.to_bytes(2, "big") * 20)
            got = await heard.have(1000 - caller.lost)
            assert [d for d, _ in got] == sorted(d for d, _ in got)
        finally:
            caller.close()
            ground.close()

    asyncio.run(scene())


def test_a_port_in_use_is_one_sentence_with_a_next_step_and_is_free_after_close():
    async def scene():
        ground, _, port = await listening()
        rival = UdpEndpoint(f"udpin:127.0.0.1:{port}")
        with pytest.raises(LinkError) as caught:
            await rival.open(Inbox())
        assert str(port) in caught.value.message
        assert caught.value.hint
        ground.close()
        ground.close()
        await rival.open(Inbox())
        rival.close()

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("host", "word"), [("no-such-host.invalid", "no-such-host.invalid"), ("192.0.2.7", "192.0.2.7")]
)
def test_addresses_that_cannot_be_had(host, word):
    with pytest.raises(LinkError, match=word):
        asyncio.run(UdpEndpoint(f"udpin:{host}:14550").open(lambda *_: None))


def test_sending_on_a_closed_endpoint_is_our_own_mistake():
    with pytest.raises(ProtocolMisuse):
        UdpEndpoint("udpout:127.0.0.1:14550").send(b"x")


@pytest.mark.parametrize(
    ("spec", "target"),
    [
        ("udpin:127.0.0.1:0", ("203.0.113.7", 9)),  # not from a loopback address: EINVAL or ENETUNREACH
        ("udpin:127.0.0.1:0", ("255.255.255.255", 9)),  # EACCES, as by a firewall
        ("udpin:[::1]:0", ("fe80::7%no-such-interface", 9)),
    ],
)
def test_what_the_operating_system_refuses_is_a_lost_frame(spec, target):
    async def scene():
        endpoint = UdpEndpoint(spec)
        await endpoint.open(lambda *_: None)
        try:
            endpoint.send(b"setpoint", target)
            endpoint.send(b"x" * 70_000, endpoint.local_address)  # EMSGSIZE
            assert endpoint.lost == 2
        finally:
            endpoint.close()

    asyncio.run(scene())


def test_another_host_does_not_become_the_peer_of_a_caller():
    async def scene():
        ground, heard, port = await listening()
        caller, inbox = UdpEndpoint(f"udpout:127.0.0.1:{port}"), Inbox()
        await caller.open(inbox)
        stranger, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            asyncio.DatagramProtocol, local_addr=("127.0.0.9", 0)
        )
        try:
            stranger.sendto(b"it is me", caller.local_address)
            await inbox.have(1)
            caller.send(b"hello")
            assert (await heard.have(1))[0][0] == b"hello"
        finally:
            stranger.close()
            caller.close()
            ground.close()

    asyncio.run(scene())


def test_one_turn_reads_a_bounded_number_of_bytes():
    async def scene():
        ground, heard, port = await listening()
        caller = UdpEndpoint(f"udpout:127.0.0.1:{port}")
        await caller.open(lambda *_: None)
        try:
            for _ in range(6):
                caller.send(b"\xfe" * 30_000)
            ground._read()
            assert 1 <= len(heard.got) <= 3
            await heard.have(6)
        finally:
            caller.close()
            ground.close()

    asyncio.run(scene())
