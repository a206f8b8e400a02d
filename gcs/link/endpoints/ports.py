"""UDP ports and byte streams that never wait, under any event loop, and the addresses of IPv4 and IPv6."""

import errno
import os
import socket
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Protocol

from gcs.errors import LinkError

Address = tuple[str, int]  # host and port; of a serial line its device and baud rate

_LOOPBACK = {socket.AF_INET: "127.0.0.1", socket.AF_INET6: "::1"}
_ANY = {socket.AF_INET: "0.0.0.0", socket.AF_INET6: "::"}


def host_port(host: str, port: object) -> str:
    """Return `HOST:PORT`, or `[HOST]:PORT` for an IPv6 host."""
    return f"[{host}]:{port}" if ":" in host and not host.startswith("/") else f"{host}:{port}"


def split_host_port(text: str) -> tuple[str, str] | None:
    """Return the host, without brackets, and the text of the port; None if the form is neither of `host_port`'s."""
    host, colon, port = text.rpartition(":")
    if host.startswith("[") and host.endswith("]") and ":" in host:
        return host[1:-1], port
    return (host, port) if colon and not set(host) & set(":[]") else None


def lacks_brackets(text: str) -> bool:
    """Whether `text` could be an IPv6 address and a port without the brackets between them."""
    return text.count(":") > 1 and not set(text) & set("[]/")


def resolve_udp(host: str, port: int) -> tuple[socket.AddressFamily, Address]:
    """Return the family and the numeric address of a host; IPv4 if it has both. Raises `LinkError`."""
    try:
        usable = [row for row in socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM) if row[0] in _ANY]
    except (OSError, UnicodeError):  # the second for a name that is too long
        usable = []
    if not usable:
        raise LinkError(f"no host is named {host!r}.", hint="check the name, or use an IP address")
    family, _, _, _, address = min(usable, key=lambda row: row[0] != socket.AF_INET)
    return family, plain_address(address)


def caller_host(family: socket.AddressFamily, host: str) -> str:
    """Return the address to bind a socket to that calls `host`: loopback calls stay on this machine."""
    is_loopback = host.startswith("127.") or host == "::1"
    return (_LOOPBACK if is_loopback else _ANY)[family]


def plain_address(address: Any) -> Address:
    """Return what the socket module reports as host and port; the host of a link-local address has its `%scope`."""
    host: str = address[0]
    if len(address) == 4 and address[3] and "%" not in host:
        host = f"{host}%{address[3]}"
    return host, address[1]


@lru_cache(maxsize=256)
def socket_address(host: str, port: int) -> tuple[str, int] | tuple[str, int, int, int]:
    """Return a `plain_address` as the socket module takes it. Raises `OSError` for a scope that is not there."""
    plain, percent, scope = host.partition("%")
    if not percent:
        return host, port
    return plain, port, 0, int(scope) if scope.isdecimal() else socket.if_nametoindex(scope)


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
