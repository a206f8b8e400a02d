"""Where bytes come from and go to: the tiny interface of all endpoints, and what a person writes to name one.

Knows: `udpin:HOST:PORT` (wait for vehicles), `udpout:HOST:PORT` (call a peer), `tcp:HOST:PORT`, `serial:DEVICE:BAUD`.
Does not know: messages, who is where (`addressbook`), sockets (each kind of endpoint has a file of its own).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from gcs.errors import UsageError

Address = tuple[str, int]  # host and port; of a serial line its device and baud rate
Receive = Callable[[bytes, Address], None]

DEFAULT_SPEC = "udpin:127.0.0.1:14550"
DEFAULT_BAUD = 57_600  # what telemetry radios come with


class LinkMode(Enum):
    """Kinds of endpoint, by their names in a spec."""

    LISTEN = "udpin"
    CALL = "udpout"
    TCP = "tcp"
    SERIAL = "serial"

    @property
    def speaks_first(self) -> bool:
        """Whether there is somebody at the other end to be told of us before it was heard."""
        return self is not LinkMode.LISTEN


@dataclass(frozen=True)
class LinkSpec:
    """An endpoint by name; of a serial line `host` is the device and `port` the baud rate."""

    mode: LinkMode
    host: str
    port: int

    @property
    def address(self) -> Address:
        """The address to listen at or to call."""
        return self.host, self.port

    def __str__(self) -> str:
        return f"{self.mode.value}:{self.host}:{self.port}"


class Endpoint(Protocol):
    """Sends and receives bytes, datagram by datagram or as they come; `receive` is called in the event loop."""

    @property
    def local_address(self) -> Address:
        """The address it receives at, once open."""

    @property
    def spec(self) -> LinkSpec:
        """What it was made of."""

    async def open(self, receive: Receive) -> None:
        """Starts to receive. Raises `LinkError` when the address cannot be had."""

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Sends a frame, to the default peer without an address; never waits, may lose it."""

    def close(self) -> None:
        """Lets the address go. Harmless the second time."""


def parse_link_spec(text: str) -> LinkSpec:
    """The endpoint that a person names; `host:port` alone means udpin, `/dev/...` alone a serial line.

    Raises `UsageError` that quotes the text and shows an example.
    """
    hint = f"write for example {DEFAULT_SPEC}, tcp:127.0.0.1:5760 or serial:/dev/ttyUSB0:{DEFAULT_BAUD}"
    kind, _, rest = text.partition(":")
    try:
        mode = LinkMode(kind)
    except ValueError:
        mode, rest = LinkMode.SERIAL if text.startswith("/dev/") else LinkMode.LISTEN, text
    if mode is LinkMode.SERIAL:
        return _serial(text, rest, hint)
    host, colon, port_text = rest.rpartition(":")
    if not colon or not host or ":" in host:
        raise UsageError(f"{text!r} does not name a link: KIND:HOST:PORT, with udpin, udpout or tcp.", hint=hint)
    least = 0 if mode is LinkMode.LISTEN else 1  # listening at port 0 takes any free one
    if not (port_text.isascii() and port_text.isdigit() and least <= int(port_text) < 65536):
        raise UsageError(f"{text!r} does not name a link: the port is a number from 1 to 65535.", hint=hint)
    return LinkSpec(mode, host, int(port_text))


def _serial(text: str, rest: str, hint: str) -> LinkSpec:
    """A device's path may hold colons; what follows the last one is a baud rate if it is a number."""
    device, colon, baud = rest.rpartition(":")
    if not (colon and baud.isascii() and baud.isdigit()):
        device, baud = rest, str(DEFAULT_BAUD)
    if not device or not 0 < int(baud) <= 10_000_000:
        raise UsageError(f"{text!r} does not name a serial line: serial:DEVICE:BAUD.", hint=hint)
    return LinkSpec(LinkMode.SERIAL, device, int(baud))
