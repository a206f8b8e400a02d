"""All vehicles on one link or several: found by their heartbeats, told ours.

Knows: one codec, the endpoints, a session per vehicle, the event loop. Does not know: what is said in the sessions.
Frames of unknown systems, of other ground stations and of other components are logged and left alone; so is what is
addressed to another station, and, with a key, what is not signed with it.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from enum import Enum
from functools import partial

from gcs.autopilots.protocol_timers import ProtocolTimers
from gcs.errors import PeerTimeout, ProtocolMisuse, UsageError
from gcs.link.endpoints.base import Address, Endpoint
from gcs.link.endpoints.factory import make_endpoint
from gcs.link.mission_protocol.strategy import Transfer
from gcs.link.session.routing import LinkAddress, RoutingTable
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.link.wire.signing import Signing
from gcs.mavlink import NO_AUTOPILOT, MavCommand, MavState, MavType, MessageId

_HEARTBEAT_S = 1.0
_LOOK_S = 0.1


class FrameDirection(Enum):
    """Which way a frame went."""

    IN = "in"
    OUT = "out"


FrameHook = Callable[[FrameDirection, bytes], None]


class LinkedFleet:
    """The ground station's end of its links. Use it as `async with Fleet.open(spec) as fleet`."""

    def __init__(
        self,
        endpoints: Sequence[Endpoint],
        *,
        me: Station = GROUND,
        on_frame: FrameHook | None = None,
        timers: ProtocolTimers | None = None,
        signing: Signing | None = None,
        transfer: Transfer = Transfer.AUTO,
    ) -> None:
        self.me = me
        self.sessions: dict[int, VehicleSession] = {}  # by MAVLink system id
        self.refused_frames = 0  # not signed as they should be
        self._endpoints = tuple(endpoints)
        self._codec = Codec(*me)
        self._book = RoutingTable()
        self._on_frame = on_frame
        self._timers = timers
        self._transfer = transfer
        self._signing = signing or Signing()
        self._found = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    @classmethod
    @asynccontextmanager
    async def open(
        cls,
        specs: str | Sequence[str],
        *,
        me: Station = GROUND,
        on_frame: FrameHook | None = None,
        timers: ProtocolTimers | None = None,
        signing: Signing | None = None,
        transfer: Transfer = Transfer.AUTO,
    ) -> AsyncIterator[LinkedFleet]:
        """Opens the endpoints that `specs` name (see `parse_link_spec`) and says so with a heartbeat at 1 Hz.

        `on_frame(direction, frame)` sees every frame in and out; `timers` replace those of the vehicles' autopilots,
        `transfer` chooses how missions are sent. With `signing` that is on, every frame is signed, and unsigned frames
        are refused. Raises `UsageError`, `LinkError`.
        """
        endpoints = [make_endpoint(spec) for spec in ([specs] if isinstance(specs, str) else specs)]
        fleet = cls(endpoints, me=me, on_frame=on_frame, timers=timers, signing=signing, transfer=transfer)
        beating: asyncio.Task[None] | None = None
        try:
            for link, endpoint in enumerate(endpoints):
                await endpoint.open(partial(fleet._receive, link))
            beating = asyncio.ensure_future(fleet._beat())
            yield fleet
        finally:
            if beating is not None:
                beating.cancel()
                with suppress(asyncio.CancelledError):
                    await beating
            for endpoint in endpoints:
                endpoint.close()

    @property
    def local_address(self) -> Address:
        """Where vehicles can send to on the first link; tells the port that was free when the link asked for port 0."""
        return self._endpoints[0].local_address

    async def vehicles(
        self, sysids: Collection[int], timeout_s: float, *, systems: Mapping[int, int] | None = None
    ) -> dict[int, VehicleSession]:
        """The sessions of these vehicles, once each has been heard, by the ids given.

        `systems` names the MAVLink system of a vehicle where it is not the vehicle's own number. Raises `PeerTimeout`
        that names the silent ones, `DuplicateSystemId`, or `UsageError` where two vehicles were to be one system.
        """
        system_of = {sysid: (systems or {}).get(sysid, sysid) for sysid in sorted(sysids)}
        _refuse_shared(system_of)
        end_s = self._loop.time() + timeout_s
        while True:
            self.check()
            missing = [sysid for sysid, system in system_of.items() if system not in self.sessions]
            if not missing and not self._book.unproven(self._loop.time()):
                found = {sysid: self.sessions[system] for sysid, system in system_of.items()}
                for sysid, session in found.items():
                    session.sysid = sysid
                return found
            self._found.clear()
            now_s = self._loop.time()
            if now_s >= end_s and missing:
                raise PeerTimeout(
                    f"no heartbeat from {_vehicles(missing, system_of)} within {timeout_s:g} s"
                    f" (heard: {', '.join(map(str, sorted(self.sessions))) or 'none'}).",
                    hint="start them, or check the address and port they send to",
                )
            with suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_S):
                    await self._found.wait()

    async def listen(self, duration_s: float) -> dict[int, VehicleSession]:
        """Whoever is heard within `duration_s`, by system id. Raises `DuplicateSystemId`."""
        await asyncio.sleep(duration_s)
        self.check()
        return dict(sorted(self.sessions.items()))

    def check(self) -> None:
        """Raises `DuplicateSystemId` if two vehicles claimed one system id since the link was opened."""
        self._book.unproven(self._loop.time())
        for conflict in self._book.conflicts.values():
            raise conflict

    def send(self, message: Message, system: int) -> None:
        """Sends a message to where a system was heard. Raises `ProtocolMisuse` if it never was."""
        place = self._book.place(system)
        if place is None:
            raise ProtocolMisuse(f"{message.name} was to be sent to system {system}, which was never heard.")
        self._send(message, place.link, place.address)

    def where(self, system: int) -> str:
        """The link and address at which a system is talked to, for people."""
        place = self._book.place(system)
        return "" if place is None else f"{self._endpoints[place.link].spec.mode.value}:{place}"

    def _receive(self, link: int, data: bytes, address: Address) -> None:
        """Takes in what arrived on one link."""
        now_s = self._loop.time()
        place = LinkAddress(link, address)
        for message in self._codec.decode(data, place):
            if self._on_frame is not None:
                self._on_frame(FrameDirection.IN, message.raw)
            session = self.sessions.get(message.sysid)
            if session is None and not _is_vehicle(message):
                continue
            if session is not None and message.compid != session.station.compid:
                continue
            if not self._signing.accepts(message.raw, now_s, note=False):
                self.refused_frames += 1
                continue
            self._book.identify(message, place)
            if not self._book.claim(message.sysid, place, now_s):
                self._found.set()
                continue
            self._signing.accepts(message.raw, now_s)
            if session is None:
                self._meet(message)
                continue
            session.quality.receive(message.raw)
            if message.is_for(self.me):
                session.receive(message, now_s)

    def _meet(self, heartbeat: Message) -> None:
        system = heartbeat.sysid
        self.sessions[system] = VehicleSession(
            heartbeat, lambda m: self.send(m, system), me=self.me, timers=self._timers, transfer=self._transfer
        )
        self._found.set()

    def _send(self, message: Message, link: int, address: Address | None) -> None:
        frame = self._codec.encode(message, self._signing.signature(self._loop.time()))
        if self._on_frame is not None:
            self._on_frame(FrameDirection.OUT, frame)
        self._endpoints[link].send(frame, address)

    async def _beat(self) -> None:
        while True:
            now_s = self._loop.time()
            places = self._book.places()
            for place in places:
                self._send(_HEARTBEAT, place.link, place.address)
            for link in {*range(len(self._endpoints))} - {place.link for place in places}:
                if self._endpoints[link].spec.mode.speaks_first:
                    self._send(_HEARTBEAT, link, None)
            for system, suspects in self._book.unproven(now_s).items():
                for place in suspects:
                    self._send(_who_are_you(self.sessions[system].station), place.link, place.address)
            for session in self.sessions.values():
                session.tick(now_s)
            await asyncio.sleep(_HEARTBEAT_S if not self._book.unproven(now_s) else _LOOK_S)


_HEARTBEAT = Message(
    "HEARTBEAT",
    {
        "type": int(MavType.GCS),
        "autopilot": NO_AUTOPILOT,
        "base_mode": 0,
        "custom_mode": 0,
        "system_status": int(MavState.ACTIVE),
        "mavlink_version": 3,
    },
)


def _who_are_you(station: Station) -> Message:
    fields = {"target_system": station.sysid, "target_component": station.compid, "confirmation": 0}
    params = {f"param{n}": 0.0 for n in range(2, 8)}
    asked = {"command": int(MavCommand.REQUEST_MESSAGE), "param1": float(MessageId.AUTOPILOT_VERSION)}
    return Message("COMMAND_LONG", {**fields, **asked, **params})


def _is_vehicle(message: Message) -> bool:
    return (
        message.name == "HEARTBEAT"
        and message.fields["type"] != MavType.GCS
        and message.fields["autopilot"] != NO_AUTOPILOT
    )


def _refuse_shared(system_of: Mapping[int, int]) -> None:
    seen: dict[int, int] = {}
    for sysid, system in system_of.items():
        if system in seen:
            raise UsageError(
                f"vehicles {seen[system]} and {sysid} would both be system {system}.",
                hint="name a system of its own for each: --map 1=7,2=8",
            )
        seen[system] = sysid


def _vehicles(sysids: Sequence[int], system_of: Mapping[int, int]) -> str:
    named = [str(s) if system_of[s] == s else f"{s} (system {system_of[s]})" for s in sysids]
    return ("vehicle " if len(named) == 1 else "vehicles ") + ", ".join(named)
