"""All vehicles on one or several links: found by their heartbeats, each with a session.

Frames of unknown systems, other ground stations and other components are ignored, and logged up to a limit. Messages
addressed to another station are ignored; so are frames that are not signed with the key, if there is one, and frames
with the system id of a vehicle that come from elsewhere. In a flight only the systems of its plan have sessions.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Collection, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from enum import Enum
from functools import partial
from typing import Self

from gcs.autopilots.protocol_timers import ProtocolTimers
from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.link.endpoints.addresses import Address
from gcs.link.endpoints.base import LinkMode
from gcs.link.endpoints.endpoint import Endpoint, make_endpoint
from gcs.link.protocols.command import CommandSender
from gcs.link.protocols.mission.strategy import Transfer
from gcs.link.session.routing_table import IDENTIFY_S, LinkAddress, RoutingTable, reject_shared_systems, vehicle_words
from gcs.link.session.unknown_systems import LinkNotice, UnknownSystems
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station, is_autopilots_beat
from gcs.link.wire.signing import Signing, is_signed
from gcs.mavlink import NO_AUTOPILOT, MavCommand, MavState, MavType, MessageId

_HEARTBEAT_S = 1.0
_LOOK_S = 0.1
_AUTOPILOT_COMPONENT = 1
_KEY_MISSING = "signs its frames, and no key is set here: it may answer nothing without --signing-key-file"
_IDENTITY_REQUESTS = 30  # once a second, to vehicles that do not report an id

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


class FrameDirection(Enum):
    """The direction of a frame."""

    IN = "in"
    OUT = "out"


FrameHook = Callable[[FrameDirection, bytes], None]
NoticeHook = Callable[[LinkNotice], None]


class LinkedFleet:
    """The ground station's side of its links. Use it as `async with LinkedFleet(spec).open() as fleet`."""

    def __init__(
        self,
        links: str | Sequence[str | Endpoint],
        *,
        on_frame: FrameHook | None = None,
        timers: ProtocolTimers | None = None,
        signing: Signing | None = None,
        transfer: Transfer = Transfer.AUTO,
        only: Collection[int] | None = None,
        on_notice: NoticeHook | None = None,
    ) -> None:
        """`links` by their names (see `parse_link_spec`), or as endpoints.

        `on_frame(direction, frame)` gets every accepted frame and every frame sent; `timers` replace those of the
        vehicles' autopilots, `transfer` chooses how missions are sent. With `signing` that is on, frames are signed,
        and unsigned ones are refused. `only` are the systems of a flight: no other gets a session. `on_notice` gets
        texts for the operator. Raises `UsageError`.
        """
        self.sessions: dict[int, VehicleSession] = {}  # by MAVLink system id
        self.refused_frames = 0  # without a valid signature
        self.unknown = UnknownSystems()
        named = [links] if isinstance(links, str) else links
        self._endpoints = tuple(make_endpoint(link) if isinstance(link, str) else link for link in named)
        self._codec = Codec(*GROUND)
        self._routing = RoutingTable()
        self._only = None if only is None else frozenset(only)
        self._frozen = False
        self._identity_requests = 0
        self._claims_reported: set[int] = set()
        self._handed_out: set[int] = set()  # systems whose sessions are in use
        self._on_frame = on_frame
        self._on_notice = on_notice
        self._timers = timers
        self._transfer = transfer
        self._signing = signing or Signing()
        self._found = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    @asynccontextmanager
    async def open(self) -> AsyncIterator[Self]:
        """Open the links and send a heartbeat at 1 Hz. Raises `LinkError`."""
        heartbeats: asyncio.Task[None] | None = None
        try:
            for link, endpoint in enumerate(self._endpoints):
                await endpoint.open(partial(self._receive, link))
            heartbeats = asyncio.ensure_future(self._send_heartbeats())
            yield self
        finally:
            if heartbeats is not None:
                heartbeats.cancel()
                with suppress(asyncio.CancelledError):
                    await heartbeats
            self._report_unknown(math.inf)
            for endpoint in self._endpoints:
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
        reject_shared_systems(system_of)
        end_s, all_heard_s = self._loop.time() + timeout_s, math.inf
        while True:
            self.check()
            missing = [sysid for sysid, system in system_of.items() if system not in self.sessions]
            if not missing and not self._routing.unidentified(self._loop.time()):
                if all_heard_s == math.inf:
                    all_heard_s = self._loop.time()
                    self._request_identities(())
                if self._loop.time() - all_heard_s >= self._time_to_identify_s(system_of.values()):
                    return self._hand_out(system_of)
            self._found.clear()
            now_s = self._loop.time()
            if now_s >= end_s and missing:
                raise PeerTimeout(
                    f"no heartbeat from {vehicle_words(missing, system_of)} within {timeout_s:g} s"
                    f" (heard: {', '.join(map(str, sorted({*self.sessions, *self.unknown.systems}))) or 'none'})"
                    f"{self.refused_words()}.",
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
        """Return the sessions of vehicles that an earlier process left, silent ones included.

        `autopilots` has the MAV_AUTOPILOT of each vehicle. The first one must be heard within `timeout_s`, the others
        `settle_s` later; one that is heard later still is then `VehicleSession.heard`. Raises `PeerTimeout` if none is.
        """
        system_of = {sysid: (systems or {}).get(sysid, sysid) for sysid in sorted(autopilots)}
        reject_shared_systems(system_of)
        end_s, settled = self._loop.time() + timeout_s, False
        while missing := [sysid for sysid, system in system_of.items() if system not in self.sessions]:
            if len(missing) < len(system_of) and not settled:
                end_s, settled = min(end_s, self._loop.time() + settle_s), True
            if self._loop.time() >= end_s:
                break
            await asyncio.sleep(_LOOK_S)
        if len(missing) == len(system_of):
            raise PeerTimeout(
                f"no heartbeat from {vehicle_words(missing, system_of)} within {timeout_s:g} s{self.refused_words()}.",
                hint="check the link; name another one with --link",
            )
        for sysid in missing:
            self._expect(system_of[sysid], autopilots[sysid])
        return self._hand_out(system_of)

    def refused_words(self) -> str:
        """Return how many frames the key refused, as the end of a sentence; empty if none was."""
        return f"; {self.refused_frames} frames were not signed with our key" if self.refused_frames else ""

    def _time_to_identify_s(self, systems: Collection[int]) -> float:
        """How long the vehicles of a flight may take to report their ids, which prove a move to another address."""
        all_identified = self._only is None or all(self._routing.is_identified(system) for system in systems)
        return 0.0 if all_identified else IDENTIFY_S

    def _hand_out(self, system_of: Mapping[int, int]) -> dict[int, VehicleSession]:
        found = {sysid: self.sessions[system] for sysid, system in system_of.items()}
        for sysid, session in found.items():
            session.renumber(sysid)
        self._handed_out.update(system_of.values())
        return found

    def freeze(self) -> None:
        """From now on a vehicle's address changes only with proof, and other claims of its system id are ignored."""
        self._routing.freeze()
        self._frozen = True

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
        """Process the bytes that arrived on one link. A failure is reported and ends the processing of one message."""
        now_s = self._loop.time()
        source = LinkAddress(link, address)
        known = self._routing.knows(source)
        if not known and not self.unknown.admits(len(data), source, now_s):
            return
        for message in self._codec.decode(data, source, joins=known or not self._frozen):
            try:
                self._process(message, source, now_s)
            except Exception as error:
                text = f"the processing of {message.name} of system {message.sysid} failed"
                self._loop.call_exception_handler({"message": text, "exception": error})

    def _process(self, message: Message, source: LinkAddress, now_s: float) -> None:
        system = message.sysid
        session = self.sessions.get(system)
        is_new = session is None or not session.heard
        is_vehicle = is_new and is_autopilots_beat(message)
        if self._only is not None and system not in self._only:
            if is_vehicle:
                self.unknown.note(system, source, now_s)
            self._log_foreign(message, now_s)
            return
        if (is_new and not is_vehicle) or (session is not None and message.compid != session.station.compid):
            self._log_foreign(message, now_s)
            return
        if not self._signing.is_valid(message.raw, now_s):
            self.refused_frames += 1
            return
        self._routing.identify(message, source)
        if not self._routing.accept(system, source, now_s, signed=self._signing.on):
            self._found.set()
            return
        self._signing.note(message.raw, now_s)
        self._log(FrameDirection.IN, message.raw)
        if self._routing.moves:
            session = self._after_moves(session)
        if session is None:
            if is_vehicle or is_autopilots_beat(message):
                self._add_vehicle(message)
            return
        session.quality.receive(message.raw)
        if message.is_for(GROUND):
            session.receive(message, now_s)

    def _after_moves(self, session: VehicleSession | None) -> VehicleSession | None:
        """Report moves; forget a session that is not in use yet, unless the move is proved."""
        for move in self._routing.moves:
            if not move.proof and move.sysid not in self._handed_out:
                self.sessions.pop(move.sysid, None)
                session = None
            why = move.proof or "the first one is silent, and neither reports an id"
            self._report(move.sysid, f"is at {move.now} now, no longer at {move.before}: {why}")
        self._routing.moves.clear()
        return session

    def _add_vehicle(self, heartbeat: Message) -> None:
        system = heartbeat.sysid
        silent = _KEY_MISSING if is_signed(heartbeat.raw) and not self._signing.on else ""
        session = VehicleSession(
            heartbeat,
            lambda m: self.send(m, system),
            timers=self._timers,
            transfer=self._transfer,
            silence_reason=silent,
        )
        if silent:
            self._report(system, silent)
        self.sessions[system] = session
        self._found.set()

    def _expect(self, system: int, autopilot: int) -> None:
        def send(message: Message) -> None:
            if self._routing.address(system) is not None:
                self.send(message, system)

        station = Station(system, _AUTOPILOT_COMPONENT)
        self.sessions[system] = VehicleSession.not_heard(
            station, autopilot, send, timers=self._timers, transfer=self._transfer
        )

    def _send(self, message: Message, link: int, address: Address | None) -> None:
        frame = self._codec.encode(message, self._signing.signature(self._loop.time()))
        self._log(FrameDirection.OUT, frame)
        self._endpoints[link].send(frame, address)

    def _log(self, direction: FrameDirection, frame: bytes) -> None:
        """Log a frame. A log that fails does not stop the link."""
        if self._on_frame is not None:
            try:
                self._on_frame(direction, frame)
            except Exception as error:
                self._loop.call_exception_handler({"message": "the log of frames failed", "exception": error})

    def _log_foreign(self, message: Message, now_s: float) -> None:
        if self.unknown.logs(len(message.raw), now_s):
            self._log(FrameDirection.IN, message.raw)

    def _report(self, system: int, text: str) -> None:
        if self._on_notice is not None:
            self._on_notice(LinkNotice(system, text))

    def _report_unknown(self, now_s: float) -> None:
        if self._only is None:
            return
        for text in self.unknown.notices(now_s):
            self._report(0, text)
        for system, address in self._routing.claims(now_s).items() if self._frozen else ():
            if system not in self._claims_reported:
                self._claims_reported.add(system)
                self._report(system, f"is claimed from {address} too: ignored, it does not prove to be this vehicle")

    async def _send_heartbeats(self) -> None:
        while True:
            soon = False
            try:
                soon = self._beat(self._loop.time())
            except Exception as error:  # one heartbeat that fails must not end them
                self._loop.call_exception_handler({"message": "a heartbeat was not sent", "exception": error})
            await asyncio.sleep(_LOOK_S if soon and not self._frozen else _HEARTBEAT_S)

    def _beat(self, now_s: float) -> bool:
        """Send a heartbeat to all; request the id where an address is in doubt. Return whether any is."""
        known = self._routing.addresses()
        for target in known:
            self._send(_HEARTBEAT, target.link, target.address)
        for link in {*range(len(self._endpoints))} - {target.link for target in known}:
            if self._endpoints[link].spec.mode is not LinkMode.LISTEN:  # its peer is known before it sends
                self._send(_HEARTBEAT, link, None)
        asked = self._routing.unidentified(now_s)
        for system, targets in asked.items():
            for target in targets:
                self._send(_identity_request(self.sessions[system]), target.link, target.address)
        self._request_identities(asked)
        self._report_unknown(now_s)
        for session in self.sessions.values():
            session.tick(now_s)
        return bool(asked)

    def _request_identities(self, asked: Collection[int]) -> None:
        """Request the ids of the vehicles of a flight until they are known: the proof if they move."""
        if self._only is None or self._identity_requests > _IDENTITY_REQUESTS:
            return
        self._identity_requests += 1
        for system, session in self.sessions.items():
            if system not in asked and not self._routing.is_identified(system):
                session.send(_identity_request(session))


def _identity_request(session: VehicleSession) -> Message:
    request = CommandSender(MavCommand.REQUEST_MESSAGE, (MessageId.AUTOPILOT_VERSION,), session.exchange)
    return request.start(0.0)[0]
