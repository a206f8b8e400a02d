"""One vehicle's conversation: machines fed with its messages, and answers to wait for.

Knows: the event loop's time, which it hands to the machines. Does not know: sockets (it is given a way to send),
plans, modes of flight. Every wait ends: with an answer, or with `PeerTimeout` that names the vehicle and what was
awaited.
"""

from __future__ import annotations

import asyncio
import random
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager

from gcs.autopilots.flight_modes import autopilot_name
from gcs.autopilots.protocol_timers import CommandTimers, ProtocolTimers
from gcs.autopilots.traits import link_behaviour
from gcs.errors import PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.ftp.requests import FtpNumbers
from gcs.link.microservices.clock import VehicleClock
from gcs.link.microservices.command import CommandRefused, CommandSender, Position
from gcs.link.microservices.machine import Machine
from gcs.link.microservices.parameter import Parameter
from gcs.link.microservices.parameter_transfer import ParameterReader, ParameterWriter
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.microservices.statustext import StatusText, StatusTextJoiner
from gcs.link.mission_protocol.file_upload import FileUpload
from gcs.link.mission_protocol.item_messages import with_home
from gcs.link.mission_protocol.receiver import reader
from gcs.link.mission_protocol.strategy import Preferred, Transfer, uploads_as_file
from gcs.link.mission_protocol.verified_upload import VerifiedUpload
from gcs.link.session.quality import LinkQuality
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import Capability, MavCommand, MessageId, MissionType, ModeFlag
from gcs.mission.model import Home, MissionItem, VehicleMission


class VehicleSession:
    """One vehicle as seen from the ground station. Made by `gcs.link.session.linked_fleet.Fleet`."""

    def __init__(
        self,
        heartbeat: Message,
        send: Callable[[Message], None],
        *,
        me: Station = GROUND,
        timers: ProtocolTimers | None = None,
        transfer: Transfer = Transfer.AUTO,
    ) -> None:
        self.station = heartbeat.source
        self.sysid = heartbeat.sysid  # the vehicle's number among its fellows: its system id unless mapped
        self.me = me
        self.clock = VehicleClock()
        self.quality = LinkQuality()
        own = timers or link_behaviour(int(heartbeat.fields["autopilot"])).timers
        self.round_trip = RttEstimator(own.round_trip)
        self.latest: dict[str, Message] = {}  # the last message of each name
        self.latest_s: dict[str, float] = {}  # ... and when it came, event loop time
        self.texts: deque[tuple[float, StatusText]] = deque(maxlen=200)  # event loop time, sentence
        self._send = send
        self._own_timers = timers
        self._transfer = transfer
        self._numbers = FtpNumbers(random.randrange(1 << 16), random.randrange(1 << 8))
        self._offers_files: bool | None = None
        self._loop = asyncio.get_running_loop()
        self._joiner = StatusTextJoiner()
        self._machines: list[tuple[Machine, asyncio.Event]] = []
        self._listeners: list[Callable[[Message], None]] = []
        self._mission_lock = asyncio.Lock()
        self._command_locks: dict[int, asyncio.Lock] = {}
        self.receive(heartbeat, self._loop.time())

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT of its last heartbeat."""
        return int(self.latest["HEARTBEAT"].fields["autopilot"])

    @property
    def armed(self) -> bool:
        """Whether its last heartbeat says so."""
        return bool(self.latest["HEARTBEAT"].fields["base_mode"] & ModeFlag.ARMED)

    @property
    def custom_mode(self) -> int:
        """The mode of its last heartbeat: the only trustworthy word about it."""
        return int(self.latest["HEARTBEAT"].fields["custom_mode"])

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of its missions is home."""
        return link_behaviour(self.autopilot).home_is_item_0

    @property
    def timers(self) -> ProtocolTimers:
        """The timers of its autopilot, unless the session was given others."""
        return self._own_timers or link_behaviour(self.autopilot).timers

    def heartbeat_age_s(self) -> float:
        """Seconds of local time since its last heartbeat."""
        return self._loop.time() - self.latest_s["HEARTBEAT"]

    def message_age_s(self, name: str) -> float:
        """Seconds of local time since its last message of that name; infinite if there was none."""
        return self._loop.time() - self.latest_s.get(name, float("-inf"))

    def send(self, message: Message) -> None:
        """Sends a message to the vehicle's address; target fields are the caller's."""
        self._send(message)

    def subscribe(self, listener: Callable[[Message], None]) -> Callable[[], None]:
        """Calls `listener` with every message from now on; the result ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def receive(self, message: Message, now_s: float) -> None:
        """Takes in one message of this vehicle (the fleet's business)."""
        self.latest[message.name] = message
        self.latest_s[message.name] = now_s
        self.clock.receive(message, now_s)
        if message.name == "STATUSTEXT":
            self._note(self._joiner.receive(message, now_s), now_s)
        for machine, woken in self._machines:
            answers = machine.receive(message, now_s)
            self._send_all(answers)
            if answers or machine.done:  # its deadline may have come nearer
                woken.set()
        for listener in tuple(self._listeners):
            listener(message)

    def tick(self, now_s: float) -> None:
        """Ends the wait for chunks of text that never came (the fleet's business)."""
        self._note(self._joiner.tick(now_s), now_s)

    async def wait_for(
        self,
        predicate: Callable[[Message], bool],
        timeout_s: float,
        what: str,
        *,
        or_latest: bool = False,
    ) -> Message:
        """The next message that `predicate` holds for; with `or_latest` also one that is already here.

        Raises `PeerTimeout`: "vehicle N: `what` did not come within `timeout_s`".
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
                f"vehicle {self.sysid}: {what} did not come within {timeout_s:g} s.",
                hint=self._silence_hint(),
            ) from None
        finally:
            stop()

    async def command(
        self,
        command: int,
        *params: float,
        position: Position | None = None,
        timers: CommandTimers | None = None,
    ) -> Message:
        """Gives a command and returns its COMMAND_ACK.

        Raises `CommandRefused` with the vehicle's own words where it gave reasons, or `PeerTimeout`.
        """
        async with self._command_locks.setdefault(command, asyncio.Lock()):
            timers = timers or self.timers.command
            machine = CommandSender(command, params, self.station, position=position, me=self.me, timers=timers)
            began_s = self._loop.time()
            try:
                await self.run(machine)
            except CommandRefused as refusal:
                await asyncio.sleep(timers.reason_s)
                reason = "; ".join(t.text for at_s, t in self.texts if at_s >= began_s - timers.reason_s)
                raise (refusal.because(reason) if reason else refusal) from None
            if machine.ack is None:
                raise ProtocolMisuse("a command ended without acknowledgement and without error.")
            return machine.ack

    async def set_message_interval(self, message_id: int, rate_hz: float) -> None:
        """Asks for a message `rate_hz` times per second of vehicle time. Raises as `command` does."""
        await self.command(MavCommand.SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    async def request_message(
        self, message_id: int, name: str, timeout_s: float = 5.0, *, timers: CommandTimers | None = None
    ) -> Message:
        """Asks for one message and returns it: the next that comes, at most `timeout_s` after the acknowledgement.

        Raises as `command` and `wait_for` do.
        """
        found: list[Message] = []
        stop = self.subscribe(lambda m: found.append(m) if m.name == name else None)
        try:
            await self.command(MavCommand.REQUEST_MESSAGE, message_id, timers=timers)
            return found[-1] if found else await self.wait_for(lambda m: m.name == name, timeout_s, name)
        finally:
            stop()

    async def deliver(
        self, items: Sequence[MissionItem], mission_type: int = MissionType.MISSION
    ) -> VerifiedUpload | FileUpload:
        """Sends items as they are (an empty list clears) until the vehicle holds them, read back and compared.

        Returns the finished machine. Raises `PeerError` that lists the differences, `MissionRefused`, `FtpRefused`,
        `PeerTimeout`.
        """
        wanted = self._transfer is Transfer.FILE and mission_type == MissionType.MISSION and len(items) > 0
        if wanted and not link_behaviour(self.autopilot).mission_files:
            raise PeerError(
                f"vehicle {self.sysid} takes no missions as files: {autopilot_name(self.autopilot)} does not.",
                hint="use --transfer auto or items",
            )
        async with self._mission_lock:
            item_by_item = VerifiedUpload(
                items,
                self.station,
                self.autopilot,
                mission_type=mission_type,
                me=self.me,
                timers=self.timers.mission,
                round_trip=self.round_trip,
            )
            may_be_file = uploads_as_file(self._transfer, self.autopilot, mission_type, len(items))
            if not may_be_file or (not wanted and not await self.offers_files()):
                await self.run(item_by_item)
                return item_by_item
            as_file = FileUpload(
                items,
                self.station,
                self.autopilot,
                me=self.me,
                timers=self.timers.ftp,
                round_trip=self.round_trip,
                numbers=self._numbers,
            )
            await self.run(as_file if wanted else Preferred(as_file, item_by_item))
            return as_file if as_file.error is None else item_by_item

    async def offers_files(self) -> bool:
        """Whether it claims MAVLink FTP (AUTOPILOT_VERSION); asked once."""
        if self._offers_files is None:
            told = self.latest.get("AUTOPILOT_VERSION")
            try:
                told = told or await self.request_message(MessageId.AUTOPILOT_VERSION, "AUTOPILOT_VERSION", 2.0)
            except PeerError:
                return False
            self._offers_files = bool(told.fields["capabilities"] & Capability.FTP)
        return self._offers_files

    async def download(self, mission_type: int = MissionType.MISSION) -> tuple[MissionItem, ...]:
        """Reads what the vehicle holds, home included where it is item 0. Raises as `deliver` does."""
        async with self._mission_lock:
            for last in (False, True):
                machine = reader(
                    self.station,
                    self.autopilot,
                    me=self.me,
                    mission_type=mission_type,
                    timers=self.timers.mission,
                    round_trip=self.round_trip,
                )
                try:
                    await self.run(machine)
                except PeerTimeout:
                    if last or not machine.progress:
                        raise
                else:
                    return machine.items
            raise ProtocolMisuse("a download ended without result.")

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Parameters by name. Raises `PeerTimeout` that names one the vehicle does not answer for."""
        reader = ParameterReader(
            names, self.station, self.autopilot, me=self.me, timers=self.timers.parameter, round_trip=self.round_trip
        )
        await self.run(reader)
        return reader.values

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Sets parameters in the vehicle's own types. Raises `PeerError`, `UsageError`."""
        await self.run(
            ParameterWriter(
                parameters,
                self.station,
                self.autopilot,
                me=self.me,
                timers=self.timers.parameter,
                round_trip=self.round_trip,
            )
        )

    async def home(self) -> Home | None:
        """Where its home is; None where it does not tell."""
        try:
            told = (await self.request_message(MessageId.HOME_POSITION, "HOME_POSITION", 2.0)).fields
        except PeerError:
            return None
        return Home(told["latitude"] / 1e7, told["longitude"] / 1e7, told["altitude"] / 1e3)

    async def upload_mission(self, mission: VehicleMission) -> VerifiedUpload | FileUpload:
        """Delivers a mission, with home where the autopilot wants it. Raises as `deliver` does."""
        return await self.deliver(self.as_sent(mission.items, mission.home))

    def as_sent(self, items: Sequence[MissionItem], home: Home) -> tuple[MissionItem, ...]:
        """A mission's items as this autopilot is sent them."""
        return with_home(items, home) if self.home_is_item_0 else tuple(items)

    async def run(self, machine: Machine) -> None:
        """Lets a machine talk to the vehicle until it is done. Raises its error."""
        async with self._fed(machine) as woken:
            self._send_all(machine.start(self._loop.time()))
            while not machine.done:
                woken.clear()
                deadline_s = machine.deadline_s
                if deadline_s is None:
                    raise ProtocolMisuse(f"a {type(machine).__name__} waits without a deadline.")
                try:
                    async with asyncio.timeout_at(deadline_s):
                        await woken.wait()
                except TimeoutError:
                    self._send_all(machine.tick(self._loop.time()))
        if machine.error is not None:
            raise machine.error

    @asynccontextmanager
    async def _fed(self, machine: Machine) -> AsyncIterator[asyncio.Event]:
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

    def _note(self, texts: list[StatusText], now_s: float) -> None:
        self.texts.extend((now_s, text) for text in texts)

    def _silence_hint(self) -> str:
        age_s = self.heartbeat_age_s()
        if age_s > 3.0:
            return f"its last heartbeat came {age_s:.1f} s ago: check the vehicle and the link"
        return "its heartbeat is there: it is alive and did not answer"
