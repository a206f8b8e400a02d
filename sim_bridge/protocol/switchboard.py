"""The endpoints that vehicles send on (lines): each carries the bytes of one vehicle, or of all.

Nothing waits for a ground station that does not read: what does not fit is lost, whole frames at a time.
"""

import io
import math
import os
import selectors
import socket
import tty
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from gcs.errors import LinkError
from gcs.link.endpoints.addresses import Address, caller_host, host_port, plain_address, resolve_udp
from gcs.link.endpoints.lockstep_endpoint import ADDRESS, FROM_STATION, FROM_VEHICLES, Turns
from gcs.link.endpoints.ports import ByteStream, UdpPort
from sim_bridge.protocol.endpoint_address import EndpointKind, EndpointSpec, PeerAddress, is_loopback

DATAGRAM_BYTES = 1400  # several frames share a datagram, up to a size that networks do not fragment
_MOST_STATIONS = 16  # every sender of whole frames counts as a ground station, up to this number
_FORGET_S = 30.0
_BACKLOG_BYTES = 1 << 18  # of a TCP connection


class UdpLine:
    """A port of vehicles that call a ground station, or wait for one, and answer every station that sends frames.

    A station that has been silent for _FORGET_S gets no more frames, except the one that is called. On this machine
    any program may answer a call; elsewhere only the address that is called.
    """

    def __init__(self, spec: EndpointSpec, row: int, watch: selectors.BaseSelector) -> None:
        """Open the port of one vehicle, `row` 0 where all share it. Raises `LinkError`."""
        self._stations: dict[Address, float] = {}  # wall time of the last frame of each
        self._forget_at_s = math.inf
        family, address = resolve_udp(spec.host, spec.port_of(row))
        if spec.kind is EndpointKind.UDP_OUT:
            only = None if is_loopback(address[0]) else address
            self._port = UdpPort(family, (caller_host(family, address[0]), 0), spec, only=only)
            self._stations[address] = math.inf
        else:
            self._port = UdpPort(family, address, spec)
        watch.register(self._port.file, selectors.EVENT_READ, self)
        self.place = PeerAddress(str(spec.kind), host_port(*self._port.address))

    def receive(self, file: int) -> Iterator[tuple[bytes, Address]]:
        """Return datagrams and their senders."""
        return self._port.read()

    def heard(self, source: Address, now_s: float) -> None:
        """Record that `source` sent a whole frame: it is a ground station, and receives telemetry from now on."""
        if source in self._stations:
            self._stations[source] = max(self._stations[source], now_s)
        elif len(self._stations) < _MOST_STATIONS:
            self._stations[source] = now_s
            self._forget_at_s = min(self._forget_at_s, now_s + _FORGET_S)

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Send frames to every ground station."""
        if now_s > self._forget_at_s:
            self._stations = {s: at_s for s, at_s in self._stations.items() if now_s - at_s < _FORGET_S}
            self._forget_at_s = min(self._stations.values(), default=math.inf) + _FORGET_S
        if self._stations:
            for data in datagrams(frames):
                for station in self._stations:
                    self._port.send(data, station)

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class TcpLine:
    """A server for any number of ground stations. Each receives telemetry from the start."""

    def __init__(self, spec: EndpointSpec, row: int, watch: selectors.BaseSelector) -> None:
        """Listen, for one vehicle, `row` 0 where all share it. Raises `LinkError`."""
        self._watch = watch
        self._stations: dict[int, tuple[ByteStream, int]] = {}  # by file; the number tells it from earlier ones
        self._accepted = 0
        try:
            family = socket.AF_INET6 if ":" in spec.host else socket.AF_INET
            self._server = socket.create_server((spec.host, spec.port_of(row)), family=family)
        except OSError as error:
            raise LinkError(f"{spec} cannot be opened: {error.strerror}.", hint="choose another port") from error
        self._server.setblocking(False)
        watch.register(self._server.fileno(), selectors.EVENT_READ, self)
        self.place = PeerAddress(str(spec.kind), host_port(*plain_address(self._server.getsockname())))

    def receive(self, file: int) -> Iterator[tuple[bytes, Address]]:
        """Return the bytes of one connection; a new connection has none yet."""
        if file not in self._stations:
            self._accept()
            return
        stream, number = self._stations[file]
        data = stream.read()
        if data:
            yield data, ("connection", number)
        elif data is None:
            del self._stations[file]
            self._watch.unregister(file)
            stream.close()

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Send frames to every connection."""
        for stream, _ in self._stations.values():
            for frame in frames:
                stream.put(frame)
            stream.flush()

    def close(self) -> None:
        """Close all connections and the port."""
        for stream, _ in self._stations.values():
            stream.close()
        self._server.close()

    def _accept(self) -> None:
        try:
            sock, _ = self._server.accept()
        except OSError:
            return
        if len(self._stations) >= _MOST_STATIONS:
            sock.close()
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._accepted += 1
        self._stations[sock.fileno()] = ByteStream(sock, _BACKLOG_BYTES), self._accepted
        self._watch.register(sock.fileno(), selectors.EVENT_READ, self)


class PtyLine:
    """A terminal that any program can open like the device of a telemetry radio. Every baud rate works.

    As on a real line, the sender does not know if a program listens.
    """

    def __init__(self, spec: EndpointSpec, name: str, watch: selectors.BaseSelector) -> None:
        """Open the terminal; `name` is added to the path of the spec. Raises `LinkError`."""
        self._link: Path | None = None
        try:
            ours, self._theirs = os.openpty()
        except OSError as error:
            raise LinkError(f"no pseudo terminal is available: {error.strerror}.") from error
        tty.setraw(self._theirs)
        self._stream = ByteStream(io.FileIO(ours, "r+"), queue_bytes=0)
        watch.register(ours, selectors.EVENT_READ, self)
        device = os.ttyname(self._theirs)
        if spec.path:
            link = Path(spec.path + name)
            try:
                if link.is_symlink() and link.readlink().parent == Path(device).parent:
                    link.unlink()  # from an earlier run that was killed
                link.symlink_to(device)
            except OSError as error:
                self.close()
                raise LinkError(
                    f"the link {link} to {device} cannot be created: {error.strerror}.", hint="choose another path"
                ) from error
            self._link = link
        self.place = PeerAddress(str(spec.kind), str(self._link or device))

    def receive(self, file: int) -> Iterator[tuple[bytes, Address]]:
        """Return the bytes written into the terminal."""
        data = self._stream.read()
        if data:
            yield data, ("line", 0)

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Write frames; a frame that was begun is finished before the next."""
        for frame in frames:
            self._stream.put(frame)
            self._stream.flush()

    def close(self) -> None:
        """Close the terminal and remove its name."""
        self._stream.close()
        os.close(self._theirs)
        if self._link is not None:
            self._link.unlink(missing_ok=True)


class LockstepLine:
    """The vehicles' end of a `LockstepEndpoint`: frames wait for the end of a turn, which is that of a step."""

    def __init__(self, spec: EndpointSpec, watch: selectors.BaseSelector) -> None:
        """Take over the inherited file of the spec. Raises `LinkError`."""
        try:
            self._turns = Turns(socket.socket(fileno=spec.port), FROM_STATION)
        except OSError as error:
            raise LinkError(f"{spec} is not a socket of the program that started this: {error.strerror}.") from error
        self._watch = watch
        self._frames = bytearray()
        self._until_s = -math.inf  # simulated time up to which the station would wait
        self._due_s = deque([0.0])  # when the station's turns count that did not yet; the first turn is its own
        self._answers: deque[tuple[float, bytes]] = deque()
        watch.register(spec.port, selectors.EVENT_READ, self)
        self.place = PeerAddress(str(spec.kind), "")

    @property
    def ended(self) -> bool:
        """Whether the station has left the lockstep."""
        return self._turns.ended

    def waits(self, t_s: float) -> bool:
        """Whether a turn of the station that counts at simulated time `t_s` is not complete yet."""
        return len(self._due_s) > len(self._answers) and self._due_s[len(self._answers)] <= t_s

    def receive(self, file: int) -> Iterator[tuple[bytes, Address]]:
        """Read the station's turns, which count when they are `due`."""
        while (turn := self._turns.read()) is not None:
            (until_s,), frames = turn
            self._answers.append((until_s, frames))
        if self.ended:
            self._watch.unregister(file)
        return iter(())

    def due(self, t_s: float) -> Iterator[tuple[bytes, Address]]:
        """Return the frames that count at simulated time `t_s`."""
        while self._answers and self._due_s[0] <= t_s:
            self._due_s.popleft()
            self._until_s, frames = self._answers.popleft()
            if frames:
                yield frames, ADDRESS

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Keep frames for the end of the turn."""
        for frame in frames:
            self._frames += frame

    def end_turn(self, t_s: float, next_s: float, answer_s: float) -> None:
        """All is said at simulated time `t_s`, and nothing before `next_s`: the station's turn, which counts later."""
        if self._frames or self._due_s or next_s > self._until_s:
            self._turns.write(FROM_VEHICLES.pack(t_s, next_s, len(self._frames)) + self._frames)
            self._frames.clear()
            self._due_s.append(answer_s)

    def close(self) -> None:
        """Release the file."""
        self._turns.close()


Line = UdpLine | TcpLine | PtyLine | LockstepLine  # `receive` never waits and never raises


def datagrams(frames: Sequence[bytes]) -> Iterator[bytes]:
    """Return the frames packed into datagrams, never cut."""
    at = 0
    while at < len(frames):
        end, size = at, 0
        while end < len(frames) and (end == at or size + len(frames[end]) <= DATAGRAM_BYTES):
            size += len(frames[end])
            end += 1
        yield b"".join(frames[at:end])
        at = end


class Arrival(NamedTuple):
    """Bytes that arrived on line number `line`."""

    line: int
    data: bytes
    source: Address


class Switchboard:
    """Opens endpoints for vehicles with these system ids. `rows[line]` are the vehicles on a line."""

    def __init__(self, specs: Sequence[EndpointSpec], sysids: Sequence[int]) -> None:
        """Open all endpoints. Raises `LinkError` or `UsageError`, and then leaves none open."""
        self._watch = selectors.DefaultSelector()
        self._numbers: dict[Line, int] = {}
        self._lines: list[Line] = []
        self.rows: list[tuple[int, ...]] = []
        self._lines_of: list[list[int]] = [[] for _ in sysids]
        self._waiting: dict[int, list[bytes]] = {}
        self.lockstep: LockstepLine | None = None  # the line to the station that shares the vehicles' time
        all_rows = tuple(range(len(sysids)))
        try:
            for spec in specs:
                for rows in [all_rows] if spec.shared else [(row,) for row in all_rows]:
                    self._add(_open(spec, rows[0], "" if spec.shared else str(sysids[rows[0]]), self._watch), rows)
        except BaseException:
            self.close()
            raise

    def _add(self, line: Line, rows: tuple[int, ...]) -> None:
        number = len(self._lines)
        self._numbers[line] = number
        self._lines.append(line)
        if isinstance(line, LockstepLine):
            self.lockstep = line
        self.rows.append(rows)
        for row in rows:
            self._lines_of[row].append(number)

    def places(self, row: int) -> list[PeerAddress]:
        """Return the addresses of one vehicle."""
        return [self._lines[number].place for number in self._lines_of[row]]

    def watch(self, file: int) -> None:
        """Watch this file descriptor too; `receive` reports it as line -1."""
        self._watch.register(file, selectors.EVENT_READ, None)

    def receive(self, timeout_s: float, now_s: float) -> Iterator[Arrival]:
        """Return all that has arrived, waiting at most `timeout_s` for the first of it."""
        for key, _ in self._watch.select(timeout_s):
            if key.data is None:
                yield Arrival(-1, b"", ("", 0))
                continue
            number = self._numbers[key.data]
            for data, source in key.data.receive(key.fd):
                yield Arrival(number, data, source)
        if self.lockstep is not None:
            for data, source in self.lockstep.due(now_s):
                yield Arrival(self._numbers[self.lockstep], data, source)

    def heard(self, line: int, source: Address, now_s: float) -> None:
        """Record that `source` sent a whole frame; only a UDP port has to know."""
        if isinstance(known := self._lines[line], UdpLine):
            known.heard(source, now_s)

    def put(self, row: int, frames: Sequence[bytes]) -> None:
        """Queue frames of one vehicle on all its lines, for the next `flush`."""
        for number in self._lines_of[row]:
            self._waiting.setdefault(number, []).extend(frames)

    def flush(self, now_s: float) -> None:
        """Send the queued frames."""
        if self._waiting:
            for number, frames in self._waiting.items():
                self._lines[number].send(frames, now_s)
            self._waiting.clear()

    def close(self) -> None:
        """Close all lines."""
        for line in self._lines:
            line.close()
        self._lines.clear()
        self._watch.close()


def _open(spec: EndpointSpec, row: int, name: str, watch: selectors.BaseSelector) -> Line:
    if spec.kind is EndpointKind.PTY:
        return PtyLine(spec, name, watch)
    if spec.kind is EndpointKind.LOCKSTEP:
        return LockstepLine(spec, watch)
    return (TcpLine if spec.kind is EndpointKind.TCP_IN else UdpLine)(spec, row, watch)
