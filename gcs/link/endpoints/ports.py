"""UDP ports and byte streams that never wait, under any event loop."""

import errno
import os
import socket
from collections.abc import Iterator
from typing import Protocol

from gcs.errors import LinkError
from gcs.link.endpoints.addresses import Address, plain_address, socket_address

BUFFER_BYTES = 4 << 20
_LARGEST = 65_536  # bytes read at once
_PER_TURN = 256  # datagrams, and as many bytes as one large read: timers and other files get their turn


class UdpPort:
    """A UDP socket that is bound to an address of this machine. What the operating system does not accept is `lost`.

    The loop of asyncio reads one datagram per turn, which takes most of the time of a fleet at high speed-up.
    """

    def __init__(
        self,
        family: socket.AddressFamily,
        here: Address,
        link: object,
        *,
        only: Address | None = None,
        receive_bytes: int = BUFFER_BYTES,
    ) -> None:
        """Bind to `here`; receive from `only` alone, if it is given. Raises `LinkError` that names the `link`."""
        self.lost = 0  # datagrams
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
            if family == socket.AF_INET6:  # IPv4 needs a link of its own, on every operating system
                self._socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            self._socket.bind(socket_address(*here))
            if only is not None:
                self._socket.connect(socket_address(*only))
        except OSError as error:
            self._socket.close()
            raise _link_error(link, here, error) from error

    @property
    def file(self) -> int:
        """The file descriptor; -1 after `close`."""
        return self._socket.fileno()

    @property
    def address(self) -> Address:
        """The address that the socket is bound to."""
        return plain_address(self._socket.getsockname())

    def read(self) -> Iterator[tuple[bytes, Address]]:
        """Return waiting datagrams and their senders, a limited number so that other links get their turn."""
        left = _LARGEST
        for _ in range(_PER_TURN):
            try:
                data, sender = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                return
            except OSError:  # an earlier datagram reached a closed port, or the interface went down: read on
                continue
            left -= len(data)
            yield data, plain_address(sender)
            if left <= 0:
                return

    def send(self, data: bytes, address: Address) -> None:
        """Send one datagram. It is lost if the socket is full, without a route, or the interface is down."""
        try:
            self._socket.sendto(data, socket_address(*address))
        except OSError:
            self.lost += 1

    def close(self) -> None:
        """Release the port. A second call has no effect."""
        self._socket.close()


class Handle(Protocol):
    """What a stream runs over: a socket, a serial port, a terminal."""

    def fileno(self) -> int:
        """The file descriptor."""

    def close(self) -> None:
        """Release it."""


class ByteStream:
    """A connection or a terminal. A frame that does not fit into its queue is lost as a whole: the rest is readable."""

    def __init__(self, handle: Handle, queue_bytes: int) -> None:
        """`queue_bytes` may wait besides the frame that was begun."""
        self.file = handle.fileno()
        os.set_blocking(self.file, False)
        self._handle = handle
        self._queue = bytearray()
        self._queue_bytes = queue_bytes

    def read(self) -> bytes | None:
        """Return what has arrived, at most 64 KiB so that others get their turn; None if the other end is gone."""
        try:
            return os.read(self.file, _LARGEST) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def put(self, frame: bytes) -> bool:
        """Queue a frame for the next `flush`. Return whether it fits."""
        fits = not self._queue or len(self._queue) + len(frame) <= self._queue_bytes
        if fits:
            self._queue += frame
        return fits

    def flush(self) -> bool:
        """Write what is queued. Return whether some of it must wait."""
        try:
            del self._queue[: os.write(self.file, self._queue)]
        except BlockingIOError:
            pass
        except OSError:  # the other end is gone, which `read` tells
            self._queue.clear()
        return bool(self._queue)

    def close(self) -> None:
        """Release the file."""
        self._handle.close()


def _link_error(link: object, here: Address, error: OSError) -> LinkError:
    host, port = here
    if error.errno == errno.EADDRINUSE:
        return LinkError(
            f"UDP port {port} on {host} is in use by another program.",
            hint="close the other program, for example a ground station, or choose another port",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        where = "::1 or ::" if ":" in host else "127.0.0.1 or 0.0.0.0"
        return LinkError(f"{host} is not an address of this machine.", hint=f"listen on {where}")
    if error.errno == errno.EACCES:
        return LinkError(f"UDP port {port} needs privileges.", hint="choose a port above 1023")
    return LinkError(f"the link {link} failed: {error.strerror or error}.", hint="check host, port and network")
