"""The interface of all endpoints: one line carries the bytes of one vehicle, or of all."""

from __future__ import annotations

import selectors
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

Source = Hashable  # the sender of some bytes: an address, a connection
LARGEST = 65_536  # bytes read at once
PER_TURN = 64  # reads from one file before the next file's turn, so that no sender blocks the others
DATAGRAM_BYTES = 1400  # several frames share a datagram, up to a size that networks do not fragment


@dataclass(frozen=True)
class PeerAddress:
    """The address of a line, for people and programs: `udpin`, `127.0.0.1:14540`."""

    kind: str
    address: str

    @property
    def port(self) -> int:
        """The number of a UDP or TCP port; 0 for a terminal."""
        _, colon, port = self.address.rpartition(":")
        return int(port) if colon and port.isdecimal() else 0


class Line(Protocol):
    """One place where bytes arrive and leave."""

    @property
    def place(self) -> PeerAddress:
        """The address of the line."""

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """Return the bytes that wait at one of its files, and their senders. Never waits, never raises."""

    def heard(self, source: Source, now_s: float) -> None:
        """Record that `source` sent a whole frame: it is a ground station, and receives telemetry from now on."""

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Send frames to all ground stations. What cannot be sent at once is lost, whole frames at a time."""

    def close(self) -> None:
        """Close the line. A second call does nothing."""


class Watch:
    """The files that are watched for input, each with its line."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def add(self, file: int, line: Line | None) -> None:
        """Watch `file`. Without a line it only wakes the caller, which reads it itself."""
        self._selector.register(file, selectors.EVENT_READ, line)

    def remove(self, file: int) -> None:
        """Stop watching `file`, which is still open."""
        self._selector.unregister(file)

    def ready(self, timeout_s: float) -> list[tuple[int, Line | None]]:
        """Return the files with input, waiting at most `timeout_s` for the first one."""
        return [(key.fd, key.data) for key, _ in self._selector.select(timeout_s)]

    def close(self) -> None:
        """Stop watching all files."""
        self._selector.close()


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
