"""VerifiedUpload: items are sent, read back and compared, and sent again until the vehicle has them on board.

It runs MissionSender and MissionReceiver, which follow the MAVLink mission protocol.

    state     event                                           next      sends
    IDLE      start                                           SENDING   the start of a MissionSender
    SENDING   every item sent, acknowledged or not            READING   the start of a MissionReceiver
    SENDING   refused for good: an item, a count              FAILED
    SENDING   busy                                            WAITING
    SENDING   timeout, cancelled, ERROR without a reason      SENDING   the items again, `tries` in all
    READING   equal by meaning                                DONE
    READING   timeout, or refused in the middle               READING   the read-back again, up to 5 times
    READING   different, busy, or still no answer             SENDING   the items again
    WAITING   BUSY_S passed                                   SENDING

Neither a MISSION_ACK nor its loss proves anything: only the read-back counts. What the autopilots do:
- ArduPilot stores items one by one. A broken transfer leaves a mix of new and old items, so all are sent again.
- PX4 answers a second MISSION_COUNT with "busy" while the first transfer is open. After a break the old transfer is
  cancelled; a transfer of another station is waited for (PX4 forgets it after 5 s).
- ArduPilot answers requests for items in any order, so several are requested at a time. PX4 expects them one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.protocol_timers import MissionTimers
from gcs.autopilots.traits import link_behaviour
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.mission.read_back import Difference, compare_missions, read_back_error
from gcs.link.protocols.mission.receiver import MissionReceiver, reader
from gcs.link.protocols.mission.rules import DOUBTFUL, MissionRefused, mission_ack
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.protocols.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from gcs.mavlink_names import mission_type_words
from gcs.mission.model import MissionItem

_READS = 5  # read-backs of one upload


class UploadState(Enum):
    """The states of the table above."""

    IDLE = auto()
    SENDING = auto()
    READING = auto()
    WAITING = auto()
    DONE = auto()
    FAILED = auto()


class VerifiedUpload:
    """Items of one type for one vehicle; an empty list clears those on board.

    For ArduPilot item 0 of a mission is home. It reads back as the vehicle's own and is not compared.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        peer: Station,
        autopilot: int,
        *,
        mission_type: int = MissionType.MISSION,
        me: Station = GROUND,
        timers: MissionTimers | None = None,
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
        self.sent = 0  # how often the items were sent
        self.sending_ended_s: float | None = None  # end of the last upload
        self._link = link_behaviour(autopilot)
        self._timers = timers or self._link.timers.mission
        self._round_trip = round_trip or RttEstimator()
        self._tries = tries
        self._busy = 0
        self._machine: MissionSender | MissionReceiver | None = None
        self._reads_left = 0
        self._until_s = 0.0
        self._last_error: GcsError | None = None
        self._doubt: GcsError | None = None  # an ERROR during an upload that then failed its read-back

    @property
    def done(self) -> bool:
        """Whether it has ended: with success (these items are on board) if `error` is None."""
        return self.state in (UploadState.DONE, UploadState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.state is UploadState.WAITING:
            return self._until_s
        return None if self.done or self._machine is None else self._machine.deadline_s

    def start(self, now_s: float) -> list[Message]:
        """Return the first messages. Raises `ProtocolMisuse` if called twice."""
        if self.state is not UploadState.IDLE:
            raise ProtocolMisuse("a VerifiedUpload was started twice: create a new one.")
        return self._send(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done or self._machine is None or self.state is UploadState.WAITING:
            return []
        return self._machine.receive(message, now_s) + self._advance(now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done or self._machine is None:
            return []
        if self.state is UploadState.WAITING:
            return self._send(now_s) if now_s >= self._until_s else []
        return self._machine.tick(now_s) + self._advance(now_s)

    def cancel(self) -> list[Message]:
        """End the upload. What is on board is then unknown."""
        if self.done:
            return []
        messages = self._machine.cancel() if self._machine is not None else []
        self._fail(
            PeerError(f"the upload of the {mission_type_words(self.mission_type)} to {self.peer} was cancelled.")
        )
        return messages

    def _advance(self, now_s: float) -> list[Message]:
        machine = self._machine
        if machine is None or not machine.done:
            return []
        if isinstance(machine, MissionSender):
            return self._after_sending(machine, now_s)
        return self._after_read_back(machine, now_s)

    def _after_sending(self, machine: MissionSender, now_s: float) -> list[Message]:
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
        return self._cancel_on_board() + self._send(now_s)

    def _after_read_back(self, machine: MissionReceiver, now_s: float) -> list[Message]:
        error = machine.error
        if error is None:
            differences = self._differences(machine.items)
            if not differences:
                self.state = UploadState.DONE
                return []
            self._last_error = self._doubt or read_back_error(self.peer, self.mission_type, differences)
            return self._send(now_s)
        self._last_error = error
        self._reads_left -= 1
        if isinstance(error, PeerTimeout) and machine.count is None and self._reads_left < _READS - 1:
            return self._fail(error)  # the vehicle does not answer any more
        lost = isinstance(error, PeerTimeout) or (isinstance(error, MissionRefused) and error.seq is not None)
        if lost and self._reads_left > 0:  # PX4 ends a transfer at a request for an earlier item
            return self._read(now_s)
        return self._cancel_on_board() + self._send(now_s)  # the transfer may still be open on board

    def _differences(self, read_back: tuple[MissionItem, ...]) -> list[Difference]:
        first = int(self._link.home_is_item_0 and self.mission_type == MissionType.MISSION)
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
            integer_frames=self.mission_type != MissionType.RALLY or self._link.rally_integer_frames,
        )
        self._machine = machine
        return machine.start(now_s)

    def _read(self, now_s: float) -> list[Message]:
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
        self.sent -= 1  # the vehicle refused the whole try
        self.state = UploadState.WAITING
        self._until_s = now_s + self._timers.busy_s
        return []

    def _cancel_on_board(self) -> list[Message]:
        return [mission_ack(self.peer, MissionResult.OPERATION_CANCELLED, self.mission_type)]

    def _fail(self, error: GcsError) -> list[Message]:
        self.error = error
        self.state = UploadState.FAILED
        return []
