"""The session with one vehicle: runs protocol machines on its messages and the time of the event loop.

Every wait ends with an answer, or with a `PeerTimeout` that names the vehicle and what was awaited.
"""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager

from gcs.autopilots.protocol_timers import CommandTimers, ProtocolTimers
from gcs.autopilots.traits import link_behaviour
from gcs.errors import PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.clock import VehicleClock
from gcs.link.protocols.command import CommandRefused, CommandSender, Position
from gcs.link.protocols.exchange import Exchange, FtpNumbers, RttEstimator
from gcs.link.protocols.machine import Machine
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.item_messages import with_home
from gcs.link.protocols.mission.item_rewrite import ItemRewrite
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.strategy import SentAs, Transfer
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.protocols.parameter_transfer import Parameter, ParameterReader, ParameterWriter
from gcs.link.protocols.statustext import VehicleTexts
from gcs.link.protocols.timesync import ping_answers
from gcs.link.session.items_upload import upload
from gcs.link.wire.frame_scanner import LinkQuality
from gcs.link.wire.message import Message, Station
from gcs.mavlink import Capability, MavCommand, MavType, MessageId, MissionType, ModeFlag
from gcs.mission.model import Home, MissionItem, VehicleMission
from gcs.util.steady_loop import stalls_of


class VehicleSession:
    """One vehicle, as the ground station sees it. `gcs.link.session.linked_fleet.LinkedFleet` creates it."""

    def __init__(
        self,
        heartbeat: Message,
        send: Callable[[Message], None],
        *,
        timers: ProtocolTimers | None = None,
        transfer: Transfer = Transfer.AUTO,
        silence_reason: str = "",
    ) -> None:
        """Of the vehicle that sent this heartbeat; `silence_reason` is why it may not answer, if that is known."""
        self.station = heartbeat.source
        self.sysid = heartbeat.sysid  # the vehicle's number in the plan: its system id unless mapped
        self.clock = VehicleClock()
        self.quality = LinkQuality()
        self.autopilot = int(heartbeat.fields["autopilot"])  # MAV_AUTOPILOT: no later heartbeat changes it
        behaviour = link_behaviour(self.autopilot)
        self.estimator = behaviour.estimator
        self.ready_since_s: float | None = None  # event loop time since which its estimate is ready for flight
        # Other numbers than any session before, but the same in an emulated flight that is flown again.
        drawn = random.Random(f"{asyncio.get_running_loop().time()!r} {self.station}")
        numbers = FtpNumbers(drawn.randrange(1 << 16), drawn.randrange(1 << 8))
        self.exchange = Exchange(self.station, self.autopilot, timers=timers, numbers=numbers)
        self.latest: dict[str, Message] = {}  # the last message of each name
        self.latest_s: dict[str, float] = {}  # ... and its arrival, event loop time
        self.texts = VehicleTexts(behaviour.startup_texts)
        self._send = send
        self._transfer = transfer
        self._offers_files: bool | None = None
        self.sent_as: SentAs | None = None  # of the last mission
        self._loop = asyncio.get_running_loop()
        self._stalls = stalls_of(self._loop)
        self._stalls_seen = self._stalls.count
        self._machines: list[tuple[Machine, asyncio.Event]] = []
        self._listeners: list[Callable[[Message], None]] = []
        self._mission_lock = asyncio.Lock()
        self._command_locks: dict[int, asyncio.Lock] = {}
        self.heard = True  # whether any message came from it
        self._silence_reason = silence_reason
        self.receive(heartbeat, self._loop.time())

    @classmethod
    def not_heard(
        cls,
        station: Station,
        autopilot: int,
        send: Callable[[Message], None],
        *,
        timers: ProtocolTimers | None = None,
        transfer: Transfer = Transfer.AUTO,
    ) -> VehicleSession:
        """Return the session of a vehicle that was not heard yet. Until then it counts as disarmed, and as silent."""
        fields = {"type": int(MavType.QUADROTOR), "autopilot": autopilot, "base_mode": 0, "custom_mode": 0}
        session = cls(Message("HEARTBEAT", fields, *station), send, timers=timers, transfer=transfer)
        session.heard = False
        session.latest_s["HEARTBEAT"] = -math.inf
        return session

    def renumber(self, sysid: int) -> None:
        """Give the vehicle its number in the plan, where that is not its system id."""
        self.sysid = sysid

    @property
    def armed(self) -> bool:
        """Whether it is armed, by its last heartbeat."""
        return bool(self.latest["HEARTBEAT"].fields["base_mode"] & ModeFlag.ARMED)

    @property
    def custom_mode(self) -> int:
        """The flight mode of its last heartbeat, the only reliable source."""
        return int(self.latest["HEARTBEAT"].fields["custom_mode"])

    @property
    def kind(self) -> int:
        """The MAV_TYPE of its last heartbeat."""
        return int(self.latest["HEARTBEAT"].fields["type"])

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of its missions is home."""
        return self.exchange.link.home_is_item_0

    @property
    def timers(self) -> ProtocolTimers:
        """The timers of its autopilot, unless the session was given others."""
        return self.exchange.timers

    @property
    def round_trip(self) -> RttEstimator:
        """The round trips measured so far."""
        return self.exchange.round_trip

    def heartbeat_age_s(self) -> float:
        """Return the local time since its last heartbeat, s."""
        return self._loop.time() - self.latest_s["HEARTBEAT"]

    def silent_s(self) -> float:
        """Return the local time since its last message of any kind, s."""
        return self._loop.time() - max(self.latest_s.values())

    def fresh(self, name: str, at_most_s: float) -> Message | None:
        """Return the last message of this name if it is at most `at_most_s` old, local time."""
        arrived_s = self.latest_s.get(name)
        return self.latest[name] if arrived_s is not None and self._loop.time() - arrived_s <= at_most_s else None

    def send(self, message: Message) -> None:
        """Send a message to the vehicle's address. The caller sets the target fields."""
        self._send(message)

    def subscribe(self, listener: Callable[[Message], None]) -> Callable[[], None]:
        """Call `listener` with every message from now on. Return the function that ends this."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def receive(self, message: Message, now_s: float) -> None:
        """Process one message of this vehicle. Only the fleet calls it."""
        self.heard = True
        self.latest[message.name] = message
        self.latest_s[message.name] = now_s
        host_s = now_s + self._stalls.stood_s
        if self._stalls.count > self._stalls_seen:
            self._stalls_seen = self._stalls.count
            self.clock.stood_still(host_s)
        self.clock.receive(message, host_s)
        if message.name == "STATUSTEXT":
            self.texts.receive(message, now_s)
        elif message.name == "PING":
            self._send_all(ping_answers(message))
        elif message.name == self.estimator.message.name:
            ready = self.estimator.is_ready(message.name, message.fields)
            self.ready_since_s = (self.ready_since_s or now_s) if ready else None
        for machine, wake in self._machines:
            answers = machine.receive(message, now_s)
            self._send_all(answers)
            if answers or machine.done:  # its deadline may be earlier now
                wake.set()
        for listener in tuple(self._listeners):
            listener(message)

    def tick(self, now_s: float) -> None:
        """End the wait for lost chunks of STATUSTEXT. Only the fleet calls it."""
        self.texts.tick(now_s)

    async def wait_for(
        self, predicate: Callable[[Message], bool], timeout_s: float, what: str, *, or_latest: bool = False
    ) -> Message:
        """Return the next message for which `predicate` is true; with `or_latest` also one that has already arrived.

        Raises `PeerTimeout`: "vehicle N: `what` did not arrive within `timeout_s`".
        """
        if or_latest:
            for message in self.latest.values():
                if predicate(message):
                    return message
        found: asyncio.Future[Message] = self._loop.create_future()

        def check(message: Message) -> None:
            if not found.done() and predicate(message):
                found.set_result(message)

        stop = self.subscribe(check)
        try:
            async with asyncio.timeout(timeout_s):
                return await found
        except TimeoutError:
            raise PeerTimeout(
                f"vehicle {self.sysid}: {what} did not arrive within {timeout_s:g} s.", hint=self._silence_hint()
            ) from None
        finally:
            stop()

    async def command(
        self, command: int, *params: float, position: Position | None = None, timers: CommandTimers | None = None
    ) -> Message:
        """Send a command and return its COMMAND_ACK.

        Raises `CommandRefused` with the vehicle's STATUSTEXT as the reason, or `PeerTimeout`.
        """
        async with self._command_locks.setdefault(command, asyncio.Lock()):
            timers = timers or self.timers.command
            machine = CommandSender(command, params, self.exchange, position=position, timers=timers)
            began_s = self._loop.time()
            try:
                await self.run(machine)
            except CommandRefused as refusal:
                await asyncio.sleep(timers.reason_s)
                reason = "; ".join(t.text for at_s, t in self.texts.kept if at_s >= began_s - timers.reason_s)
                raise (refusal.because(reason) if reason else refusal) from None
            if machine.ack is None:
                raise ProtocolMisuse("a command ended without acknowledgement and without error.")
            return machine.ack

    async def set_message_interval(self, message_id: int, rate_hz: float) -> None:
        """Request a message `rate_hz` times per second of vehicle time. Raises as `command` does."""
        await self.command(MavCommand.SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    async def request_message(
        self, message_id: MessageId, timeout_s: float = 5.0, *, timers: CommandTimers | None = None
    ) -> Message:
        """Return one requested message: the next that arrives, at most `timeout_s` after the acknowledgement.

        Raises as `command` and `wait_for` do.
        """
        name = message_id.name
        found: list[Message] = []
        stop = self.subscribe(lambda m: found.append(m) if m.name == name else None)
        try:
            await self.command(MavCommand.REQUEST_MESSAGE, message_id, timers=timers)
            return found[-1] if found else await self.wait_for(lambda m: m.name == name, timeout_s, name)
        finally:
            stop()

    async def upload_items(
        self, items: Sequence[MissionItem], mission_type: int = MissionType.MISSION
    ) -> VerifiedUpload | FileUpload:
        """Upload items unchanged (an empty list clears), read them back and compare, until they are on board.

        Returns the finished machine. Raises `PeerError` that lists the differences, `MissionRefused`, `FtpRefused`,
        `PeerTimeout`.
        """
        async with self._mission_lock:
            machine, way = await upload(self, items, mission_type, self._transfer)
        if mission_type == MissionType.MISSION:
            self.sent_as = way
        return machine

    async def offers_files(self) -> bool | None:
        """Whether it reports MAVLink FTP in AUTOPILOT_VERSION, which is requested once; None if that does not come."""
        if self._offers_files is None:
            version = self.latest.get("AUTOPILOT_VERSION")
            try:
                version = version or await self.request_message(MessageId.AUTOPILOT_VERSION, 2.0)
            except PeerError:
                return None
            self._offers_files = bool(version.fields["capabilities"] & Capability.FTP)
        return self._offers_files

    async def download(self, mission_type: int = MissionType.MISSION) -> tuple[MissionItem, ...]:
        """Return the items on board, including home if it is item 0. Raises as `upload_items` does."""
        async with self._mission_lock:
            for last in (False, True):
                machine = MissionReceiver(self.exchange, mission_type=mission_type)
                try:
                    await self.run(machine)
                except PeerTimeout:
                    if last or not machine.progress:
                        raise
                else:
                    return machine.items
            raise ProtocolMisuse("a download ended without result.")

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Return parameters by the requested names, each with the name and unit that this vehicle has for it.

        Raises `PeerTimeout` that names a parameter without an answer.
        """
        version = self.latest.get("AUTOPILOT_VERSION")
        known = None if version is None else int(version.fields["flight_sw_version"])
        reader = ParameterReader(names, self.exchange, version=known)
        await self.run(reader)
        return reader.values

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Set parameters in the vehicle's own types. Raises `PeerError`, `UsageError`."""
        await self.run(ParameterWriter(parameters, self.exchange))

    async def home(self) -> Home | None:
        """Return its home position; None if it does not report one."""
        try:
            position = (await self.request_message(MessageId.HOME_POSITION, 2.0)).fields
        except PeerError:
            return None
        return Home(position["latitude"] / 1e7, position["longitude"] / 1e7, position["altitude"] / 1e3)

    async def upload_mission(self, mission: VehicleMission) -> VerifiedUpload | FileUpload:
        """Upload a mission, with home as item 0 if the autopilot requires it. Raises as `upload_items` does."""
        return await self.upload_items(self.as_sent(mission.items, mission.home))

    async def replace_items(self, items: Mapping[int, MissionItem], *, look_first: bool = False) -> None:
        """Replace items of the mission on board, by their index without home; read them back and compare.

        Also for a vehicle in flight. With `look_first` items that are on board already are not sent. Raises
        `PeerError`; each of them on board is then the old one or the new one.
        """
        first = int(self.home_is_item_0)
        shifted = {first + index: item for index, item in items.items()}
        async with self._mission_lock:
            await self.run(ItemRewrite(shifted, self.exchange, look_first=look_first))

    def as_sent(self, items: Sequence[MissionItem], home: Home) -> tuple[MissionItem, ...]:
        """Return the items of a mission as this autopilot requires them."""
        return with_home(items, home) if self.home_is_item_0 else tuple(items)

    async def run(self, machine: Machine) -> None:
        """Run a machine until it is done. Raises its error."""
        async with self._attached(machine) as wake:
            self._send_all(machine.start(self._loop.time()))
            while not machine.done:
                wake.clear()
                deadline_s = machine.deadline_s
                if deadline_s is None:
                    raise ProtocolMisuse(f"a {type(machine).__name__} waits without a deadline.")
                try:
                    async with asyncio.timeout_at(deadline_s):
                        await wake.wait()
                except TimeoutError:
                    self._send_all(machine.tick(self._loop.time()))
        if machine.error is not None:
            if self._silence_reason and isinstance(machine.error, PeerTimeout):
                machine.error.advise(f"it {self._silence_reason}")
            raise machine.error

    @asynccontextmanager
    async def _attached(self, machine: Machine) -> AsyncIterator[asyncio.Event]:
        entry = (machine, asyncio.Event())
        self._machines.append(entry)
        try:
            yield entry[1]
        finally:
            self._machines.remove(entry)
            if not machine.done:
                self._send_all(machine.cancel())

    def _send_all(self, messages: list[Message]) -> None:
        for message in messages:
            self._send(message)

    def _silence_hint(self) -> str:
        age_s = self.heartbeat_age_s()
        if age_s > 3.0:
            return f"its last heartbeat is {age_s:.1f} s old: check the vehicle and the link"
        return (
            f"it {self._silence_reason}"
            if self._silence_reason
            else "its heartbeats arrive, but it did not answer: try again"
        )
