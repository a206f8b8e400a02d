"""Delivery: items are sent, read back, compared, and sent again until the vehicle holds what it was sent.

Knows: senders, receivers, and what each autopilot does to a transfer that breaks off. Does not know: sockets, clocks
(time is an argument), where items come from.

    state     event                                           next      sends
    IDLE      start                                           SENDING   what a MissionSender starts with
    SENDING   every item sent, acknowledged or not            READING   what a MissionReceiver starts with
    SENDING   refused for good: an item, a count              FAILED
    SENDING   busy                                            WAITING
    SENDING   silence, cancelled, an ERROR without a reason   SENDING   ... once more, `tries` in all
    READING   equal by meaning                                DONE
    READING   silence, or refused in the middle               READING   ... once more, some times
    READING   different, busy, or still silent                SENDING   ... once more
    WAITING   busy_s passed                                   SENDING

A MISSION_ACK proves nothing, and neither does its loss: only what is read back counts. Habits:
- ArduPilot stores items one by one, so a transfer that breaks off leaves a mix of new and old ones: it is sent again.
- PX4 calls a second MISSION_COUNT "busy" while the first transfer goes on: after a break the old one is cancelled; one
  that somebody else began is waited out (it forgets after 5 s).
- ArduPilot answers requests for items in any order: several are asked for at a time. PX4 follows them one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.mission_protocol.read_back import Difference, compare_missions, not_held
from gcs.link.mission_protocol.receiver import MissionReceiver, reader
from gcs.link.mission_protocol.rules import DOUBTFUL, GROUND_TIMERS, MissionRefused, Timers, mission_ack
from gcs.link.mission_protocol.sender import MissionSender
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

BUSY_S = 6.0  # PX4 forgets a broken-off transfer after 5 s
_READS = 5  # of one upload
_NAMES = {int(MissionType.MISSION): "mission", int(MissionType.FENCE): "fence", int(MissionType.RALLY): "rally points"}


class UploadState(Enum):
    """See the table above."""

    IDLE = auto()
    SENDING = auto()
    READING = auto()
    WAITING = auto()
    DONE = auto()
    FAILED = auto()


class VerifiedUpload:
    """Items of one type for one vehicle; an empty list clears what it holds.

    For ArduPilot item 0 of a mission is home, as it is sent; it reads back as the vehicle's own and is not compared.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        peer: Station,
        autopilot: int,
        *,
        mission_type: int = MissionType.MISSION,
        me: Station = GROUND,
        timers: Timers = GROUND_TIMERS,
        round_trip: RttEstimator | None = None,
        tries: int = 4,
    ) -> None:
        self.items = tuple(items)
        self.peer = peer
        self.me = me
        self.mission_type = mission_type
        self.autopilot = autopilot
        self.state = UploadState.IDLE
        self.error: GcsError | None = None
        self.sent = 0  # times the items were sent
        self.read = 0  # times they were read back
        self.sending_ended_s: float | None = None  # when the last upload was over
        self._timers = timers
        self._round_trip = round_trip or RttEstimator()
        self._tries = tries
        self._busy = 0
        self._broken = False  # an earlier try may still be under way on board
        self._machine: MissionSender | MissionReceiver | None = None
        self._reads_left = 0
        self._until_s = 0.0
        self._last_error: GcsError | None = None
        self._doubt: GcsError | None = None  # an ERROR that came with what was then not held

    @property
    def name(self) -> str:
        """What is delivered, for people."""
        return _NAMES.get(self.mission_type, f"items of type {self.mission_type}")

    @property
    def done(self) -> bool:
        """Whether it ended, well (`error` is None: the vehicle holds these items) or badly."""
        return self.state in (UploadState.DONE, UploadState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        if self.state is UploadState.WAITING:
            return self._until_s
        return None if self.done or self._machine is None else self._machine.deadline_s

    def start(self, now_s: float) -> list[Message]:
        """Begins. Raises `ProtocolMisuse` when called twice."""
        if self.state is not UploadState.IDLE:
            raise ProtocolMisuse("a Delivery was started twice; make a new one for a new delivery.")
        return self._send(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """What the message calls for; nothing for messages of other conversations."""
        if self.done or self._machine is None or self.state is UploadState.WAITING:
            return []
        return self._machine.receive(message, now_s) + self._go_on(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """What the passing of time calls for."""
        if self.done or self._machine is None:
            return []
        if self.state is UploadState.WAITING:
            return self._send(now_s) if now_s >= self._until_s else []
        return self._machine.tick(now_s) + self._go_on(now_s)

    def cancel(self) -> list[Message]:
        """Ends the delivery from our side; what the vehicle holds is not known then."""
        if self.done:
            return []
        told = self._machine.cancel() if self._machine is not None else []
        self._fail(PeerError(f"the {self.name} for {self.peer} was cancelled half way."))
        return told

    def _go_on(self, now_s: float) -> list[Message]:
        machine = self._machine
        if machine is None or not machine.done:
            return []
        if isinstance(machine, MissionSender):
            return self._sent(machine, now_s)
        return self._read_back(machine, now_s)

    def _sent(self, machine: MissionSender, now_s: float) -> list[Message]:
        error = machine.error
        if error is None or (isinstance(error, PeerTimeout) and machine.all_sent and machine.heard):
            self._reads_left = _READS
            self._doubt = machine.doubt
            return self._read(now_s)
        self._last_error = error
        if isinstance(error, MissionRefused):
            if error.result not in DOUBTFUL:
                return self._fail(error)
            if error.seq is None and error.result != MissionResult.OPERATION_CANCELLED:
                self._busy += 1
                return self._wait(now_s) if self._busy < self._tries else self._fail(error)
        elif not machine.heard:
            return self._fail(error)
        return self._break_off() + self._send(now_s)

    def _read_back(self, machine: MissionReceiver, now_s: float) -> list[Message]:
        error = machine.error
        if error is None:
            differences = self._differences(machine.items)
            if not differences:
                self.state = UploadState.DONE
                return []
            self._last_error = self._doubt or not_held(self.peer, self.name, differences)
            return self._send(now_s)
        self._last_error = error
        self._reads_left -= 1
        if isinstance(error, PeerTimeout) and machine.count is None and self._reads_left < _READS - 1:
            return self._fail(error)  # it does not listen any more
        lost = isinstance(error, PeerTimeout) or (isinstance(error, MissionRefused) and error.seq is not None)
        if lost and self._reads_left > 0:  # PX4 gives up on who asks for an item twice removed
            return self._read(now_s)
        return self._break_off() + self._send(now_s)  # it may be in the middle of the transfer

    def _differences(self, read_back: tuple[MissionItem, ...]) -> list[Difference]:
        first = int(self.autopilot == Autopilot.ARDUPILOT and self.mission_type == MissionType.MISSION)
        return compare_missions(self.items[first:], read_back[first:], autopilot=self.autopilot)

    def _send(self, now_s: float) -> list[Message]:
        if self.sent >= self._tries and self._last_error is not None:
            return self._fail(self._last_error)
        self.sent += 1
        self.state = UploadState.SENDING
        machine = MissionSender(
            self.items,
            self.peer,
            me=self.me,
            mission_type=self.mission_type,
            timers=self._timers,
            round_trip=self._round_trip,
            resumes=self._broken,
        )
        self._machine = machine
        return machine.start(now_s)

    def _read(self, now_s: float) -> list[Message]:
        self.read += 1
        if self.state is UploadState.SENDING:
            self.sending_ended_s = now_s
        self.state = UploadState.READING
        machine = reader(
            self.peer,
            self.autopilot,
            me=self.me,
            mission_type=self.mission_type,
            timers=self._timers,
            round_trip=self._round_trip,
        )
        self._machine = machine
        return machine.start(now_s)

    def _wait(self, now_s: float) -> list[Message]:
        self.sent -= 1  # it was not listened to
        self.state = UploadState.WAITING
        self._until_s = now_s + BUSY_S
        return []

    def _break_off(self) -> list[Message]:
        self._broken = True
        return [mission_ack(self.peer, MissionResult.OPERATION_CANCELLED, self.mission_type)]

    def _fail(self, error: GcsError) -> list[Message]:
        self.error = error
        self.state = UploadState.FAILED
        return []
