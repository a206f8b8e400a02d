"""VerifiedUpload: items are sent, read back and compared, and sent again until the vehicle has them on board.

It runs MissionSender and MissionReceiver, by the table at the end. Neither a MISSION_ACK nor its loss proves anything:
only the read-back counts. What the autopilots do:
- ArduPilot stores items one by one. A broken transfer leaves a mix of new and old items, so all are sent again.
- PX4 answers a second MISSION_COUNT with "busy" while the first transfer is open. After a break the old transfer is
  cancelled; a transfer of another station is waited for (PX4 forgets it after 5 s).
- ArduPilot answers requests for items in any order, so several are requested at a time. PX4 expects them one by one.
"""

from collections.abc import Sequence

from gcs.errors import GcsError, PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import TIMER, Guard, MachineEvent, MachineState, Table, ignore
from gcs.link.protocols.machine import Transition as Row
from gcs.link.protocols.mission.read_back import compare_missions, read_back_error
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.rules import AMBIGUOUS_RESULTS, MissionRefused, UploadMachine
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.message import Message
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

_READS = 5  # read-backs of one upload
_E, _S = MachineEvent, MachineState


class VerifiedUpload(UploadMachine):
    """Items of one type for one vehicle; an empty list clears those on board.

    For ArduPilot item 0 of a mission is home. It reads back as the vehicle's own and is not compared.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        exchange: Exchange,
        *,
        mission_type: int = MissionType.MISSION,
        tries: int = 4,
    ) -> None:
        super().__init__(UPLOAD, exchange, items, mission_type)
        self.sent = 0  # how often the items were sent
        self._tries = tries
        self._busy = 0
        self._sender = self._new_sender()
        self._reader = self._new_reader()
        self._until_s = 0.0
        self._doubt: GcsError | None = None  # an ERROR during an upload that then failed its read-back

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return self._until_s if self.state is _S.WAITING else super().deadline_s

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.state is _S.WAITING and now_s >= self._until_s:
            return self._follow(_E.WAIT, TIMER, now_s)
        return super().tick(now_s)

    def _difference(self) -> GcsError | None:
        if self._machine is not self._reader:
            return None
        first = int(self.exchange.link.home_is_item_0 and self.mission_type == MissionType.MISSION)
        on_board = self._reader.items[first:]
        differences = compare_missions(self.items[first:], on_board, autopilot=self.exchange.autopilot)
        return (self._doubt or read_back_error(self.peer, self.mission_type, differences)) if differences else None

    def _all_sent(self) -> bool:
        sender = self._sender
        return sender.error is None or (isinstance(sender.error, PeerTimeout) and sender.all_sent and sender.heard)

    def _is_busy(self) -> bool:
        error = self._failure
        if not isinstance(error, MissionRefused) or error.result not in AMBIGUOUS_RESULTS:
            return False
        return error.seq is None and error.result != MissionResult.OPERATION_CANCELLED

    def _is_final(self) -> bool:
        error = self._failure
        return error.result not in AMBIGUOUS_RESULTS if isinstance(error, MissionRefused) else not self._sender.heard

    def _is_gone(self) -> bool:
        return isinstance(self._failure, PeerTimeout) and self._reader.count is None and self._reads > 1

    def _is_lost(self) -> bool:
        error = self._reader.error
        return isinstance(error, PeerTimeout) or (isinstance(error, MissionRefused) and error.seq is not None)

    def _new_sender(self) -> MissionSender:
        frames = self.mission_type != MissionType.RALLY or self.exchange.link.rally_integer_frames
        return MissionSender(self.items, self.exchange, mission_type=self.mission_type, integer_frames=frames)

    def _new_reader(self) -> MissionReceiver:
        return MissionReceiver(self.exchange, mission_type=self.mission_type)

    def _send(self, _: Message, now_s: float) -> list[Message]:
        self.sent += 1
        self._machine = self._sender = self._new_sender()
        return self._sender.start(now_s)

    def _send_again(self, _: Message, now_s: float) -> list[Message]:
        return [self._ack(MissionResult.OPERATION_CANCELLED), *self._send(TIMER, now_s)]

    def _read_back(self, _: Message, now_s: float) -> list[Message]:
        self._doubt = self._sender.doubt
        self._reads = 0
        return self._read(TIMER, now_s)

    def _read(self, _: Message, now_s: float) -> list[Message]:
        self._reads += 1
        self._machine = self._reader = self._new_reader()
        return self._reader.start(now_s)

    def _wait(self, _: Message, now_s: float) -> list[Message]:
        self._busy += 1
        self.sent -= 1  # the vehicle refused the whole try
        self._until_s = now_s + self._timers.busy_s
        self._machine = None
        return []

    def _end_on_board(self, _message: Message, _now_s: float) -> list[Message]:
        self.error = self._failure
        return [self._ack(MissionResult.OPERATION_CANCELLED)]


_M = VerifiedUpload
_If = Guard[_M]
_SENT = _If("every item was sent, acknowledged or not", lambda m, _: m._all_sent())
_WAITS = _If("busy, fewer than `tries` times", lambda m, _: m._is_busy() and m._busy + 1 < m._tries)
_BUSY = _If("busy", lambda m, _: m._is_busy())
_FINAL = _If("an item or the count is refused for good, or no answer at all", lambda m, _: m._is_final())
_TRIES = _If("sent fewer than `tries` times", lambda m, _: m.sent < m._tries)
_EQUAL = _If("equal by meaning", lambda m, _: m._failure is None)
_DIFFERENT = _If("different", lambda m, _: m._reader.error is None)
_DIFFERENT_TRIES = _If(
    "different, sent fewer than `tries` times", lambda m, _: m._reader.error is None and m.sent < m._tries
)
_GONE = _If("no answer at all, and not for the first time", lambda m, _: m._is_gone())
_LOST = _If(
    f"timeout, or refused in the middle, fewer than {_READS} times", lambda m, _: m._is_lost() and m._reads < _READS
)
_AGAIN, _CANCEL = "MISSION_ACK OPERATION_CANCELLED, the items again", "MISSION_ACK OPERATION_CANCELLED"
_OPEN = (_S.IDLE, _S.SENDING, _S.READING, _S.WAITING)

UPLOAD: Table[VerifiedUpload] = Table(
    Row((_S.IDLE,), _E.START, None, _S.SENDING, _M._send, "the start of a MissionSender"),
    Row((_S.SENDING,), _E.ENDED, _SENT, _S.READING, _M._read_back, "the start of a MissionReceiver"),
    Row((_S.SENDING,), _E.ENDED, _WAITS, _S.WAITING, _M._wait),
    Row((_S.SENDING,), _E.ENDED, _BUSY, _S.FAILED, _M._end),
    Row((_S.SENDING,), _E.ENDED, _FINAL, _S.FAILED, _M._end),
    Row((_S.SENDING,), _E.ENDED, _TRIES, None, _M._send_again, _AGAIN),
    Row((_S.SENDING,), _E.ENDED, None, _S.FAILED, _M._end_on_board, _CANCEL),
    Row((_S.READING,), _E.ENDED, _EQUAL, _S.DONE, ignore),
    Row((_S.READING,), _E.ENDED, _DIFFERENT_TRIES, _S.SENDING, _M._send, "the items again"),
    Row((_S.READING,), _E.ENDED, _DIFFERENT, _S.FAILED, _M._end),
    Row((_S.READING,), _E.ENDED, _GONE, _S.FAILED, _M._end),
    Row((_S.READING,), _E.ENDED, _LOST, None, _M._read, "the start of a MissionReceiver"),
    Row((_S.READING,), _E.ENDED, _TRIES, _S.SENDING, _M._send_again, _AGAIN),
    Row((_S.READING,), _E.ENDED, None, _S.FAILED, _M._end_on_board, _CANCEL),
    Row((_S.WAITING,), _E.WAIT, None, _S.SENDING, _M._send, "the items again"),
    Row(_OPEN, _E.CANCEL, None, _S.FAILED, _M._cancelled, "the end of a transfer"),
)
