"""A UDP socket on asyncio: one socket for many vehicles.

The socket is read until it is empty each time it becomes readable, up to 256 datagrams, so that timers get their turn.
The transport of asyncio reads one datagram per turn, which takes most of the time of a fleet at high speed-up.
"""

from __future__ import annotations

import asyncio
import errno
import socket

from gcs.errors import LinkError, ProtocolMisuse
from gcs.link.endpoints.base import Address, LinkMode, LinkSpec, Receive, parse_link_spec

_BUFFER_BYTES = 4 << 20
_PER_TURN = 256
_LARGEST = 65_536


class UdpEndpoint:
    """A listening socket (udpin), or one that calls a peer and then sends to the address that answered (udpout)."""

    def __init__(self, spec: LinkSpec | str) -> None:
        self.spec = parse_link_spec(spec) if isinstance(spec, str) else spec
        self._socket: socket.socket | None = None
        self._receive: Receive | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._peer: Address | None = None
        self.lost = 0  # datagrams that the operating system did not accept

    @property
    def local_address(self) -> Address:
        """The address this socket is bound to. Raises `ProtocolMisuse` before `open`."""
        if self._socket is None:
            raise ProtocolMisuse(f"{self.spec} is not open.")
        host, port = self._socket.getsockname()[:2]
        return host, port

    async def open(self, receive: Receive) -> None:
        """Start to receive; `receive` is called for every datagram. Raises `LinkError`."""
        if self._socket is not None:
            raise ProtocolMisuse(f"{self.spec} was opened twice.")
        self._loop = asyncio.get_running_loop()
        address = await self._resolve()
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                sock.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
            if self.spec.mode is LinkMode.LISTEN:
                sock.bind(address)
            else:
                sock.bind(("127.0.0.1" if address[0].startswith("127.") else "0.0.0.0", 0))
                self._peer = address
        except OSError as error:
            sock.close()
            raise _link_error(self.spec, error) from error
        self._socket, self._receive = sock, receive
        self._loop.add_reader(sock.fileno(), self._read)

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Send one datagram to `address`, or to the peer (udpout) if that is None. A full socket loses it."""
        target = address or self._peer
        if self._socket is None or target is None:
            raise ProtocolMisuse(f"{self.spec} cannot send: it is not open or has no peer.")
        try:
            self._socket.sendto(data, target)
        except (BlockingIOError, InterruptedError, ConnectionError):
            self.lost += 1
        except OSError as error:
            raise _link_error(self.spec, error) from error

    def close(self) -> None:
        """Release the port. A second call has no effect."""
        if self._socket is not None and self._loop is not None:
            self._loop.remove_reader(self._socket.fileno())
            self._socket.close()
            self._socket = None

    def _read(self) -> None:
        for _ in range(_PER_TURN):
            if self._socket is None or self._receive is None:
                return
            try:
                data, address = self._socket.recvfrom(_LARGEST)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:  # an earlier datagram reached a closed port: read on
                continue
            if self.spec.mode is LinkMode.CALL:
                self._peer = address
            self._receive(data, address)

    async def _resolve(self) -> Address:
        if self._loop is None:
            raise ProtocolMisuse(f"{self.spec} has no event loop.")
        try:
            found = await self._loop.getaddrinfo(*self.spec.address, family=socket.AF_INET)
        except OSError as error:
            raise LinkError(
                f"no host is named {self.spec.host!r}.", hint="check the name, or use an IPv4 address"
            ) from error
        host, port = found[0][4][:2]
        return str(host), int(port)


def _link_error(spec: LinkSpec, error: OSError) -> LinkError:
    host, port = spec.address
    if error.errno == errno.EADDRINUSE:
        return LinkError(
            f"UDP port {port} on {host} is in use by another program.",
            hint="close the other ground station, or choose another port",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return LinkError(f"{host} is not an address of this machine.", hint="listen on 127.0.0.1 or 0.0.0.0")
    if error.errno == errno.EACCES:
        return LinkError(f"UDP port {port} needs privileges.", hint="choose a port above 1023")
    return LinkError(f"the link {spec} failed: {error.strerror or error}.", hint="check host, port and network")
