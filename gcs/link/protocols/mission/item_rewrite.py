"""ItemRewrite: replaces single items of a mission on board, reads each back and compares it.

It follows the table at the end. MISSION_WRITE_PARTIAL_LIST names a range of items; here always one. ArduPilot answers
it with a request for that item. A MISSION_ACK proves nothing, and its loss does no harm: only the read-back counts. The
other items stay as they are. After FAILED an item on board is the old one or the new one.
"""

from collections.abc import Mapping

from gcs.errors import GcsError, PeerError, PeerTimeout
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import TIMER, Guard, MachineEvent, MachineState, Table, ignore
from gcs.link.protocols.machine import Transition as Row
from gcs.link.protocols.mission.item_messages import item_from_message, item_to_message
from gcs.link.protocols.mission.read_back import compare_missions, read_back_error
from gcs.link.protocols.mission.rules import (
    AMBIGUOUS_RESULTS,
    EVENTS,
    IN_DOUBT,
    NO_REFUSAL,
    MissionMachine,
    MissionRefused,
    doubt_s,
)
from gcs.link.wire.message import Message
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

_E, _S = MachineEvent, MachineState
_OPEN = (_S.OFFERED, _S.SENT, _S.READING)


class ItemRewrite(MissionMachine):
    """The items `items`, by their number on the wire, in place of those on board.

    With `look_first` an item that is on board already is not sent.
    """

    def __init__(
        self, items: Mapping[int, MissionItem], exchange: Exchange, *, tries: int = 8, look_first: bool = False
    ) -> None:
        super().__init__(REWRITE, exchange, MissionType.MISSION)
        self._waiting = sorted(items.items())
        self._tries = tries
        self._look_first = look_first
        self._tries_left = tries
        self._sent_s: float | None = None  # time of the message that awaits an answer, if sent once
        self._resend_s = 0.0
        self._give_up_s = 0.0
        self._failure: GcsError | None = None  # of the last try
        self._unlike: GcsError | None = None  # why the item that was read back is not the one to have

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return min(self._resend_s, self._give_up_s) if self.state in _OPEN else None

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        event = EVENTS.get(message.name)
        if event is None or not self._is_ours(message):
            return []
        if event is not _E.MISSION_ACK and message.fields.get("seq") != self._seq:
            return []
        if event is _E.ITEM and self.state is _S.READING:
            event = self._take(message, now_s)
        return self._follow(event, message, now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if now_s >= self._give_up_s:
            return self._follow(_E.LIMIT, TIMER, now_s)
        return self._follow(_E.WAIT, TIMER, now_s) if now_s >= self._resend_s else []

    @property
    def _seq(self) -> int:
        return self._waiting[0][0] if self._waiting else 0

    def _take(self, message: Message, now_s: float) -> MachineEvent:
        """Compare the item that was read back; the next one follows if it is the one to have."""
        self._learn(now_s)
        try:
            on_board = item_from_message(message)
        except PeerError as error:
            self._unlike = error
            return _E.UNUSABLE_ITEM
        differences = compare_missions([self._waiting[0][1]], [on_board], autopilot=self.exchange.autopilot)
        if differences:
            self._unlike = read_back_error(self.peer, MissionType.MISSION, differences)
            return _E.DIFFERENT_ITEM
        self._waiting.pop(0)
        return _E.ITEM

    def _next_look(self, _: Message, now_s: float) -> list[Message]:
        self._next_item(now_s)
        return self._read(TIMER, now_s)

    def _next_offer(self, _: Message, now_s: float) -> list[Message]:
        self._next_item(now_s)
        return self._offer(TIMER, now_s)

    def _offer(self, _: Message, now_s: float) -> list[Message]:
        self._tries_left -= 1
        self._sent_s = now_s
        return self._await(now_s, self._offered())

    def _offer_different(self, _: Message, now_s: float) -> list[Message]:
        self._failure = self._failure or self._unlike
        return self._offer(TIMER, now_s)

    def _offer_again(self, _: Message, now_s: float) -> list[Message]:
        self._repeats += 1
        return self._await(now_s, self._offered())

    def _send(self, _: Message, now_s: float) -> list[Message]:
        self._learn(now_s)
        self._progressed(now_s)
        return self._send_again(TIMER, now_s)

    def _send_again(self, _: Message, now_s: float) -> list[Message]:
        self._sent_s = None  # the read-back is measured instead
        return self._send_lost(TIMER, now_s)

    def _send_lost(self, _: Message, now_s: float) -> list[Message]:
        seq, item = self._waiting[0]
        return self._await(now_s, item_to_message(item, seq, self.peer))

    def _read(self, _: Message, now_s: float) -> list[Message]:
        self._repeats = 0
        messages = self._await(now_s, self._question())
        self._sent_s = now_s
        return messages

    def _read_refused(self, ack: Message, now_s: float) -> list[Message]:
        self._failure = self._refusal(ack)
        return self._read(TIMER, now_s)

    def _read_again(self, _: Message, now_s: float) -> list[Message]:
        self._repeats += 1
        return self._await(now_s, self._question())

    def _doubt_it(self, ack: Message, now_s: float) -> list[Message]:
        self._failure = self._refusal(ack)
        wait_s = doubt_s(self.exchange)
        self._give_up_s = min(self._give_up_s, now_s + wait_s)
        self._resend_s = max(self._resend_s, now_s + wait_s / 4)
        return []

    def _refused(self, ack: Message, _: float) -> list[Message]:
        return self._fail(self._refusal(ack))

    def _different(self, _message: Message, _now_s: float) -> list[Message]:
        self.error = self._failure or self._unlike
        return []

    def _unusable(self, _message: Message, _now_s: float) -> list[Message]:
        self.error = self._unlike
        return []

    def _silent(self, _message: Message, _now_s: float) -> list[Message]:
        silence = PeerTimeout(f"{self.peer} stopped answering while mission item {self._seq} was replaced.")
        return self._fail(self._failure or silence)

    def _cancelled(self, _message: Message, _now_s: float) -> list[Message]:
        return self._fail(PeerError(f"the change of mission item {self._seq} of {self.peer} was cancelled."))

    def _await(self, now_s: float, message: Message) -> list[Message]:
        if self._repeats:
            self._sent_s = None
        self._resend_s = now_s + self.exchange.round_trip.wait_s(self._repeats)
        return [message]

    def _learn(self, now_s: float) -> None:
        if self._sent_s is not None:
            self.exchange.round_trip.learn(now_s - self._sent_s)
        self._sent_s = None

    def _next_item(self, now_s: float) -> None:
        self._failure = None
        self._tries_left = self._tries
        self._progressed(now_s)

    def _progressed(self, now_s: float) -> None:
        self._repeats = 0
        self._give_up_s = now_s + self._timers.give_up_s

    def _refusal(self, ack: Message) -> MissionRefused:
        return MissionRefused(self.peer, ack.fields["type"], self._seq)

    def _offered(self) -> Message:
        fields = {**self.peer.target, "start_index": self._seq, "end_index": self._seq}
        return Message("MISSION_WRITE_PARTIAL_LIST", {**fields, "mission_type": int(MissionType.MISSION)})

    def _question(self) -> Message:
        fields = {**self.peer.target, "seq": self._seq, "mission_type": int(MissionType.MISSION)}
        return Message("MISSION_REQUEST_INT", fields)


_M = ItemRewrite
_If = Guard[_M]
_NONE_LEFT = _If("no item is left", lambda m, _: not m._waiting)
_LOOKS = _If("`look_first`", lambda m, _: m._look_first)
_FIRST_LOOK = _If("`look_first`, and it was not sent yet", lambda m, _: m._look_first and m._tries_left == m._tries)
_TRIES = _If("sent fewer than `tries` times", lambda m, _: m._tries_left > 0)
_PLAIN = _If("accepted, or in doubt", lambda _, ack: ack.fields["type"] in (MissionResult.ACCEPTED, *AMBIGUOUS_RESULTS))
_DENIED = _If("DENIED: it awaits the item", lambda _, ack: ack.fields["type"] == MissionResult.DENIED)
_OFFER, _QUESTION = "MISSION_WRITE_PARTIAL_LIST", "MISSION_REQUEST_INT"

REWRITE: Table[ItemRewrite] = Table(
    Row((_S.IDLE,), _E.START, _NONE_LEFT, _S.DONE, ignore),
    Row((_S.IDLE,), _E.START, _LOOKS, _S.READING, _M._next_look, _QUESTION),
    Row((_S.IDLE,), _E.START, None, _S.OFFERED, _M._next_offer, _OFFER),
    Row((_S.OFFERED,), _E.REQUEST, None, _S.SENT, _M._send, "the item", "1"),
    Row((_S.OFFERED,), _E.WAIT, None, None, _M._offer_again, _OFFER, "5"),
    Row((_S.SENT, _S.READING), _E.REQUEST, None, None, _M._send_again, "the item", "3"),
    Row((_S.SENT,), _E.WAIT, None, _S.READING, _M._read, _QUESTION),
    Row((_S.SENT,), _E.MISSION_ACK, _PLAIN, _S.READING, _M._read, _QUESTION),
    Row(_OPEN, _E.MISSION_ACK, NO_REFUSAL, None, ignore, "", "8"),
    Row((_S.SENT,), _E.MISSION_ACK, None, _S.READING, _M._read_refused, _QUESTION),
    Row((_S.READING,), _E.MISSION_ACK, _DENIED, None, _M._send_lost, "the item"),
    Row((_S.READING,), _E.WAIT, None, None, _M._read_again, _QUESTION, "5"),
    Row((_S.READING,), _E.ITEM, _NONE_LEFT, _S.DONE, ignore),
    Row((_S.READING,), _E.ITEM, _LOOKS, None, _M._next_look, f"{_QUESTION} of the next item"),
    Row((_S.READING,), _E.ITEM, None, _S.OFFERED, _M._next_offer, f"{_OFFER} of the next item"),
    Row((_S.READING,), _E.DIFFERENT_ITEM, _FIRST_LOOK, _S.OFFERED, _M._offer, _OFFER),
    Row((_S.READING,), _E.DIFFERENT_ITEM, _TRIES, _S.OFFERED, _M._offer_different, _OFFER),
    Row((_S.READING,), _E.DIFFERENT_ITEM, None, _S.FAILED, _M._different),
    Row((_S.READING,), _E.UNUSABLE_ITEM, None, _S.FAILED, _M._unusable),
    Row((_S.OFFERED,), _E.MISSION_ACK, IN_DOUBT, None, _M._doubt_it, "", "8"),
    Row((_S.OFFERED,), _E.MISSION_ACK, None, _S.FAILED, _M._refused, "", "8"),
    Row(_OPEN, _E.LIMIT, None, _S.FAILED, _M._silent, "", "9"),
    Row((_S.IDLE, *_OPEN), _E.CANCEL, None, _S.FAILED, _M._cancelled),
)
