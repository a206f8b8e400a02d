"""All vehicles on one or several links: found by their heartbeats, each with a session.

Frames of unknown systems, other ground stations and other components are logged and ignored. So are messages addressed
to another station and, with a key, frames that are not signed with it.
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
from gcs.link.microservices.command import CommandSender
from gcs.link.mission_protocol.strategy import Transfer
from gcs.link.session.routing import LinkAddress, RoutingTable
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.link.wire.signing import Signing
from gcs.mavlink import NO_AUTOPILOT, MavCommand, MavState, MavType, MessageId

_HEARTBEAT_S = 1.0
_LOOK_S = 0.1
_AUTOPILOT_COMPONENT = 1


class FrameDirection(Enum):
    """The direction of a frame."""

    IN = "in"
    OUT = "out"


FrameHook = Callable[[FrameDirection, bytes], None]


class LinkedFleet:
    """The ground station's side of its links. Use it as `async with LinkedFleet.open(spec) as fleet`."""

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
        self.refused_frames = 0  # without a valid signature
        self._endpoints = tuple(endpoints)
        self._codec = Codec(*me)
        self._routing = RoutingTable()
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
        """Open the endpoints that `specs` name (see `parse_link_spec`) and send a heartbeat at 1 Hz.

        `on_frame(direction, frame)` gets every frame in and out; `timers` replace those of the vehicles' autopilots,
        `transfer` chooses how missions are sent. With `signing` that is on, every frame is signed, and unsigned frames
        are refused. Raises `UsageError`, `LinkError`.
        """
        endpoints = [make_endpoint(spec) for spec in ([specs] if isinstance(specs, str) else specs)]
        fleet = cls(endpoints, me=me, on_frame=on_frame, timers=timers, signing=signing, transfer=transfer)
        heartbeats: asyncio.Task[None] | None = None
        try:
            for link, endpoint in enumerate(endpoints):
                await endpoint.open(partial(fleet._receive, link))
            heartbeats = asyncio.ensure_future(fleet._send_heartbeats())
            yield fleet
        finally:
            if heartbeats is not None:
                heartbeats.cancel()
                with suppress(asyncio.CancelledError):
                    await heartbeats
            for endpoint in endpoints:
                endpoint.close()

    @property
    def local_address(self) -> Address:
        """The address of the first link that vehicles can send to; for port 0, with the port that was free."""
        return self._endpoints[0].local_address

    async def vehicles(
        self, sysids: Collection[int], timeout_s: float, *, systems: Mapping[int, int] | None = None
    ) -> dict[int, VehicleSession]:
        """Return the sessions of these vehicles, by the ids given, once each has sent a heartbeat.

        `systems` maps a vehicle to its MAVLink system if the two numbers differ. Raises `PeerTimeout` that names the
        silent vehicles, `DuplicateSystemId`, or `UsageError` if two vehicles have the same system.
        """
        system_of = {sysid: (systems or {}).get(sysid, sysid) for sysid in sorted(sysids)}
        _reject_shared_systems(system_of)
        end_s = self._loop.time() + timeout_s
        while True:
            self.check()
            missing = [sysid for sysid, system in system_of.items() if system not in self.sessions]
            if not missing and not self._routing.unidentified(self._loop.time()):
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
                    hint="start them, or check the address and port that they send to",
                )
            with suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_S):
                    await self._found.wait()

    async def vehicles_left(
        self,
        autopilots: Mapping[int, int],
        timeout_s: float,
        *,
        settle_s: float,
        systems: Mapping[int, int] | None = None,
    ) -> dict[int, VehicleSession]:
        """Return the sessions of vehicles that another process left, also of those that are not heard.

        `autopilots` has the MAV_AUTOPILOT of each vehicle. The first one must be heard within `timeout_s`, the others
        `settle_s` later; one that is heard later still is then `VehicleSession.heard`. Raises `PeerTimeout` if none is.
        """
        system_of = {sysid: (systems or {}).get(sysid, sysid) for sysid in sorted(autopilots)}
        _reject_shared_systems(system_of)
        end_s, settled = self._loop.time() + timeout_s, False
        while missing := [sysid for sysid, system in system_of.items() if system not in self.sessions]:
            if len(missing) < len(system_of) and not settled:
                end_s, settled = min(end_s, self._loop.time() + settle_s), True
            if self._loop.time() >= end_s:
                break
            await asyncio.sleep(_LOOK_S)
        if len(missing) == len(system_of):
            raise PeerTimeout(
                f"no heartbeat from {_vehicles(missing, system_of)} within {timeout_s:g} s.",
                hint="check the link; name another one with --link",
            )
        for sysid in missing:
            self._expect(system_of[sysid], autopilots[sysid])
        found = {sysid: self.sessions[system] for sysid, system in system_of.items()}
        for sysid, session in found.items():
            session.sysid = sysid
        return found

    async def listen(self, duration_s: float) -> dict[int, VehicleSession]:
        """Return all vehicles heard within `duration_s`, by system id. Raises `DuplicateSystemId`."""
        await asyncio.sleep(duration_s)
        self.check()
        return dict(sorted(self.sessions.items()))

    def check(self) -> None:
        """Raise `DuplicateSystemId` if two vehicles have claimed one system id since the link was opened."""
        self._routing.unidentified(self._loop.time())
        for conflict in self._routing.conflicts.values():
            raise conflict

    def send(self, message: Message, system: int) -> None:
        """Send a message to the address of a system. Raises `ProtocolMisuse` if the system was never heard."""
        target = self._routing.address(system)
        if target is None:
            raise ProtocolMisuse(f"{message.name} cannot be sent to system {system}, which was never heard.")
        self._send(message, target.link, target.address)

    def where(self, system: int) -> str:
        """Return the link and address of a system as text, empty if it was never heard."""
        target = self._routing.address(system)
        return "" if target is None else f"{self._endpoints[target.link].spec.mode.value}:{target}"

    def _receive(self, link: int, data: bytes, address: Address) -> None:
        """Process the bytes that arrived on one link."""
        now_s = self._loop.time()
        source = LinkAddress(link, address)
        for message in self._codec.decode(data, source):
            if self._on_frame is not None:
                self._on_frame(FrameDirection.IN, message.raw)
            session = self.sessions.get(message.sysid)
            if (session is None or not session.heard) and not _is_vehicle(message):
                continue
            if session is not None and message.compid != session.station.compid:
                continue
            if not self._signing.accepts(message.raw, now_s, note=False):
                self.refused_frames += 1
                continue
            self._routing.identify(message, source)
            if not self._routing.accept(message.sysid, source, now_s):
                self._found.set()
                continue
            self._signing.accepts(message.raw, now_s)
            if session is None:
                self._add_vehicle(message)
                continue
            session.quality.receive(message.raw)
            if message.is_for(self.me):
                session.receive(message, now_s)

    def _add_vehicle(self, heartbeat: Message) -> None:
        system = heartbeat.sysid
        self.sessions[system] = VehicleSession(
            heartbeat, lambda m: self.send(m, system), me=self.me, timers=self._timers, transfer=self._transfer
        )
        self._found.set()

    def _expect(self, system: int, autopilot: int) -> None:
        def send(message: Message) -> None:
            if self._routing.address(system) is not None:
                self.send(message, system)

        self.sessions[system] = VehicleSession.not_heard(
            Station(system, _AUTOPILOT_COMPONENT),
            autopilot,
            send,
            me=self.me,
            timers=self._timers,
            transfer=self._transfer,
        )

    def _send(self, message: Message, link: int, address: Address | None) -> None:
        frame = self._codec.encode(message, self._signing.signature(self._loop.time()))
        if self._on_frame is not None:
            self._on_frame(FrameDirection.OUT, frame)
        self._endpoints[link].send(frame, address)

    async def _send_heartbeats(self) -> None:
        while True:
            now_s = self._loop.time()
            known = self._routing.addresses()
            for target in known:
                self._send(_HEARTBEAT, target.link, target.address)
            for link in {*range(len(self._endpoints))} - {target.link for target in known}:
                if self._endpoints[link].spec.mode.speaks_first:
                    self._send(_HEARTBEAT, link, None)
            for system, targets in self._routing.unidentified(now_s).items():
                for target in targets:
                    self._send(_request_identity(self.sessions[system].station), target.link, target.address)
            for session in self.sessions.values():
                session.tick(now_s)
            await asyncio.sleep(_HEARTBEAT_S if not self._routing.unidentified(now_s) else _LOOK_S)


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


def _request_identity(station: Station) -> Message:
    (message,) = CommandSender(MavCommand.REQUEST_MESSAGE, (MessageId.AUTOPILOT_VERSION,), station).start(0.0)
    return message


def _is_vehicle(message: Message) -> bool:
    return (
        message.name == "HEARTBEAT"
        and message.fields["type"] != MavType.GCS
        and message.fields["autopilot"] != NO_AUTOPILOT
    )


def _reject_shared_systems(system_of: Mapping[int, int]) -> None:
    seen: dict[int, int] = {}
    for sysid, system in system_of.items():
        if system in seen:
            raise UsageError(
                f"vehicles {seen[system]} and {sysid} would both be system {system}.",
                hint="give each vehicle a system of its own: --map 1=7,2=8",
            )
        seen[system] = sysid


def _vehicles(sysids: Sequence[int], system_of: Mapping[int, int]) -> str:
    named = [str(s) if system_of[s] == s else f"{s} (system {system_of[s]})" for s in sysids]
    return ("vehicle " if len(named) == 1 else "vehicles ") + ", ".join(named)
