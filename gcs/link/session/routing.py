"""At which address each system id lives, and what to think of a second one.

Knows: addresses of all links, what AUTOPILOT_VERSION tells of who a vehicle is. Does not know: sockets, sessions;
time is an argument.

Two addresses that use one system id are one vehicle on two links, or two vehicles with one id. Only their own word
tells: `uid2`, and `uid` where that is empty (ArduPilot's `uid` is always 0). Until both have said who they are, the
first is talked to; what does not say so in time is taken for a second vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from gcs.errors import PeerError
from gcs.link.endpoints.base import Address
from gcs.link.wire.message import Message

SILENT_S = 3.0  # a vehicle not heard for so long may have moved to another address
PROOF_S = 2.0  # for two addresses to say that they are one vehicle


class LinkAddress(NamedTuple):
    """An address on one of the station's links, which count from 0."""

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
            hint="give each vehicle its own system id (MAV_SYS_ID on PX4, SYSID_THISMAV on ArduPilot)",
        )
        self.sysid = sysid


@dataclass
class _Home:
    place: LinkAddress
    heard_s: float


@dataclass
class _Rival:
    place: LinkAddress
    since_s: float
    heard_s: float


class RoutingTable:
    """Each vehicle is answered at its own source address."""

    def __init__(self) -> None:
        self._homes: dict[int, _Home] = {}
        self._rivals: dict[int, dict[LinkAddress, _Rival]] = {}
        self._identities: dict[int, dict[LinkAddress, bytes]] = {}
        self.conflicts: dict[int, DuplicateSystemId] = {}

    def place(self, sysid: int) -> LinkAddress | None:
        """Where to answer system `sysid`."""
        home = self._homes.get(sysid)
        return home.place if home else None

    def places(self) -> set[LinkAddress]:
        """All places in the book."""
        return {home.place for home in self._homes.values()}

    def claim(self, sysid: int, place: LinkAddress, now_s: float) -> bool:
        """Whether a message of `sysid` from `place` is to be believed.

        A second place is not while the first one is alive; when that has been silent for `SILENT_S`, the vehicle has
        moved (a restarted simulator has a new port).
        """
        home = self._homes.get(sysid)
        if home is None or now_s - home.heard_s > SILENT_S:
            self._homes[sysid] = _Home(place, now_s)
            self._rivals.get(sysid, {}).pop(place, None)
            return True
        if home.place == place:
            home.heard_s = now_s
            return True
        rival = self._rivals.setdefault(sysid, {}).setdefault(place, _Rival(place, now_s, now_s))
        rival.heard_s = now_s
        return False

    def identify(self, message: Message, place: LinkAddress) -> None:
        """Learn from AUTOPILOT_VERSION who a vehicle is; the same id from two is a conflict."""
        if message.name != "AUTOPILOT_VERSION":
            return
        who = identity(message)
        if not any(who):
            return  # it does not tell
        known = self._identities.setdefault(message.sysid, {})
        known[place] = who if known.get(place, who) == who else b"two"
        for other, theirs in known.items():
            if theirs != who or known[place] != who:
                self._note(message.sysid, other, place)

    def unproven(self, now_s: float) -> dict[int, tuple[LinkAddress, ...]]:
        """Places to ask who they are, by system id; those that did not tell in time become conflicts."""
        asked: dict[int, tuple[LinkAddress, ...]] = {}
        for sysid, rivals in self._rivals.items():
            home = self._homes[sysid].place
            told = self._identities.get(sysid, {})
            for place, rival in tuple(rivals.items()):
                if home in told and told.get(place) == told[home]:
                    continue
                if now_s - rival.heard_s > SILENT_S:
                    del rivals[place]
                elif now_s - rival.since_s > PROOF_S:
                    self._note(sysid, home, place)
                else:
                    asked[sysid] = (*asked.get(sysid, (home,)), place)
        return asked

    def _note(self, sysid: int, first: LinkAddress, second: LinkAddress) -> None:
        self.conflicts.setdefault(sysid, DuplicateSystemId(sysid, first, second))


def identity(message: Message) -> bytes:
    """Who sent an AUTOPILOT_VERSION: its uid2, or its uid where that is empty; zeros where it does not tell."""
    uid2 = bytes(message.fields["uid2"])
    return uid2 if any(uid2) else int(message.fields["uid"]).to_bytes(8, "little")
