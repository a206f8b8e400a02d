"""What a person writes to name an endpoint, and which addresses may be listened at.

Knows: `udpout:HOST:PORT`, `udpin:PORT`, `tcpin:PORT`, `pty`, and that nobody outside this machine is let in unasked.
Does not know: sockets.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import UsageError

LOOPBACK = "127.0.0.1"
Address = tuple[str, int]


class EndpointKind(StrEnum):
    """How bytes travel, and who speaks first."""

    UDP_OUT = "udpout"  # the vehicles call a ground station
    UDP_IN = "udpin"  # the vehicles wait to be called
    TCP_IN = "tcpin"
    PTY = "pty"  # a serial line to a program on this machine


@dataclass(frozen=True)
class EndpointSpec:
    """One endpoint of a fleet.

    `port` 0 takes any free one. Each vehicle has a port of its own: of a listening endpoint those from `port` on, one
    by one, of a pty the terminal `path` and its system id. `shared`, all vehicles are at one.
    """

    kind: EndpointKind
    host: str = LOOPBACK
    port: int = 0
    path: str = ""  # of a pty: the symbolic link that leads to it; none by default
    shared: bool = False

    def __str__(self) -> str:
        where = self.path if self.kind is EndpointKind.PTY else f"{self.host}:{self.port}"
        return f"{self.kind}:{where}" if where else str(self.kind)

    def port_of(self, row: int) -> int:
        """The port of one vehicle. Raises `UsageError` past the last one there is."""
        port = self.port + row if self.port and not self.shared and self.kind is not EndpointKind.UDP_OUT else self.port
        if port > 0xFFFF:
            raise UsageError(f"{self} has no port left for vehicle {row + 1} of the fleet.", hint="begin lower")
        return port


def call(port: int, host: str = LOOPBACK) -> EndpointSpec:
    """Vehicles that call a ground station over UDP."""
    return EndpointSpec(EndpointKind.UDP_OUT, host, port)


CALL_GROUND = call(14550)
_HINT = "write for example udpout:127.0.0.1:14550, udpin:14540, tcpin:5760, pty or pty:/tmp/vehicle"


def parse_link(text: str, *, bind: str = LOOPBACK, shared: bool = False) -> EndpointSpec:
    """The endpoint that `text` names; `bind` is the address that may be listened at beside loopback.

    Raises `UsageError` that quotes the text.
    """
    kind_text, _, rest = text.partition(":")
    try:
        kind = EndpointKind(kind_text)
    except ValueError:
        raise UsageError(f"{text!r} does not name a link.", hint=_HINT) from None
    if kind is EndpointKind.PTY:
        return EndpointSpec(kind, path=rest, shared=shared)
    host, _, port_text = rest.rpartition(":")
    least = 1 if kind is EndpointKind.UDP_OUT else 0
    if not (port_text.isascii() and port_text.isdigit() and least <= int(port_text) <= 0xFFFF):
        raise UsageError(f"{text!r} does not name a link: the port is a number up to 65535.", hint=_HINT)
    if kind is EndpointKind.UDP_OUT:
        if not host:
            raise UsageError(f"{text!r} does not name a link: whom should the vehicles call?", hint=_HINT)
        return EndpointSpec(kind, host, int(port_text), shared=shared)
    if host and host != bind and not is_loopback(host):
        raise UsageError(
            f"{text!r} would listen beyond this machine, where anybody may command the vehicles.",
            hint=f"if that is meant, add --bind {host}",
        )
    return EndpointSpec(kind, host or bind, int(port_text), shared=shared)


def is_loopback(host: str) -> bool:
    """Whether nobody outside this machine can reach `host`; a name counts only if it is `localhost`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
