"""Vehicles on a UDP port that call a ground station, or wait to be called, and talk to whoever talks to them.

Knows: one socket, the stations at its other end. Does not know: messages. A station that has been silent for long
is talked to no more, except the one that is called by name.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator, Sequence
from typing import Any

from gcs.errors import LinkError
from sim_bridge.protocol.endpoints.address import LOOPBACK, Address, EndpointKind, EndpointSpec, is_loopback
from sim_bridge.protocol.endpoints.line import LARGEST, PER_TURN, PeerAddress, Source, Watch, datagrams

_BUFFER_BYTES = 1 << 20
_MOST_STATIONS = 16  # senders of frames are believed to be stations, but not a flood of them
_FORGET_S = 30.0


class UdpLine:
    """One socket; `row` is the vehicle's, or 0 where all share it."""

    def __init__(self, spec: EndpointSpec, row: int, watch: Watch) -> None:
        """Take the port. Raises `LinkError` when it is taken, or the host does not exist."""
        self._watch = watch
        self._stations: dict[Any, float] = {}  # when each was last heard
        self._forget_at_s = math.inf
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                self._socket.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
            if spec.kind is EndpointKind.UDP_OUT:
                self._call(resolve(spec))
            else:
                self._socket.bind((spec.host, spec.port_of(row)))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{spec} cannot be had: {error.strerror}.", hint="name another port") from error
        except LinkError:
            self._socket.close()
            raise
        watch.add(self._socket.fileno(), self)
        host, port = self._socket.getsockname()[:2]
        self.place = PeerAddress(str(spec.kind), f"{host}:{port}")

    def _call(self, ground: Address) -> None:
        """Call `ground`. On this machine anybody may answer; from elsewhere only who was called."""
        local = is_loopback(ground[0])
        self._socket.bind((LOOPBACK if local else "", 0))
        if not local:
            self._socket.connect(ground)
        self._stations[ground] = math.inf

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """Datagrams and their senders."""
        for _ in range(PER_TURN):
            try:
                yield self._socket.recvfrom(LARGEST)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an earlier datagram met a closed port; the next one may not
                continue

    def heard(self, source: Source, now_s: float) -> None:
        """Talk to this address from now on."""
        if source in self._stations:
            self._stations[source] = max(self._stations[source], now_s)
        elif len(self._stations) < _MOST_STATIONS:
            self._stations[source] = now_s
            self._forget_at_s = min(self._forget_at_s, now_s + _FORGET_S)

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Send frames to every station."""
        if now_s > self._forget_at_s:
            self._stations = {s: at_s for s, at_s in self._stations.items() if now_s - at_s < _FORGET_S}
            self._forget_at_s = min(self._stations.values(), default=math.inf) + _FORGET_S
        if not self._stations:
            return
        for data in datagrams(frames):
            for station in self._stations:
                try:
                    self._socket.sendto(data, station)
                except OSError:
                    continue

    def close(self) -> None:
        """Let the port go."""
        if self._socket.fileno() >= 0:
            self._watch.remove(self._socket.fileno())
            self._socket.close()


def resolve(spec: EndpointSpec) -> Address:
    """The host's IPv4 address. Raises `LinkError`."""
    try:
        found = socket.getaddrinfo(spec.host, spec.port, family=socket.AF_INET, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise LinkError(f"there is no host named {spec.host!r}.", hint="use an IPv4 address") from error
    return str(found[0][4][0]), spec.port
