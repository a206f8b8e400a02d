"""All endpoints of a fleet: which vehicle is at which line, and what is to be sent where.

Knows: lines, rows of vehicles. Does not know: messages, what a vehicle is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from sim_bridge.protocol.endpoints.address import EndpointKind, EndpointSpec
from sim_bridge.protocol.endpoints.line import Line, PeerAddress, Source, Watch
from sim_bridge.protocol.endpoints.pty_line import PtyLine
from sim_bridge.protocol.endpoints.tcp_line import TcpLine
from sim_bridge.protocol.endpoints.udp_line import UdpLine


class Arrival(NamedTuple):
    """Bytes that came in on line number `line`."""

    line: int
    data: bytes
    source: Source


class Switchboard:
    """Opens endpoints for vehicles with these system ids. `rows[line]` are the vehicles at a line."""

    def __init__(self, specs: Sequence[EndpointSpec], sysids: Sequence[int]) -> None:
        """Open everything. Raises `LinkError` or `UsageError`, and leaves nothing open then."""
        self._watch = Watch()
        self._numbers: dict[int, int] = {}  # id of a line -> its number
        self._lines: list[Line] = []
        self.rows: list[tuple[int, ...]] = []
        self._lines_of: list[list[int]] = [[] for _ in sysids]
        self._waiting: dict[int, list[bytes]] = {}
        everyone = tuple(range(len(sysids)))
        try:
            for spec in specs:
                for rows in [everyone] if spec.shared else [(row,) for row in everyone]:
                    self._add(_open(spec, rows[0], "" if spec.shared else str(sysids[rows[0]]), self._watch), rows)
        except BaseException:
            self.close()
            raise

    def _add(self, line: Line, rows: tuple[int, ...]) -> None:
        number = len(self._lines)
        self._numbers[id(line)] = number
        self._lines.append(line)
        self.rows.append(rows)
        for row in rows:
            self._lines_of[row].append(number)

    def places(self, row: int) -> list[PeerAddress]:
        """Where one vehicle can be reached."""
        return [self._lines[number].place for number in self._lines_of[row]]

    def watch(self, file: int) -> None:
        """Wake up for this file descriptor too; `receive` tells of it as line -1."""
        self._watch.add(file, None)

    def receive(self, timeout_s: float, now_s: float) -> Iterator[Arrival]:
        """Everything that has come in, waiting for the first of it at most `timeout_s`."""
        for file, line in self._watch.ready(timeout_s):
            if line is None:
                yield Arrival(-1, b"", None)
                continue
            for data, source in line.receive(file, now_s):
                yield Arrival(self._numbers[id(line)], data, source)

    def heard(self, line: int, source: Source, now_s: float) -> None:
        """A whole frame came from there."""
        self._lines[line].heard(source, now_s)

    def put(self, row: int, frames: Sequence[bytes]) -> None:
        """Frames of one vehicle, to be sent on all its lines at the next `flush`."""
        for number in self._lines_of[row]:
            self._waiting.setdefault(number, []).extend(frames)

    def flush(self, now_s: float) -> None:
        """Send what was put."""
        if self._waiting:
            for number, frames in self._waiting.items():
                self._lines[number].send(frames, now_s)
            self._waiting.clear()

    def close(self) -> None:
        """Let everything go."""
        for line in self._lines:
            line.close()
        self._lines.clear()
        self._watch.close()


def _open(spec: EndpointSpec, row: int, name: str, watch: Watch) -> Line:
    match spec.kind:
        case EndpointKind.UDP_OUT | EndpointKind.UDP_IN:
            return UdpLine(spec, row, watch)
        case EndpointKind.TCP_IN:
            return TcpLine(spec, row, watch)
        case EndpointKind.PTY:
            return PtyLine(spec, name, watch)
