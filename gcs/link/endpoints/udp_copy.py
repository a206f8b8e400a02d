"""Copies frames to other ground stations, one way: nothing that comes back is read.

The socket never waits: what the operating system does not accept is lost, so a listener that is slow or gone costs a
flight nothing.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager

from gcs.errors import LinkError, ProtocolMisuse, UsageError
from gcs.link.endpoints.base import LinkMode, LinkSpec, parse_link_spec
from gcs.link.endpoints.ip_address import resolve_udp, socket_address

_SEND_BUFFER_BYTES = 1 << 20
_NO_RECEIVE_BUFFER = 1  # the operating system takes its least
_HERE = ("127.0.0.1", "::1", "localhost")
_EVERYWHERE = ("0.0.0.0", "::")


class UdpCopy:
    """A socket that sends to one address and reads nothing."""

    def __init__(self, spec: LinkSpec) -> None:
        """Raises `UsageError` for a link that cannot call."""
        if spec.mode is not LinkMode.CALL:
            raise UsageError(f"{spec} cannot call a ground station.", hint="write for example udpout:127.0.0.1:14550")
        self.spec = spec
        self.sent = 0
        self.lost = 0  # frames that the operating system did not accept
        self._socket: socket.socket | None = None
        self._target: tuple[str, int] | tuple[str, int, int, int] = ("", 0)

    async def open(self) -> None:
        """Find the host. Raises `LinkError`."""
        loop = asyncio.get_running_loop()
        try:
            family, address = await loop.run_in_executor(None, resolve_udp, *self.spec.address)
            self._target = socket_address(*address)
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except OSError as error:
            raise LinkError(
                f"frames cannot be copied to {self.spec}: {error.strerror or error}.",
                hint="check the host's name, or use an IP address",
            ) from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _NO_RECEIVE_BUFFER)

    def send(self, frame: bytes) -> None:
        """Send one frame; never waits, never raises for a network that fails."""
        if self._socket is None:
            raise ProtocolMisuse(f"the copy to {self.spec} is not open.")
        try:
            self._socket.sendto(frame, self._target)
            self.sent += 1
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Release the socket. A second call has no effect."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


@asynccontextmanager
async def copies_to(specs: Sequence[str], links: Sequence[str]) -> AsyncIterator[Callable[[bytes], None]]:
    """Yield the function that copies a frame to all these addresses. Raises `UsageError`, `LinkError`."""
    async with AsyncExitStack() as stack:
        copies = [UdpCopy(spec) for spec in listeners(specs, links)]
        for copy in copies:
            await copy.open()
            stack.callback(copy.close)

        def send(frame: bytes) -> None:
            for copy in copies:
                copy.send(frame)

        yield send


def listeners(specs: Sequence[str], links: Sequence[str]) -> tuple[LinkSpec, ...]:
    """Return the addresses of other ground stations.

    Raises `UsageError` for one that cannot be called, or that is a link to the vehicles: copies would come back.
    """
    found = tuple(UdpCopy(parse_link_spec(spec)).spec for spec in specs)
    for spec in found:
        for link in map(parse_link_spec, links):
            if link.mode in (LinkMode.LISTEN, LinkMode.CALL) and _meets(spec, link):
                raise UsageError(
                    f"frames cannot be copied to {spec}: the vehicles are on {link}.",
                    hint="have the other ground station listen on another port, and name that one",
                )
    return found


def _meets(spec: LinkSpec, link: LinkSpec) -> bool:
    if spec.port != link.port:
        return False
    one, other = ("127.0.0.1" if host in _HERE else host for host in (spec.host, link.host))
    return one == other or (link.mode is LinkMode.LISTEN and link.host in _EVERYWHERE and spec.host in _HERE)
