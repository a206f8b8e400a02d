"""Byte streams and the endpoints on them: what is lost, what waits, and what is opened again."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs.errors import LinkError
from gcs.link.endpoints import endpoint as endpoints
from gcs.link.endpoints.base import LinkMode, LinkSpec
from gcs.link.endpoints.endpoint import StreamEndpoint, make_endpoint
from gcs.link.endpoints.ports import ByteStream

FRAME = b"\xfd" * 1000


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    one, other = socket.socketpair()
    one.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    with one, other:
        yield one, other


def test_a_peer_that_does_not_read_loses_whole_frames_and_then_reads_on(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    stream = ByteStream(pair[0], queue_bytes=5000)
    kept = 0
    for _ in range(200):
        kept += stream.put(FRAME)
        waits = stream.flush()
    assert waits and 5 <= kept < 200
    read = 0
    while read < kept * len(FRAME):
        read += len(pair[1].recv(65536))
        waits = stream.flush()
    assert read == kept * len(FRAME)
    assert not waits and stream.put(FRAME)


def test_without_a_queue_a_frame_waits_for_the_one_that_was_begun(pair: tuple[socket.socket, socket.socket]) -> None:
    stream = ByteStream(pair[0], queue_bytes=0)
    assert stream.put(FRAME)
    assert not stream.put(b"x")
    assert not stream.flush()
    assert stream.put(b"x")


def test_nothing_to_read_is_not_the_end(pair: tuple[socket.socket, socket.socket]) -> None:
    stream = ByteStream(pair[0], queue_bytes=0)
    assert stream.read() == b""
    pair[1].send(b"frame")
    assert stream.read() == b"frame"
    pair[1].close()
    assert stream.read() is None
    assert stream.put(FRAME)
    assert not stream.flush(), "what the peer cannot have does not wait for ever"


def terminal(link: Path) -> int:
    """The vehicle's end of a serial line, which the ground station finds under this name."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    link.unlink(missing_ok=True)
    link.symlink_to(os.ttyname(theirs))
    os.close(theirs)
    return ours


def test_a_serial_line_that_was_unplugged_is_opened_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoints, "_REOPEN_S", 0.01)
    link = tmp_path / "radio"

    async def scene() -> None:
        heard: asyncio.Queue[bytes] = asyncio.Queue()
        radio = StreamEndpoint(LinkSpec(LinkMode.SERIAL, str(link), 57600))
        ours = terminal(link)
        await radio.open(lambda data, _: heard.put_nowait(data))
        radio.send(b"down")
        assert os.read(ours, 10) == b"down"
        while not radio.lost:
            radio.send(FRAME)  # until the line takes no more
        os.close(ours)
        while radio._stream is not None:
            await asyncio.sleep(0)
        radio.send(b"lost")
        assert radio.lost == 2
        ours = terminal(link)
        while radio._stream is None:
            await asyncio.sleep(0.01)
        os.write(ours, b"up")
        assert await heard.get() == b"up"
        radio.send(b"down again")
        assert os.read(ours, 20) == b"down again"
        stream = radio._stream
        await asyncio.sleep(0.05)
        assert radio._stream is stream, "a line that works is left alone"
        radio.close()
        radio.close()
        os.close(ours)

    asyncio.run(asyncio.wait_for(scene(), 10.0))


def test_a_serial_line_that_is_unplugged_while_it_is_opened_is_no_bug(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged(*_: object) -> None:
        raise termios.error(errno.EIO, "Input/output error")

    vehicle = terminal(tmp_path / "ttyUSB0")
    monkeypatch.setattr(termios, "tcflush", unplugged)
    endpoint = make_endpoint(f"serial:{tmp_path / 'ttyUSB0'}:57600")
    with pytest.raises(LinkError, match="cannot be opened at 57600 baud: Input/output error"):
        asyncio.run(endpoint.open(lambda *_: None))
    os.close(vehicle)


def test_a_connection_that_was_opened_again_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoints, "_REOPEN_S", 0.001)

    async def scene() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            ours = make_endpoint(f"tcp:127.0.0.1:{server.getsockname()[1]}")
            await ours.open(lambda *_: None)
            server.accept()[0].close()
            server.setblocking(False)
            loop = asyncio.get_running_loop()
            again, _ = await loop.sock_accept(server)
            with again, pytest.raises(TimeoutError):
                await asyncio.wait_for(loop.sock_accept(server), 0.03)
            ours.close()

    asyncio.run(asyncio.wait_for(scene(), 10.0))


def test_what_a_slow_peer_could_not_take_at_once_follows_without_another_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene() -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
            rows = [(socket.AF_INET, socket.SOCK_STREAM, 0, "", (host, port)) for host in ("127.0.0.9", "127.0.0.1")]
            loop, found = asyncio.get_running_loop(), asyncio.Future[list[object]]()
            found.set_result(rows)  # no program listens at the first address of this host
            monkeypatch.setattr(loop, "getaddrinfo", lambda *_, **__: found)
            ours = make_endpoint(f"tcp:host:{port}")
            await ours.open(lambda *_: None)
            theirs, address = server.accept()
            with theirs:
                assert ours.local_address == address
                theirs.setblocking(False)
                frames = 0
                while not ours.lost:
                    ours.send(FRAME)
                    frames += 1
                read = 0
                while read < (frames - 1) * len(FRAME):
                    read += len(await asyncio.get_running_loop().sock_recv(theirs, 65536))
                ours.close()
                assert await asyncio.get_running_loop().sock_recv(theirs, 1) == b""

    asyncio.run(asyncio.wait_for(scene(), 20.0))


def test_a_host_that_does_not_answer_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoints, "_CONNECT_S", 0.01)

    async def scene() -> None:
        async def never(*_: object) -> None:
            await asyncio.sleep(60.0)

        monkeypatch.setattr(asyncio.get_running_loop(), "sock_connect", never)
        with pytest.raises(LinkError, match=r"127\.0\.0\.1:9 did not answer within 0\.01 s"):
            await make_endpoint("tcp:127.0.0.1:9").open(lambda *_: None)

    asyncio.run(scene())
