"""The routing table: the link and address of each system id, and other addresses that claim the id.

Two addresses with one system id are one vehicle on two links, or two vehicles. AUTOPILOT_VERSION decides: `uid2`, or
`uid` if `uid2` is empty (ArduPilot's `uid` is always 0). Messages go to the first address until it is silent and the
other one has proved to be the same vehicle. Before a flight a vehicle that has never reported an id may move without
proof. An address that does not report its id in time counts as a second vehicle. Time is an argument.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs.autopilots.parameter_names import system_id_names
from gcs.errors import PeerError, UsageError
from gcs.link.endpoints.addresses import Address, host_port
from gcs.link.wire.message import Message

SILENT_S = 3.0  # after this silence a vehicle may have moved to another address
IDENTIFY_S = 2.0  # the time for a second address to report its id
PROVE_S = 10.0  # ... if the first one is silent: a restarted vehicle answers late
MOST_CANDIDATES = 4  # of one system; a further one replaces the oldest that did not prove anything in time


class LinkAddress(NamedTuple):
    """An address on one of the station's links. Links count from 0."""

    link: int
    address: Address

    def __str__(self) -> str:
        return host_port(*self.address)


class DuplicateSystemId(PeerError):
    """Two vehicles claim one system id."""

    def __init__(self, sysid: int, first: LinkAddress, second: LinkAddress) -> None:
        where = f"both at {first}" if first == second else f"one at {first}, one at {second}"
        super().__init__(
            f"two vehicles claim system id {sysid}: {where}.",
            hint=f"give each vehicle its own system id ({system_id_names()})",
        )
        self.sysid = sysid


class AddressMove(NamedTuple):
    """A system that is at another address from now on."""

    sysid: int
    before: LinkAddress
    now: LinkAddress
    proof: str  # "" without one


@dataclass
class _Candidate:
    since_s: float
    heard_s: float
    uid: bytes = b""


@dataclass
class _Route:
    address: LinkAddress
    heard_s: float
    uid: bytes = b""  # the first that this address reported
    candidates: dict[LinkAddress, _Candidate] = field(default_factory=dict)


class RoutingTable:
    """The address of each system id: the source address of its messages. `moves` are for the caller to take."""

    def __init__(self) -> None:
        self._routes: dict[int, _Route] = {}
        self._users: dict[LinkAddress, int] = {}  # how many systems are at each address
        self._frozen = False
        self.conflicts: dict[int, DuplicateSystemId] = {}
        self.moves: list[AddressMove] = []

    def freeze(self) -> None:
        """From now on an address changes only with proof. Another claim of a system id is no conflict but ignored."""
        self._frozen = True

    def address(self, sysid: int) -> LinkAddress | None:
        """Return the address of system `sysid`; None if it was never heard."""
        route = self._routes.get(sysid)
        return route.address if route else None

    def addresses(self) -> set[LinkAddress]:
        """Return the addresses of all systems."""
        return {route.address for route in self._routes.values()}

    def knows(self, address: LinkAddress) -> bool:
        """Whether some system is at this address."""
        return address in self._users

    def is_identified(self, sysid: int) -> bool:
        """Whether the system has reported an id, so that it can prove a move."""
        route = self._routes.get(sysid)
        return route is not None and bool(route.uid)

    def accept(self, sysid: int, address: LinkAddress, now_s: float, *, signed: bool = False) -> bool:
        """Return whether to accept a message of `sysid` from `address`.

        A second address is accepted once the first has been silent for `SILENT_S` and the second is the same vehicle
        (a restarted simulator has a new port). A valid signature of the message proves it, `signed`.
        """
        route = self._routes.get(sysid)
        if route is None:
            self._routes[sysid] = _Route(address, now_s)
            self._users[address] = self._users.get(address, 0) + 1
            return True
        if route.address == address:
            route.heard_s = now_s
            return True
        candidate = self._candidate(route, address, now_s)
        if candidate is None or now_s - route.heard_s <= SILENT_S:
            return False
        proof = "its frames are signed" if signed else "it reports the same id" if _same(route.uid, candidate) else ""
        if not proof and (route.uid or self._frozen):
            return False
        self._move(sysid, route, address, now_s, proof)
        return True

    def identify(self, message: Message, address: LinkAddress) -> None:
        """Record the id in AUTOPILOT_VERSION. Different ids of one system id are a conflict."""
        route = self._routes.get(message.sysid)
        if message.name != "AUTOPILOT_VERSION" or route is None:
            return
        uid = identity(message)
        if not any(uid):
            return  # the vehicle does not report an id
        if route.address == address:
            if route.uid and route.uid != uid:
                self._conflict(message.sysid, address, address)
            route.uid = route.uid or uid
        elif address in route.candidates:
            candidate = route.candidates[address]
            if candidate.uid and candidate.uid != uid:
                self._conflict(message.sysid, address, address)
            candidate.uid = candidate.uid or uid
        for other, candidate in route.candidates.items():
            if route.uid and candidate.uid and candidate.uid != route.uid:
                self._conflict(message.sysid, route.address, other)

    def unidentified(self, now_s: float) -> dict[int, tuple[LinkAddress, ...]]:
        """Return the addresses to request AUTOPILOT_VERSION from, by system id. Late answers become conflicts."""
        requests: dict[int, tuple[LinkAddress, ...]] = {}
        for sysid, route in self._routes.items():
            first_is_silent = now_s - route.heard_s > SILENT_S
            for address, candidate in tuple(route.candidates.items()):
                age_s = now_s - candidate.since_s
                first_is_gone = first_is_silent or route.heard_s < candidate.since_s
                if _same(route.uid, candidate):
                    continue
                if now_s - candidate.heard_s > SILENT_S:
                    del route.candidates[address]
                elif (
                    age_s <= IDENTIFY_S
                    or candidate.heard_s == candidate.since_s  # one frame: a checksum may be right by chance
                    or (first_is_gone and (self._frozen or age_s <= PROVE_S))
                ):
                    requests[sysid] = (*requests.get(sysid, (route.address,)), address)
                else:
                    self._conflict(sysid, route.address, address)
        return requests

    def claims(self, now_s: float) -> dict[int, LinkAddress]:
        """Return an address of each system that is not its own and has not proved in time to be the same vehicle."""
        return {
            sysid: address
            for sysid, route in self._routes.items()
            for address, candidate in route.candidates.items()
            if not _same(route.uid, candidate) and now_s - candidate.since_s > IDENTIFY_S
        }

    def _candidate(self, route: _Route, address: LinkAddress, now_s: float) -> _Candidate | None:
        """The entry of another address, new if there is room; None if there is none."""
        known = route.candidates
        if address not in known and len(known) >= MOST_CANDIDATES:
            useless = [
                other
                for other, entry in known.items()
                if now_s - (entry.heard_s if _same(route.uid, entry) else entry.since_s) > IDENTIFY_S
            ]
            if not useless:
                return None
            del known[min(useless, key=lambda other: known[other].since_s)]
        candidate = known.setdefault(address, _Candidate(now_s, now_s))
        candidate.heard_s = now_s
        return candidate

    def _move(self, sysid: int, route: _Route, address: LinkAddress, now_s: float, proof: str) -> None:
        self.moves.append(AddressMove(sysid, route.address, address, proof))
        self._users[route.address] -= 1
        if not self._users[route.address]:
            del self._users[route.address]
        self._users[address] = self._users.get(address, 0) + 1
        route.uid = route.uid or route.candidates[address].uid
        del route.candidates[address]
        route.address, route.heard_s = address, now_s

    def _conflict(self, sysid: int, first: LinkAddress, second: LinkAddress) -> None:
        if not self._frozen:
            self.conflicts.setdefault(sysid, DuplicateSystemId(sysid, first, second))


def identity(message: Message) -> bytes:
    """Return the unique id in AUTOPILOT_VERSION: uid2, or uid if uid2 is empty; zeros if both are."""
    uid2 = bytes(message.fields["uid2"])
    return uid2 if any(uid2) else int(message.fields["uid"]).to_bytes(8, "little")


def _same(uid: bytes, candidate: _Candidate) -> bool:
    return bool(uid) and candidate.uid == uid


def reject_shared_systems(system_of: Mapping[int, int]) -> None:
    """Raises `UsageError` if two vehicles have the same system."""
    seen: dict[int, int] = {}
    for sysid, system in system_of.items():
        if system in seen:
            raise UsageError(
                f"vehicles {seen[system]} and {sysid} would both be system {system}.",
                hint="give each vehicle a system of its own: --map 1=7,2=8",
            )
        seen[system] = sysid


def vehicle_words(sysids: Sequence[int], system_of: Mapping[int, int]) -> str:
    """Return "vehicle 1" or "vehicles 1, 2 (system 7)"."""
    named = [str(s) if system_of[s] == s else f"{s} (system {system_of[s]})" for s in sysids]
    return ("vehicle " if len(named) == 1 else "vehicles ") + ", ".join(named)
