"""The routing table: the link and address of each system id, and the detection of two vehicles with one system id.

Two addresses with one system id are one vehicle on two links, or two vehicles. AUTOPILOT_VERSION decides: `uid2`, or
`uid` if `uid2` is empty (ArduPilot's `uid` is always 0). Until both addresses have reported their id, messages go to
the first one. An address that does not report its id in time counts as a second vehicle. Time is an argument.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from gcs.autopilots.parameter_names import system_id_names
from gcs.errors import PeerError
from gcs.link.endpoints.base import Address
from gcs.link.wire.message import Message

SILENT_S = 3.0  # after this silence a vehicle may have moved to another address
IDENTIFY_S = 2.0  # the time for a second address to report its id


class LinkAddress(NamedTuple):
    """An address on one of the station's links. Links count from 0."""

    link: int
    address: Address

    def __str__(self) -> str:
        return f"{self.address[0]}:{self.address[1]}"


class DuplicateSystemId(PeerError):
    """Two vehicles claim one system id."""

    def __init__(self, sysid: int, first: LinkAddress, second: LinkAddress) -> None:
        where = f"both at {first}" if first == second else f"one at {first}, one at {second}"
        super().__init__(
            f"two vehicles claim system id {sysid}: {where}.",
            hint=f"give each vehicle its own system id ({system_id_names()})",
        )
        self.sysid = sysid


@dataclass
class _Route:
    address: LinkAddress
    heard_s: float


@dataclass
class _Candidate:
    since_s: float
    heard_s: float


class RoutingTable:
    """The address of each system id: the source address of its messages."""

    def __init__(self) -> None:
        self._routes: dict[int, _Route] = {}
        self._candidates: dict[int, dict[LinkAddress, _Candidate]] = {}
        self._identities: dict[int, dict[LinkAddress, bytes]] = {}
        self.conflicts: dict[int, DuplicateSystemId] = {}

    def address(self, sysid: int) -> LinkAddress | None:
        """Return the address of system `sysid`; None if it was never heard."""
        route = self._routes.get(sysid)
        return route.address if route else None

    def addresses(self) -> set[LinkAddress]:
        """Return the addresses of all systems."""
        return {route.address for route in self._routes.values()}

    def accept(self, sysid: int, address: LinkAddress, now_s: float) -> bool:
        """Return whether to accept a message of `sysid` from `address`.

        A second address is accepted after the first has been silent for `SILENT_S`: the vehicle has moved (a restarted
        simulator has a new port).
        """
        route = self._routes.get(sysid)
        if route is None or now_s - route.heard_s > SILENT_S:
            self._routes[sysid] = _Route(address, now_s)
            self._candidates.get(sysid, {}).pop(address, None)
            return True
        if route.address == address:
            route.heard_s = now_s
            return True
        candidate = self._candidates.setdefault(sysid, {}).setdefault(address, _Candidate(now_s, now_s))
        candidate.heard_s = now_s
        return False

    def identify(self, message: Message, address: LinkAddress) -> None:
        """Record the id in AUTOPILOT_VERSION. Different ids of one system id are a conflict."""
        if message.name != "AUTOPILOT_VERSION":
            return
        uid = identity(message)
        if not any(uid):
            return  # the vehicle does not report an id
        known = self._identities.setdefault(message.sysid, {})
        known[address] = uid if known.get(address, uid) == uid else b"two"
        for other, other_uid in known.items():
            if other_uid != uid or known[address] != uid:
                self._conflict(message.sysid, other, address)

    def unidentified(self, now_s: float) -> dict[int, tuple[LinkAddress, ...]]:
        """Return the addresses to request AUTOPILOT_VERSION from, by system id. Late answers become conflicts."""
        open_requests: dict[int, tuple[LinkAddress, ...]] = {}
        for sysid, candidates in self._candidates.items():
            first = self._routes[sysid].address
            known = self._identities.get(sysid, {})
            for address, candidate in tuple(candidates.items()):
                if first in known and known.get(address) == known[first]:
                    continue
                if now_s - candidate.heard_s > SILENT_S:
                    del candidates[address]
                elif now_s - candidate.since_s > IDENTIFY_S:
                    self._conflict(sysid, first, address)
                else:
                    open_requests[sysid] = (*open_requests.get(sysid, (first,)), address)
        return open_requests

    def _conflict(self, sysid: int, first: LinkAddress, second: LinkAddress) -> None:
        self.conflicts.setdefault(sysid, DuplicateSystemId(sysid, first, second))


def identity(message: Message) -> bytes:
    """Return the unique id in AUTOPILOT_VERSION: uid2, or uid if uid2 is empty; zeros if both are."""
    uid2 = bytes(message.fields["uid2"])
    return uid2 if any(uid2) else int(message.fields["uid"]).to_bytes(8, "little")
