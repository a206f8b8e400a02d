"""Addresses of IPv4 and IPv6: as text, resolved, and as sockets give them."""

import socket
from functools import lru_cache
from typing import Any

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
