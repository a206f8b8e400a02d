"""One UDP socket per vehicle, all calling one ground station.

Knows: sockets, and where each vehicle's peer is. Does not know: messages. Each vehicle has a port of its own, as
vehicles have; it answers whoever spoke to it last, and calls the address it was given until somebody does.
"""

from __future__ import annotations

import selectors
import socket
from collections.abc import Iterator

from gcs.errors import LinkError

_BUFFER_BYTES = 1 << 20
_PER_TURN = 64  # datagrams of one vehicle before the others have their turn
_LARGEST = 65_536
_DATAGRAM = 1400  # bytes: several frames share one, as far as any network carries it whole

Address = tuple[str, int]


class Sockets:
    """Non-blocking sockets; index is the vehicle's row."""

    def __init__(self, vehicles: int, ground: Address) -> None:
        """Open a socket for each vehicle. Raises `LinkError` for a host that does not exist."""
        try:
            host = socket.getaddrinfo(*ground, family=socket.AF_INET, type=socket.SOCK_DGRAM)[0][4][0]
        except OSError as error:
            raise LinkError(f"there is no host named {ground[0]!r}.", hint="use an IPv4 address") from error
        loopback = str(host).startswith("127.")
        self._selector = selectors.DefaultSelector()
        self._sockets: list[socket.socket] = []
        self._peers: list[Address] = [(str(host), ground[1])] * vehicles
        for row in range(vehicles):
            sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._sockets.append(sock)
            sock.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                sock.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
            sock.bind(("127.0.0.1" if loopback else "0.0.0.0", 0))
            self._selector.register(sock, selectors.EVENT_READ, row)
        self.ports = [int(sock.getsockname()[1]) for sock in self._sockets]

    def watch(self, file: int) -> None:
        """Wake up for this file descriptor too; `receive` tells it as row -1."""
        self._selector.register(file, selectors.EVENT_READ, -1)

    def receive(self, timeout_s: float) -> Iterator[tuple[int, bytes, Address]]:
        """Datagrams as (row, bytes, sender), waiting for the first one at most `timeout_s`."""
        for key, _ in self._selector.select(timeout_s):
            if key.data < 0:
                yield -1, b"", ("", 0)
                continue
            for _ in range(_PER_TURN):
                try:
                    data, sender = self._sockets[key.data].recvfrom(_LARGEST)
                except (BlockingIOError, InterruptedError):
                    break
                except OSError:  # an earlier datagram met a closed port; the next one may not
                    continue
                yield key.data, data, sender

    def answer_at(self, row: int, peer: Address) -> None:
        """From now on the vehicle talks to `peer`."""
        self._peers[row] = peer

    def send(self, row: int, frames: list[bytes]) -> None:
        """Send frames, several to a datagram. What the network does not take is lost, as UDP may."""
        at = 0
        while at < len(frames):
            end, size = at, 0
            while end < len(frames) and (end == at or size + len(frames[end]) <= _DATAGRAM):
                size += len(frames[end])
                end += 1
            try:
                self._sockets[row].sendto(b"".join(frames[at:end]), self._peers[row])
            except OSError:
                return
            at = end

    def close(self) -> None:
        """Let all ports go."""
        self._selector.close()
        for sock in self._sockets:
            sock.close()
