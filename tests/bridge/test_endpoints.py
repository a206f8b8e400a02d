"""Endpoints by themselves: bytes over real sockets and terminals, without vehicles."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.errors import LinkError, UsageError
from sim_bridge.protocol import switchboard
from sim_bridge.protocol.endpoint_address import CALL_GROUND, EndpointKind, EndpointSpec, is_loopback, parse_link
from sim_bridge.protocol.switchboard import DATAGRAM_BYTES, Arrival, Switchboard, datagrams

SYSIDS = (1, 2, 7)
PATIENCE_S = 60.0


@contextlib.contextmanager
def board(*specs: EndpointSpec) -> Iterator[Switchboard]:
    made = Switchboard(specs, SYSIDS)
    try:
        yield made
    finally:
        made.close()


@contextlib.contextmanager
def udp(port: int = 0) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", port))
        sock.settimeout(PATIENCE_S)
        yield sock


def where(made: Switchboard, row: int, line: int = 0) -> tuple[str, int]:
    host, _, port = made.places(row)[line].address.rpartition(":")
    return host, int(port)


def arrivals(made: Switchboard, count: int, now_s: float = 0.0) -> list[Arrival]:
    """The next so many chunks that bring bytes."""
    found: list[Arrival] = []
    for _ in range(1200):
        found += made.receive(0.05, now_s)
        if len(found) >= count:
            break
    return found


def connected(made: Switchboard, address: tuple[str, int]) -> socket.socket:
    sock = socket.create_connection(address, PATIENCE_S)
    assert list(made.receive(PATIENCE_S, 0.0)) == []  # it is let in, and brings nothing yet
    return sock


def send(made: Switchboard, row: int, *frames: bytes, now_s: float = 0.0) -> None:
    made.put(row, frames)
    made.flush(now_s)


# What people write


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("udpout:127.0.0.1:14550", CALL_GROUND),
        ("udpin:14540", EndpointSpec(EndpointKind.UDP_IN, "127.0.0.1", 14540)),
        ("tcpin:localhost:0", EndpointSpec(EndpointKind.TCP_IN, "localhost", 0)),
        ("udpout:ground.example:1", EndpointSpec(EndpointKind.UDP_OUT, "ground.example", 1)),
        ("pty", EndpointSpec(EndpointKind.PTY)),
        ("pty:/tmp/v", EndpointSpec(EndpointKind.PTY, path="/tmp/v")),
    ],
)
def test_links_by_name(text, spec):
    assert parse_link(text) == spec
    assert parse_link(text, shared=True).shared


@pytest.mark.parametrize("text", ["", "udp:1", "udpout:14550", "udpout:h:0", "udpin:65536", "tcpin:x", "udpin:1:2:x"])
def test_what_names_no_link_is_told_so(text):
    with pytest.raises(UsageError, match="does not name a link"):
        parse_link(text)


def test_nobody_outside_is_let_in_unasked():
    for text in ("udpin:0.0.0.0:14540", "tcpin:192.168.1.2:5760"):
        with pytest.raises(UsageError, match="let other machines command") as refused:
            parse_link(text)
        assert "--bind" in refused.value.hint
    assert parse_link("udpin:14540", bind="0.0.0.0").host == "0.0.0.0"
    assert parse_link("tcpin:192.168.1.2:5760", bind="192.168.1.2").host == "192.168.1.2"
    assert parse_link("tcpin:127.0.0.1:5760", bind="0.0.0.0").host == "127.0.0.1"
    with pytest.raises(UsageError):
        parse_link("tcpin:192.168.1.3:5760", bind="192.168.1.2")


def test_loopback_addresses():
    assert [is_loopback(h) for h in ("127.0.0.1", "127.9.9.9", "::1", "localhost")] == [True] * 4
    assert [is_loopback(h) for h in ("0.0.0.0", "10.0.0.1", "", "example.org")] == [False] * 4


def test_ports_one_by_one_and_no_further_than_there_are():
    assert [EndpointSpec(EndpointKind.UDP_IN, port=14540).port_of(row) for row in (0, 5)] == [14540, 14545]
    assert EndpointSpec(EndpointKind.UDP_IN, port=14540, shared=True).port_of(5) == 14540
    assert EndpointSpec(EndpointKind.TCP_IN).port_of(5) == 0
    with pytest.raises(UsageError, match="above 65535"):
        EndpointSpec(EndpointKind.TCP_IN, port=65_530).port_of(6)


def test_frames_share_datagrams_uncut():
    frames = [bytes([n]) * 280 for n in range(12)]
    packed = list(datagrams(frames))
    assert b"".join(packed) == b"".join(frames)
    assert all(len(data) <= DATAGRAM_BYTES and len(data) % 280 == 0 for data in packed)
    assert len(packed) == 3
    assert list(datagrams([b"x" * 5000])) == [b"x" * 5000]


# UDP


def test_vehicles_call_the_ground_each_from_its_own_port():
    with udp() as ground, board(EndpointSpec(EndpointKind.UDP_OUT, port=ground.getsockname()[1])) as made:
        for row in range(3):
            send(made, row, b"%d" % row, b"+")
        heard = dict(reversed(ground.recvfrom(100)) for _ in range(3))
        assert heard == {where(made, row): b"%d+" % row for row in range(3)}
        ground.sendto(b"two", where(made, 2))
        (arrival,) = arrivals(made, 1)
        assert made.rows[arrival.line] == (2,)
        assert (arrival.data, arrival.source) == (b"two", ground.getsockname())


def test_a_shared_port_is_one_port_for_all():
    with udp() as ground, board(EndpointSpec(EndpointKind.UDP_OUT, port=ground.getsockname()[1], shared=True)) as made:
        for row in range(3):
            made.put(row, [b"%d" % row])
        made.flush(0.0)
        data, sender = ground.recvfrom(100)
        assert data == b"012"
        assert {where(made, row) for row in range(3)} == {sender}
        ground.sendto(b"all", sender)
        (arrival,) = arrivals(made, 1)
        assert made.rows[arrival.line] == (0, 1, 2)


def test_who_speaks_is_answered_until_it_has_been_silent_for_long():
    with udp() as one, udp() as other, board(EndpointSpec(EndpointKind.UDP_IN)) as made:
        send(made, 0, b"nobody listens")
        for station, now_s in ((one, 100.0), (other, 125.0)):
            station.sendto(b"hello", where(made, 0))
            (arrival,) = arrivals(made, 1)
            made.heard(arrival.line, arrival.source, now_s)
        send(made, 0, b"both", now_s=126.0)
        assert one.recv(100) == other.recv(100) == b"both"
        send(made, 0, b"the later one", now_s=131.0)
        assert other.recv(100) == b"the later one"
        assert not select.select([one], [], [], 0.0)[0]


def test_the_ground_that_is_called_is_never_given_up():
    with udp() as ground, board(EndpointSpec(EndpointKind.UDP_OUT, port=ground.getsockname()[1])) as made:
        made.heard(0, ground.getsockname(), 1.0)
        made.heard(0, ("127.0.0.1", 9), 1.0)
        send(made, 0, b"still here", now_s=1000.0)
        assert ground.recv(100) == b"still here"


def test_a_ground_on_another_machine_is_the_only_one_that_is_heard(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(switchboard, "is_loopback", lambda host: False)
    with (
        udp() as ground,
        udp() as stranger,
        board(EndpointSpec(EndpointKind.UDP_OUT, port=ground.getsockname()[1])) as m,
    ):
        stranger.sendto(b"arm", where(m, 0))
        ground.sendto(b"hello", where(m, 0))
        assert [arrival.data for arrival in arrivals(m, 1)] == [b"hello"]
        send(m, 0, b"here")
        assert ground.recv(100) == b"here"


def test_a_flood_of_senders_does_not_become_a_flood_of_stations():
    with udp() as first, board(EndpointSpec(EndpointKind.UDP_IN)) as made:
        made.heard(0, first.getsockname(), 0.0)
        for n in range(500):
            made.heard(0, ("127.0.0.1", 1024 + n), 0.0)
        send(made, 0, b"x")
        assert first.recv(10) == b"x"
        assert len(made._lines[0]._stations) == 16


# TCP


def test_tcp_stations_come_and_go():
    with board(EndpointSpec(EndpointKind.TCP_IN)) as made:
        assert where(made, 0) != where(made, 1)
        with connected(made, where(made, 1)) as one, connected(made, where(made, 1)) as other:
            one.sendall(b"one")
            other.sendall(b"other")
            found = arrivals(made, 2)
            assert {a.data for a in found} == {b"one", b"other"}
            assert {made.rows[a.line] for a in found} == {(1,)}
            assert len({a.source for a in found}) == 2
            send(made, 1, b"to ", b"both")
            assert one.recv(100) == other.recv(100) == b"to both"
            one.close()
            assert list(made.receive(PATIENCE_S, 0.0)) == []
            send(made, 1, b"!")
            assert other.recv(100) == b"!"


def test_a_station_that_does_not_read_loses_whole_frames_only():
    with board(EndpointSpec(EndpointKind.TCP_IN)) as made, connected(made, where(made, 0)) as station:
        for n in range(60_000):
            send(made, 0, n.to_bytes(4, "big") * 25)
        got = bytearray()
        while len(got) % 100 or not got or select.select([station], [], [], 0.0)[0]:
            got += station.recv(1 << 20)
            made.put(0, [])
            made.flush(0.0)  # what waited for room goes out
        frames = [bytes(got[at : at + 100]) for at in range(0, len(got), 100)]
        numbers = [int.from_bytes(frame[:4], "big") for frame in frames]
        assert all(frame == frame[:4] * 25 for frame in frames)
        assert numbers == sorted(set(numbers))
        assert len(numbers) < 60_000


def test_more_than_sixteen_connections_are_turned_away():
    with board(EndpointSpec(EndpointKind.TCP_IN, shared=True)) as made, contextlib.ExitStack() as stack:
        for _ in range(16):
            stack.enter_context(connected(made, where(made, 0)))
        late = stack.enter_context(connected(made, where(made, 0)))
        late.settimeout(PATIENCE_S)
        assert late.recv(1) == b""


# Serial


def test_a_terminal_carries_every_byte_both_ways(tmp_path: Path):
    with board(EndpointSpec(EndpointKind.PTY, path=str(tmp_path / "vehicle"))) as made:
        assert [made.places(row)[0].address for row in range(3)] == [str(tmp_path / f"vehicle{n}") for n in SYSIDS]
        every = bytes(range(256))
        file = os.open(tmp_path / "vehicle7", os.O_RDWR | os.O_NOCTTY)
        try:
            tty.setraw(file)
            os.write(file, every)
            (arrival,) = arrivals(made, 1)
            assert (made.rows[arrival.line], arrival.data) == ((2,), every)
            send(made, 2, every)
            assert os.read(file, 1000) == every
        finally:
            os.close(file)
    assert list(tmp_path.iterdir()) == []


def test_a_terminal_that_nobody_reads_loses_whole_frames_only():
    with board(EndpointSpec(EndpointKind.PTY, shared=True)) as made:
        file = os.open(made.places(0)[0].address, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            got = bytearray()
            for n in range(3000):
                send(made, n % 3, n.to_bytes(2, "big") * 19)
                if n % 500 == 0:
                    with contextlib.suppress(BlockingIOError):
                        while chunk := os.read(file, 65536):
                            got += chunk
            whole = len(got) // 38 * 38
            frames = [bytes(got[at : at + 38]) for at in range(0, whole, 38)]
            assert all(frame == frame[:2] * 19 for frame in frames)
            assert 100 < len(frames) < 3000
        finally:
            os.close(file)


def test_a_name_left_behind_by_a_run_that_was_killed_is_taken_over(tmp_path: Path):
    (tmp_path / "v1").symlink_to("/dev/pts/100000")
    with board(EndpointSpec(EndpointKind.PTY, path=str(tmp_path / "v"))):
        assert (tmp_path / "v1").exists()


# Mistakes


def test_a_taken_port_or_name_is_told_and_nothing_stays_open(tmp_path: Path):
    with udp() as taken:
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=str(port)):
            Switchboard([EndpointSpec(EndpointKind.UDP_IN, port=port, shared=True)], SYSIDS)
    (tmp_path / "v1").touch()
    with pytest.raises(LinkError, match="v1"):
        Switchboard([EndpointSpec(EndpointKind.PTY, path=str(tmp_path / "v"))], SYSIDS)
    with pytest.raises(LinkError, match=r"no\.such\.host"):
        Switchboard([EndpointSpec(EndpointKind.UDP_OUT, "no.such.host.invalid", 1)], SYSIDS)
    assert [path.name for path in tmp_path.iterdir()] == ["v1"]
