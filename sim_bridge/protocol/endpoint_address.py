"""Parses endpoint texts (`udpout:HOST:PORT`, `udpin:PORT`, `tcpin:PORT`, `pty`) and limits them to this machine.

`lockstep:FD` is for a program that starts the vehicles and shares their time: see `LockstepEndpoint`.
"""

import ipaddress
from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import UsageError
from gcs.link.endpoints.addresses import host_port, lacks_brackets, split_host_port

LOOPBACK = "127.0.0.1"


class EndpointKind(StrEnum):
    """The transport, and which side sends first."""

    UDP_OUT = "udpout"  # the vehicles send to a ground station
    UDP_IN = "udpin"  # the vehicles wait for a ground station
    TCP_IN = "tcpin"
    PTY = "pty"  # a pseudo terminal, for a program on this machine
    LOCKSTEP = "lockstep"  # an inherited socket, whose other end has a turn at every instant; `port` is its file


@dataclass(frozen=True)
class EndpointSpec:
    """One endpoint of a fleet.

    `port` 0 takes any free one. Each vehicle has its own port: a listening endpoint uses those from `port` on, one by
    one; a pty is named `path` and the system id. With `shared` all vehicles use one port.
    """

    kind: EndpointKind
    host: str = LOOPBACK
    port: int = 0
    path: str = ""  # of a pty: a symbolic link to it; default none
    shared: bool = False

    def __str__(self) -> str:
        where = self.path if self.kind is EndpointKind.PTY else host_port(self.host, self.port)
        return f"{self.kind}:{where}" if where else str(self.kind)

    def port_of(self, row: int) -> int:
        """Return the port of one vehicle. Raises `UsageError` above 65535."""
        port = self.port + row if self.port and not self.shared and self.kind is not EndpointKind.UDP_OUT else self.port
        if port > 0xFFFF:
            raise UsageError(
                f"{self}: vehicle {row + 1} of the fleet would need port {port}, above 65535.",
                hint="choose a lower port",
            )
        return port


@dataclass(frozen=True)
class PeerAddress:
    """The address of a line, for people and programs: `udpin`, `127.0.0.1:14540`."""

    kind: str
    address: str

    @property
    def port(self) -> int:
        """The number of a UDP or TCP port; 0 for a terminal."""
        _, colon, port = self.address.rpartition(":")
        return int(port) if colon and port.isdecimal() else 0


def call(port: int, host: str = LOOPBACK) -> EndpointSpec:
    """Return the endpoint of vehicles that send to a ground station over UDP."""
    return EndpointSpec(EndpointKind.UDP_OUT, host, port)


CALL_GROUND = call(14550)
_HINT = "write e.g. udpout:127.0.0.1:14550, udpin:14540, tcpin:5760, pty or pty:/tmp/vehicle"


def parse_link(text: str, *, bind: str = LOOPBACK, shared: bool = False) -> EndpointSpec:
    """Return the endpoint that `text` names; `bind` is the address that may be listened on besides loopback.

    Raises `UsageError` that quotes the text.
    """
    kind_text, _, rest = text.partition(":")
    try:
        kind = EndpointKind(kind_text)
    except ValueError:
        raise UsageError(f"{text!r} does not name a link.", hint=_HINT) from None
    if kind is EndpointKind.PTY:
        return EndpointSpec(kind, path=rest, shared=shared)
    if kind is EndpointKind.LOCKSTEP:
        if not (rest.isascii() and rest.isdigit() and len(rest) < 9):
            raise UsageError(f"{text!r} does not name a link: the file descriptor must be a number.", hint=_HINT)
        return EndpointSpec(kind, port=int(rest), shared=True)
    if lacks_brackets(rest):
        raise UsageError(
            f"{text!r} does not name a link.", hint=f"write an IPv6 host in brackets, e.g. {kind}:[::1]:14550"
        )
    host, port_text = split_host_port(rest) or ("", rest)
    least = 1 if kind is EndpointKind.UDP_OUT else 0
    if not (port_text.isascii() and port_text.isdigit() and least <= int(port_text) <= 0xFFFF):
        raise UsageError(f"{text!r} does not name a link: the port must be a number up to 65535.", hint=_HINT)
    if kind is EndpointKind.UDP_OUT:
        if not host:
            raise UsageError(f"{text!r} does not name a link: the host of the ground station is missing.", hint=_HINT)
        return EndpointSpec(kind, host, int(port_text), shared=shared)
    if host and host != bind and not is_loopback(host):
        raise UsageError(
            f"{text!r} would let other machines command the vehicles.", hint=f"to allow this, add --bind {host}"
        )
    return EndpointSpec(kind, host or bind, int(port_text), shared=shared)


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach `host`; of host names only `localhost` counts."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
