"""The names of links on the command line.

A name is `udpin:HOST:PORT` (listen for vehicles), `udpout:HOST:PORT` (call a peer), `tcp:HOST:PORT` or
`serial:DEVICE:BAUD`. An IPv6 host stands in brackets: `udpin:[::1]:14550`.
"""

import re
import string
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from gcs.errors import UsageError
from gcs.link.endpoints.addresses import Address, host_port, lacks_brackets, split_host_port

Receive = Callable[[bytes, Address], None]

DEFAULT_SPEC = "udpin:127.0.0.1:14550"
DEFAULT_BAUD = 57_600  # the default of telemetry radios

_KINDS_ELSEWHERE = {"udp": "udpin", "udpcl": "udpout", "udpbcast": "udpout", "tcpout": "tcp"}
_DEVICE_COMMA_BAUD = re.compile(r"(?:serial:)?(/dev/[^,]+),(\d+)", re.ASCII)


class LinkMode(Enum):
    """The kinds of endpoint, by their names in a spec."""

    LISTEN = "udpin"
    CALL = "udpout"
    TCP = "tcp"
    SERIAL = "serial"


@dataclass(frozen=True)
class LinkSpec:
    """One endpoint by name. For a serial line `host` is the device and `port` the baud rate."""

    mode: LinkMode
    host: str
    port: int

    @property
    def address(self) -> Address:
        """The address to listen on or to call."""
        return self.host, self.port

    def __str__(self) -> str:
        return f"{self.mode.value}:{host_port(self.host, self.port)}"


def parse_link_spec(text: str) -> LinkSpec:
    """Return the endpoint of a name. `host:port` alone means udpin, `/dev/...` alone a serial line.

    Raises `UsageError` that quotes the text and shows an example.
    """
    hint = f"write for example {DEFAULT_SPEC}, tcp:127.0.0.1:5760 or serial:/dev/ttyUSB0:{DEFAULT_BAUD}"
    meant = _own_name(text)
    if meant:
        raise UsageError(f"{text!r} does not name a link here; other programs write links so.", hint=f"write {meant}")
    kind, _, rest = text.partition(":")
    try:
        mode = LinkMode(kind)
    except ValueError:
        mode, rest = LinkMode.SERIAL if text.startswith("/dev/") else LinkMode.LISTEN, text
    if mode is LinkMode.SERIAL:
        device, colon, baud = rest.rpartition(":")
        if not (colon and baud.isascii() and baud.isdigit() and len(baud) < 9):
            device, baud = rest, str(DEFAULT_BAUD)
        if not device or not 0 < int(baud) <= 10_000_000:
            raise UsageError(f"{text!r} does not name a serial line: the form is serial:DEVICE:BAUD.", hint=hint)
        return LinkSpec(LinkMode.SERIAL, device, int(baud))
    if lacks_brackets(rest) and (rest is not text or not set(kind) - set(string.hexdigits)):
        hint = f"write an IPv6 host in brackets, for example {mode.value}:[::1]:14550; else write {DEFAULT_SPEC}"
    host, port_text = split_host_port(rest) or ("", "")
    if not host:
        raise UsageError(
            f"{text!r} does not name a link: the form is KIND:HOST:PORT, with KIND udpin, udpout or tcp.", hint=hint
        )
    least = 0 if mode is LinkMode.LISTEN else 1  # to listen on port 0 takes any free port
    if not (port_text.isascii() and port_text.isdigit() and len(port_text) < 9 and least <= int(port_text) < 65536):
        raise UsageError(f"{text!r} does not name a link: the port must be a number from 1 to 65535.", hint=hint)
    return LinkSpec(mode, host, int(port_text))


def _own_name(text: str) -> str:
    """Translate a link name of MAVProxy, pymavlink (`udp:`, `/dev/x,57600`) or MAVSDK (`udp://:14540`) to ours."""
    device = _DEVICE_COMMA_BAUD.fullmatch(text)
    if device:
        return f"serial:{device[1]}:{device[2]}"
    kind, _, rest = text.partition(":")
    own, place = _KINDS_ELSEWHERE.get(kind, kind), rest.removeprefix("//")
    if own == kind and (place == rest or own not in {mode.value for mode in LinkMode}):
        return ""
    host, _, port = place.rpartition(":")
    if own == LinkMode.SERIAL.value:
        return f"serial:{place}"
    return f"{own}:{host or '0.0.0.0'}:{port}" if port.isascii() and port.isdigit() else DEFAULT_SPEC
