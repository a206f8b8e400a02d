"""All vehicles on one endpoint: found by their heartbeats, told ours.

Knows: one codec, one endpoint, a session per vehicle, the event loop. Does not know: what is said in the
sessions. Frames of unknown systems, of other ground stations and of other components are logged and left alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager, suppress
from enum import Enum

from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.link.codec import Codec
from gcs.link.dialect import Autopilot, MavState, MavType
from gcs.link.endpoint import Address, AddressBook, Endpoint, LinkMode
from gcs.link.endpoint_udp import UdpEndpoint
from gcs.link.message import GROUND, Message, Station
from gcs.link.mission import GROUND_TIMERS, Timers
from gcs.link.session import VehicleSession

_HEARTBEAT_S = 1.0


class Direction(Enum):
    """Which way a frame went."""

    IN = "in"
    OUT = "out"


FrameHook = Callable[[Direction, bytes], None]


class Fleet:
    """The ground station's end of a link. Use it as `async with Fleet.open(spec) as fleet`."""

    def __init__(
        self,
        endpoint: Endpoint,
        *,
        me: Station = GROUND,
        on_frame: FrameHook | None = None,
        timers: Timers = GROUND_TIMERS,
    ) -> None:
        self.me = me
        self.sessions: dict[int, VehicleSession] = {}
        self._endpoint = endpoint
        self._codec = Codec(*me)
        self._book = AddressBook()
        self._on_frame = on_frame
        self._timers = timers
        self._found = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    @classmethod
    @asynccontextmanager
    async def open(
        cls,
        spec: str,
        *,
        me: Station = GROUND,
        on_frame: FrameHook | None = None,
        timers: Timers = GROUND_TIMERS,
    ) -> AsyncIterator[Fleet]:
        """Opens the endpoint that `spec` names (see `parse_link_spec`) and says so with a heartbeat at 1 Hz.

        `on_frame(direction, frame)` sees every frame in and out; `timers` are those of mission transfers.
        Raises `UsageError`, `LinkError`.
        """
        endpoint = UdpEndpoint(spec)
        fleet = cls(endpoint, me=me, on_frame=on_frame, timers=timers)
        await endpoint.open(fleet.receive)
        beating = asyncio.ensure_future(fleet._beat(calling=endpoint.spec.mode is LinkMode.CALL))
        try:
            yield fleet
        finally:
            beating.cancel()
            with suppress(asyncio.CancelledError):
                await beating
            endpoint.close()

    @property
    def local_address(self) -> Address:
        """Where vehicles can send to; tells the port that was free when the link asked for port 0."""
        return self._endpoint.local_address

    async def vehicles(self, sysids: Collection[int], timeout_s: float) -> dict[int, VehicleSession]:
        """The sessions of these vehicles, once each has been heard.

        Raises `PeerTimeout` that names the silent ones, or `DuplicateSystemId`.
        """
        end_s = self._loop.time() + timeout_s
        while True:
            self.check()
            missing = sorted(set(sysids) - self.sessions.keys())
            if not missing:
                return {sysid: self.sessions[sysid] for sysid in sorted(sysids)}
            self._found.clear()
            try:
                async with asyncio.timeout_at(end_s):
                    await self._found.wait()
            except TimeoutError:
                raise PeerTimeout(
                    f"no heartbeat from {_vehicles(missing)} within {timeout_s:g} s"
                    f" (heard: {', '.join(map(str, sorted(self.sessions))) or 'none'}).",
                    hint="start them, or check the address and port they send to",
                ) from None

    def check(self) -> None:
        """Raises `DuplicateSystemId` if two vehicles claimed one system id since the link was opened."""
        for conflict in self._book.conflicts.values():
            raise conflict

    def send(self, message: Message, sysid: int) -> None:
        """Sends a message to where system `sysid` was heard. Raises `ProtocolMisuse` if it never was."""
        address = self._book.address(sysid)
        if address is None:
            raise ProtocolMisuse(f"{message.name} was to be sent to system {sysid}, which was never heard.")
        self._send(message, address)

    def receive(self, data: bytes, address: Address) -> None:
        """Takes in one datagram (the endpoint's business)."""
        now_s = self._loop.time()
        for message in self._codec.decode(data, address):
            if self._on_frame is not None:
                self._on_frame(Direction.IN, message.raw)
            session = self.sessions.get(message.sysid)
            if session is None and not _is_vehicle(message):
                continue
            if session is not None and message.compid != session.station.compid:
                continue
            if not self._book.claim(message.sysid, address, now_s):
                self._found.set()
            elif session is None:
                self._meet(message)
            else:
                session.receive(message, now_s)

    def _meet(self, heartbeat: Message) -> None:
        sysid = heartbeat.sysid
        self.sessions[sysid] = VehicleSession(heartbeat, lambda m: self.send(m, sysid), me=self.me, timers=self._timers)
        self._found.set()

    def _send(self, message: Message, address: Address | None) -> None:
        frame = self._codec.encode(message)
        if self._on_frame is not None:
            self._on_frame(Direction.OUT, frame)
        self._endpoint.send(frame, address)

    async def _beat(self, *, calling: bool) -> None:
        heartbeat = Message(
            "HEARTBEAT",
            {
                "type": int(MavType.GCS),
                "autopilot": int(Autopilot.INVALID),
                "base_mode": 0,
                "custom_mode": 0,
                "system_status": int(MavState.ACTIVE),
                "mavlink_version": 3,
            },
        )
        while True:
            addresses: set[Address | None] = {*self._book.addresses()}
            if calling and not addresses:
                addresses = {None}
            for address in addresses:
                self._send(heartbeat, address)
            for session in self.sessions.values():
                session.tick(self._loop.time())
            await asyncio.sleep(_HEARTBEAT_S)


def _is_vehicle(message: Message) -> bool:
    return (
        message.name == "HEARTBEAT"
        and message.fields["type"] != MavType.GCS
        and message.fields["autopilot"] != Autopilot.INVALID
    )


def _vehicles(sysids: list[int]) -> str:
    return ("vehicle " if len(sysids) == 1 else "vehicles ") + ", ".join(map(str, sysids))
