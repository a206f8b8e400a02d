"""All endpoints of a fleet: which vehicle uses which line, and the frames to send on each."""

from __future__ import annotations

import selectors
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gcs.link.endpoints.ip_address import Address
from sim_bridge.protocol.endpoints.address import EndpointKind, EndpointSpec, PeerAddress
from sim_bridge.protocol.endpoints.lines import Line, PtyLine, TcpLine, UdpLine


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
    return (TcpLine if spec.kind is EndpointKind.TCP_IN else UdpLine)(spec, row, watch)
