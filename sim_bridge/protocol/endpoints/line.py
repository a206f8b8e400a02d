"""The small interface of all endpoints: one place where bytes come and go, for one vehicle or for all.

Knows: what the switchboard asks of a line, how it is told which files to listen at, how frames share a datagram. Does
not know: sockets (each kind has a file of its own), messages.
"""

from __future__ import annotations

import selectors
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

Source = Hashable  # whoever sent some bytes: an address, a connection
LARGEST = 65_536  # bytes read at once
PER_TURN = 64  # reads from one file before the others have their turn: nobody floods a line for all
DATAGRAM_BYTES = 1400  # several frames share a datagram, as far as any network carries it whole


@dataclass(frozen=True)
class PeerAddress:
    """Where a line can be reached, for people and programs: `udpin`, `127.0.0.1:14540`."""

    kind: str
    address: str

    @property
    def port(self) -> int:
        """The number of a UDP or TCP port; 0 of a terminal."""
        _, colon, port = self.address.rpartition(":")
        return int(port) if colon and port.isdecimal() else 0


class Line(Protocol):
    """One place where bytes come and go."""

    @property
    def place(self) -> PeerAddress:
        """Where it is."""

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """What waits at one of its files, and from whom. Never waits, never raises."""

    def heard(self, source: Source, now_s: float) -> None:
        """A whole frame came from `source`: it is a station, and wants to hear the vehicles."""

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Give frames to all stations. What cannot be had at once is lost, whole frames at a time."""

    def close(self) -> None:
        """Let the place go. Harmless the second time."""


class Watch:
    """The files that are listened at, each with the line it belongs to."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def add(self, file: int, line: Line | None) -> None:
        """Wake up when `file` has something; without a line it is somebody else's, and only told."""
        self._selector.register(file, selectors.EVENT_READ, line)

    def remove(self, file: int) -> None:
        """Listen no more at `file`, which is still open."""
        self._selector.unregister(file)

    def ready(self, timeout_s: float) -> list[tuple[int, Line | None]]:
        """Files with something to read, waiting for the first one at most `timeout_s`."""
        return [(key.fd, key.data) for key, _ in self._selector.select(timeout_s)]

    def close(self) -> None:
        """Listen at nothing."""
        self._selector.close()


def datagrams(frames: Sequence[bytes]) -> Iterator[bytes]:
    """Frames packed together, never cut."""
    at = 0
    while at < len(frames):
        end, size = at, 0
        while end < len(frames) and (end == at or size + len(frames[end]) <= DATAGRAM_BYTES):
            size += len(frames[end])
            end += 1
        yield b"".join(frames[at:end])
        at = end
