"""A UDP port of vehicles that send to a ground station, or wait for one, and answer every station that sends frames.

A station that has been silent for _FORGET_S gets no more frames, except the configured one.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator, Sequence
from typing import Any

from gcs.errors import LinkError
from gcs.link.endpoints.ip_address import caller_host, host_port, plain_address, resolve_udp, socket_address
from sim_bridge.protocol.endpoints.address import Address, EndpointKind, EndpointSpec, is_loopback
from sim_bridge.protocol.endpoints.line import LARGEST, PER_TURN, PeerAddress, Source, Watch, datagrams

_BUFFER_BYTES = 1 << 20
_MOST_STATIONS = 16  # every sender of whole frames counts as a ground station, up to this number
_FORGET_S = 30.0


class UdpLine:
    """One socket; `row` is that of the vehicle, or 0 where all share it."""

    def __init__(self, spec: EndpointSpec, row: int, watch: Watch) -> None:
        """Open the port. Raises `LinkError` if it is taken, or the host does not exist."""
        self._watch = watch
        self._stations: dict[Any, float] = {}  # wall time of the last frame of each
        self._forget_at_s = math.inf
        calls = spec.kind is EndpointKind.UDP_OUT
        family, ground = resolve(spec) if calls else (socket.AF_INET6 if ":" in spec.host else socket.AF_INET, None)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                self._socket.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
            if ground is not None:
                self._call(family, ground)
            else:
                self._socket.bind(socket_address(spec.host, spec.port_of(row)))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{spec} cannot be opened: {error.strerror}.", hint="choose another port") from error
        except BaseException:
            self._socket.close()
            raise
        watch.add(self._socket.fileno(), self)
        self.place = PeerAddress(str(spec.kind), host_port(*plain_address(self._socket.getsockname())))

    def _call(self, family: socket.AddressFamily, ground: Address) -> None:
        """Send to `ground`. On this machine any program may answer; elsewhere only that address."""
        self._socket.bind((caller_host(family, ground[0]), 0))
        target = socket_address(*ground)
        if not is_loopback(ground[0]):
            self._socket.connect(target)
        self._stations[self._socket_key(target)] = math.inf

    def _socket_key(self, target: tuple[Any, ...]) -> tuple[Any, ...]:
        """An address as `recvfrom` reports it."""
        return (*target, 0, 0) if self._socket.family == socket.AF_INET6 and len(target) == 2 else target

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """Return datagrams and their senders."""
        for _ in range(PER_TURN):
            try:
                yield self._socket.recvfrom(LARGEST)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an earlier datagram reached a closed port; the next one may not
                continue

    def heard(self, source: Source, now_s: float) -> None:
        """Send to this address from now on."""
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
        if not self._stations:
            return
        for data in datagrams(frames):
            for station in self._stations:
                try:
                    self._socket.sendto(data, station)
                except OSError:
                    continue

    def close(self) -> None:
        """Close the port."""
        if self._socket.fileno() >= 0:
            self._watch.remove(self._socket.fileno())
            self._socket.close()


def resolve(spec: EndpointSpec) -> tuple[socket.AddressFamily, Address]:
    """Return the family and the address of the host. Raises `LinkError`."""
    try:
        return resolve_udp(spec.host, spec.port)
    except OSError as error:
        raise LinkError(f"the host {spec.host!r} is unknown.", hint="use an IP address") from error
