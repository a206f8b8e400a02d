"""A UDP socket on asyncio: one socket for many vehicles.

The socket is read until it is empty each time it becomes readable, up to 256 datagrams and 64 KiB, so that timers get
their turn. The transport of asyncio reads one datagram per turn, which takes most of the time of a fleet at high
speed-up.
"""

from __future__ import annotations

import asyncio
import errno
import socket

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.base import LinkMode, LinkSpec, Receive, parse_link_spec
from gcs.link.endpoints.ip_address import Address, caller_host, plain_address, resolve_udp, socket_address

_BUFFER_BYTES = 4 << 20
_PER_TURN = 256  # datagrams
_BYTES_PER_TURN = 1 << 16
_LARGEST = 65_536


class UdpEndpoint:
    """A listening socket (udpin), or one that calls a peer (udpout).

    A caller sends to the port of the called host that answered last: routers answer from another one.
    """

    def __init__(self, spec: LinkSpec | str) -> None:
        self.spec = parse_link_spec(spec) if isinstance(spec, str) else spec
        self._socket: socket.socket | None = None
        self._receive: Receive | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._called: Address | None = None
        self._peer: Address | None = None
        self.lost = 0  # datagrams that the operating system did not accept

    @property
    def local_address(self) -> Address:
        """The address this socket is bound to. Raises `ProtocolMisuse` before `open`."""
        if self._socket is None:
            raise ProtocolMisuse(f"{self.spec} is not open.")
        return plain_address(self._socket.getsockname())

    async def open(self, receive: Receive) -> None:
        """Start to receive; `receive` is called for every datagram. Raises `LinkError`."""
        if self._socket is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        self._loop = asyncio.get_running_loop()
        family, address = await self._resolve()
        sock = socket.socket(family, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                sock.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
            if self.spec.mode is LinkMode.LISTEN:
                if family == socket.AF_INET6:  # IPv4 needs a link of its own, on every operating system
                    sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
                sock.bind(socket_address(*address))
            else:
                sock.bind((caller_host(family, address[0]), 0))
                self._peer = self._called = address
        except OSError as error:
            sock.close()
            raise _link_error(self.spec, error) from error
        self._socket, self._receive = sock, receive
        self._loop.add_reader(sock.fileno(), self._read)

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Send one datagram to `address`, or to the peer (udpout) if that is None.

        What the operating system does not accept is lost: a full socket, no route, an interface that is down.
        """
        target = address or self._peer
        if self._socket is None or target is None:
            raise ProtocolMisuse(f"{self.spec} cannot send: it is not open or has no peer.")
        try:
            self._socket.sendto(data, socket_address(*target))
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Release the port. A second call has no effect."""
        if self._socket is not None and self._loop is not None:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()
            self._socket = None

    def _read(self) -> None:
        left = _BYTES_PER_TURN
        for _ in range(_PER_TURN):
            if self._socket is None or self._receive is None or left <= 0:
                return
            try:
                data, sender = self._socket.recvfrom(_LARGEST)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an earlier datagram reached a closed port, or the interface went down: read on
                continue
            left -= len(data)
            address = plain_address(sender)
            if self._called is not None and address[0] == self._called[0]:
                self._peer = address
            self._receive(data, address)

    async def _resolve(self) -> tuple[socket.AddressFamily, Address]:
        if self._loop is None:
            raise ProtocolMisuse(f"{self.spec} has no event loop.")
        try:
            return await self._loop.run_in_executor(None, resolve_udp, *self.spec.address)
        except OSError as error:
            raise LinkError(
                f"no host is named {self.spec.host!r}.", hint="check the name, or use an IP address"
            ) from error


def _link_error(spec: LinkSpec, error: OSError) -> LinkError:
    host, port = spec.address
    here = "::1 or ::" if ":" in host else "127.0.0.1 or 0.0.0.0"
    if error.errno == errno.EADDRINUSE:
        return LinkError(
            f"UDP port {port} on {host} is in use by another program.",
            hint="close the other ground station, or choose another port",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return LinkError(f"{host} is not an address of this machine.", hint=f"listen on {here}")
    if error.errno == errno.EACCES:
        return LinkError(f"UDP port {port} needs privileges.", hint="choose a port above 1023")
    return LinkError(f"the link {spec} failed: {error.strerror or error}.", hint="check host, port and network")
