"""Where bytes come from and go to: the tiny interface of all endpoints, and what a person writes to name one.

Knows: `udpin:HOST:PORT` (wait for vehicles), `udpout:HOST:PORT` (call a peer), addresses, which system id lives
at which address. Does not know: messages, sockets (each kind of endpoint has a file of its own).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from gcs.errors import PeerError, UsageError

Address = tuple[str, int]
Receive = Callable[[bytes, Address], None]

DEFAULT_SPEC = "udpin:127.0.0.1:14550"
_SILENT_S = 3.0  # a vehicle not heard for so long may have moved to another address


class LinkMode(Enum):
    """Which end speaks first."""

    LISTEN = "udpin"
    CALL = "udpout"


@dataclass(frozen=True)
class LinkSpec:
    """An endpoint by name."""

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
    """Sends and receives datagrams. `receive` is called on the event loop's thread for each that arrives."""

    @property
    def local_address(self) -> Address:
        """The address it receives at, once open."""

    async def open(self, receive: Receive) -> None:
        """Starts to receive. Raises `LinkError` when the address cannot be had."""

    def send(self, data: bytes, address: Address | None = None) -> None:
        """Sends one datagram, to the default peer without an address; never waits, may lose it."""

    def close(self) -> None:
        """Lets the address go. Harmless the second time."""


def parse_link_spec(text: str) -> LinkSpec:
    """The endpoint that `udpin:host:port` or `udpout:host:port` names; `host:port` alone means udpin.

    Raises `UsageError` that quotes the text and shows an example.
    """
    hint = f"write for example {DEFAULT_SPEC}"
    kind, _, rest = text.partition(":")
    try:
        mode = LinkMode(kind)
    except ValueError:
        mode, rest = LinkMode.LISTEN, text
    host, colon, port_text = rest.rpartition(":")
    if not colon or not host or ":" in host:
        raise UsageError(f"{text!r} does not name a link: udpin:HOST:PORT or udpout:HOST:PORT.", hint=hint)
    least = 0 if mode is LinkMode.LISTEN else 1  # listening at port 0 takes any free one
    if not (port_text.isascii() and port_text.isdigit() and least <= int(port_text) < 65536):
        raise UsageError(f"{text!r} does not name a link: the port is a number from 1 to 65535.", hint=hint)
    return LinkSpec(mode, host, int(port_text))


class DuplicateSystemId(PeerError):
    """Two vehicles, at two addresses, claim one system id."""

    def __init__(self, sysid: int, first: Address, second: Address) -> None:
        super().__init__(
            f"two vehicles claim system id {sysid}: one at {_show(first)}, one at {_show(second)}.",
            hint="give each vehicle its own system id (MAV_SYS_ID on PX4, SYSID_THISMAV on ArduPilot)",
        )
        self.sysid = sysid


class AddressBook:
    """At which address each system id lives; each is answered at its own source address."""

    def __init__(self) -> None:
        self._homes: dict[int, tuple[Address, float]] = {}
        self.conflicts: dict[int, DuplicateSystemId] = {}

    def address(self, sysid: int) -> Address | None:
        """Where to answer system `sysid`."""
        home = self._homes.get(sysid)
        return home[0] if home else None

    def addresses(self) -> set[Address]:
        """All addresses in the book."""
        return {address for address, _ in self._homes.values()}

    def claim(self, sysid: int, address: Address, now_s: float) -> bool:
        """Whether a message of `sysid` from `address` is to be believed.

        A second address is refused and noted in `conflicts` while the first one is alive; when the first has
        been silent for 3 s, the vehicle has moved (a restarted simulator has a new port).
        """
        home = self._homes.get(sysid)
        if home is None or home[0] == address or now_s - home[1] > _SILENT_S:
            self._homes[sysid] = (address, now_s)
            return True
        if sysid not in self.conflicts:
            self.conflicts[sysid] = DuplicateSystemId(sysid, home[0], address)
        return False


def _show(address: Address) -> str:
    return f"{address[0]}:{address[1]}"
