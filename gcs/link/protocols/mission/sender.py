"""MissionSender: offers a mission and answers the peer's requests for its items.

It follows the MAVLink mission protocol (`gcs.link.protocols.mission.rules`), by the table at the end.
"""

import math
from collections.abc import Sequence

from gcs.errors import PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import TIMER, Guard, MachineEvent, MachineState, Table, ignore
from gcs.link.protocols.machine import Transition as Row
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.rules import EVENTS, IN_DOUBT, NO_REFUSAL, MissionMachine, MissionRefused, doubt_s
from gcs.link.wire.message import Message
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

_E, _S = MachineEvent, MachineState
_OPEN = (_S.OFFERED, _S.SENDING, _S.ALL_SENT)


class MissionSender(MissionMachine):
    """One transfer of `items` to the peer, which begin with the first; `integer_frames`: `item_to_message`."""

    def __init__(
        self,
        items: Sequence[MissionItem],
        exchange: Exchange,
        *,
        mission_type: int = MissionType.MISSION,
        integer_frames: bool = True,
    ) -> None:
        super().__init__(SENDER, exchange, mission_type)
        self.items = tuple(items)
        self.heard = False  # whether the peer answered at all
        self.doubt: MissionRefused | None = None  # a refusal that may answer a late copy
        self._counts_repeated = 0
        self._last_repeated = False
        self._integer_frames = integer_frames
        self._sent: set[int] = set()
        self._last_seq: int | None = None  # the last answered request
        self._sent_s: float | None = None  # time of the message that awaits an answer, if sent once
        self._resend_s = 0.0
        self._give_up_s = 0.0
        self._end_s = 0.0

    @property
    def all_sent(self) -> bool:
        """Whether every item was sent at least once: if MISSION_ACK was lost, the peer may have all of them."""
        return self.state is not _S.IDLE and len(self._sent) == len(self.items)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done or self.state is _S.IDLE:
            return None
        last = min(self._give_up_s, self._end_s)
        return min(self._resend_s, last) if self._row(_E.WAIT, TIMER) else last

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.state is _S.IDLE:
            raise ProtocolMisuse("a MissionSender received a message before it was started.")
        if not message.name.startswith("MISSION_") or not self._is_ours(message):
            return []
        self.heard |= not self.done
        event = EVENTS.get(message.name)
        return [] if event is None else self._follow(event, message, now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if now_s >= min(self._give_up_s, self._end_s):
            return self._follow(_E.LIMIT, TIMER, now_s)
        return self._follow(_E.WAIT, TIMER, now_s) if now_s >= self._resend_s else []

    @property
    def _next_seq(self) -> int:
        return min((self._last_seq or 0) + 1, len(self.items) - 1)

    def _completes(self, seq: int) -> bool:
        return len(self._sent) + (seq not in self._sent) == len(self.items)

    def _offer(self, _: Message, now_s: float) -> list[Message]:
        self._end_s = now_s + self._timers.give_up_s * (len(self.items) + 2)
        self._progressed(now_s)
        self._sent_s = now_s
        return [self._count()]

    def _offer_again(self, _message: Message, _now_s: float) -> list[Message]:
        return [self._count()]

    def _answer(self, request: Message, now_s: float) -> list[Message]:
        seq = request.fields["seq"]
        self._mark_sent(seq)
        if seq != self._last_seq:
            if self.exchange.estimates and self._sent_s is not None:
                self.exchange.round_trip.learn(now_s - self._sent_s)
            self._last_seq = seq
            self._progressed(now_s)
            self._sent_s = now_s
        else:
            self._sent_s = None
        self._resend_s = now_s + self._wait_s()
        return [self._item(seq)]

    def _repeat_count(self, _: Message, now_s: float) -> list[Message]:
        self._repeated(now_s)
        self._counts_repeated += 1
        return [self._count()]

    def _repeat_last(self, _: Message, now_s: float) -> list[Message]:
        self._repeated(now_s)
        self._last_repeated = True
        return [self._item(len(self.items) - 1)]

    def _repeat_item(self, _: Message, now_s: float) -> list[Message]:
        """The last requested item and the next one: the peer waits for one of them."""
        self._repeated(now_s)
        repeated = range(self._last_seq or 0, self._next_seq + 1)
        before = self.all_sent
        for one in repeated:
            self._mark_sent(one)
        if self.all_sent and not before:  # the receiver may have all items, and its MISSION_ACK was lost
            self._give_up_s = min(self._give_up_s, self._resend_s + self._timers.ack_s)
        return [self._item(one) for one in repeated]

    def _doubt_it(self, ack: Message, now_s: float) -> list[Message]:
        self.doubt = self._refusal(ack)
        self._give_up_s = min(self._give_up_s, now_s + doubt_s(self.exchange))
        return []

    def _forgive(self, _message: Message, _now_s: float) -> list[Message]:
        self._counts_repeated -= 1
        return []

    def _refused(self, ack: Message, _: float) -> list[Message]:
        return self._fail(self._refusal(ack))

    def _lost_ack(self, _message: Message, _now_s: float) -> list[Message]:
        return self._fail(PeerTimeout(f"{self.peer} has ended the transfer, and {self._awaited()} did not arrive."))

    def _doubted(self, _message: Message, _now_s: float) -> list[Message]:
        return [] if self.doubt is None else self._fail(self.doubt)

    def _silent(self, _message: Message, _now_s: float) -> list[Message]:
        return self._fail(PeerTimeout(f"{self.peer} stopped answering: {self._awaited()} did not arrive."))

    def _cancelled(self, _message: Message, _now_s: float) -> list[Message]:
        self._fail(PeerError(f"the mission transfer to {self.peer} was cancelled."))
        return [self._ack(MissionResult.OPERATION_CANCELLED)]

    def _repeated(self, now_s: float) -> None:
        self._repeats += 1
        self._resend_s = now_s + self._wait_s()
        self._sent_s = None

    def _mark_sent(self, seq: int) -> None:
        self._last_repeated |= seq == len(self.items) - 1 and seq in self._sent
        self._sent.add(seq)

    def _wait_s(self) -> float:
        return self.exchange.round_trip.wait_s(self._repeats) if self.exchange.estimates else self._timers.reply_s

    def _progressed(self, now_s: float) -> None:
        self.doubt = None
        self._repeats = 0
        self._resend_s = now_s + self._wait_s()
        at_the_end = self._last_seq is not None and self._last_seq == len(self.items) - 1
        ack_s = self._timers.ack_s if self.exchange.estimates and at_the_end else math.inf
        self._give_up_s = now_s + min(self._timers.give_up_s, ack_s)

    def _refusal(self, ack: Message) -> MissionRefused:
        return MissionRefused(self.peer, ack.fields["type"], self._last_seq)

    def _awaited(self) -> str:
        if self.state is _S.OFFERED:
            return "its request for the first mission item"
        if self.state is _S.ALL_SENT:
            return "its MISSION_ACK after the last item"
        return f"its request after mission item {self._last_seq} of {len(self.items)}"

    def _count(self) -> Message:
        fields = {**self.peer.target, "count": len(self.items), "mission_type": self.mission_type}
        return Message("MISSION_COUNT", fields)

    def _item(self, seq: int) -> Message:
        return item_to_message(
            self.items[seq],
            seq,
            self.peer,
            current=seq == 0,
            mission_type=self.mission_type,
            integer_frames=self._integer_frames,
        )


_M = MissionSender
_If = Guard[_M]


def _is_error(ack: Message) -> bool:
    return bool(ack.fields["type"] == MissionResult.ERROR)


_EMPTY = _If("the mission is empty", lambda m, _: not m.items)
_NO_SUCH_ITEM = _If("there is no such item", lambda m, request: request.fields["seq"] >= len(m.items))
_COMPLETES = _If("it is the last one not yet sent", lambda m, request: m._completes(request.fields["seq"]))
_REPEATS = _If("round trips are estimated, or `retries` are left", lambda m, _: m._may_repeat)
_REPEATS_EMPTY = _If("the mission is empty, and as below", lambda m, _: m._may_repeat and not m.items)
_ESTIMATES = _If("round trips are estimated", lambda m, _: m.exchange.estimates)
_NEXT_COMPLETES = _If(
    "round trips are estimated, the next item is the last one not yet sent",
    lambda m, _: m.exchange.estimates and m._completes(m._next_seq),
)
_ACCEPTED = _If("ACCEPTED", lambda _, ack: ack.fields["type"] == MissionResult.ACCEPTED)
_BUSY = _If("ERROR, and MISSION_COUNT was repeated", lambda m, ack: _is_error(ack) and m._counts_repeated > 0)
_OVER = _If("ERROR, and the last item was repeated", lambda m, ack: _is_error(ack) and m._last_repeated)
_DOUBTED = _If("after a doubt, and not all items were sent", lambda m, _: m.doubt is not None and not m.all_sent)

SENDER: Table[MissionSender] = Table(
    Row((_S.IDLE,), _E.START, _EMPTY, _S.ALL_SENT, _M._offer, "MISSION_COUNT 0"),
    Row((_S.IDLE,), _E.START, None, _S.OFFERED, _M._offer, "MISSION_COUNT"),
    Row((_S.OFFERED,), _E.REQUEST_LIST, None, None, _M._offer_again, "MISSION_COUNT"),
    Row((_S.OFFERED,), _E.WAIT, _REPEATS, None, _M._repeat_count, "MISSION_COUNT", "5"),
    Row(_OPEN, _E.REQUEST, _NO_SUCH_ITEM, None, ignore),
    Row(_OPEN, _E.REQUEST, _COMPLETES, _S.ALL_SENT, _M._answer, "the item", "1, 3"),
    Row(_OPEN, _E.REQUEST, None, _S.SENDING, _M._answer, "the item", "1, 3"),
    Row((_S.SENDING,), _E.WAIT, _NEXT_COMPLETES, _S.ALL_SENT, _M._repeat_item, "the same item and the next", "5"),
    Row((_S.SENDING,), _E.WAIT, _ESTIMATES, None, _M._repeat_item, "the same item and the next", "5"),
    Row((_S.ALL_SENT,), _E.WAIT, _REPEATS_EMPTY, None, _M._repeat_count, "MISSION_COUNT 0", "5"),
    Row((_S.ALL_SENT,), _E.WAIT, _ESTIMATES, None, _M._repeat_item, "the same item and the next", "5"),
    Row((_S.ALL_SENT,), _E.WAIT, _REPEATS, None, _M._repeat_last, "the last item", "5"),
    Row(_OPEN, _E.MISSION_ACK, IN_DOUBT, None, _M._doubt_it, "", "8"),
    Row((_S.ALL_SENT,), _E.MISSION_ACK, _ACCEPTED, _S.DONE, ignore, "", "8"),
    Row(_OPEN, _E.MISSION_ACK, NO_REFUSAL, None, ignore, "", "8"),
    Row(_OPEN, _E.MISSION_ACK, _BUSY, None, _M._forgive, "", "8"),
    Row(_OPEN, _E.MISSION_ACK, _OVER, _S.FAILED, _M._lost_ack, "", "8, 11"),
    Row(_OPEN, _E.MISSION_ACK, None, _S.FAILED, _M._refused, "", "8"),
    Row(_OPEN, _E.LIMIT, _DOUBTED, _S.FAILED, _M._doubted, "", "8"),
    Row(_OPEN, _E.LIMIT, None, _S.FAILED, _M._silent, "", "9, 11"),
    Row((_S.IDLE, *_OPEN), _E.CANCEL, None, _S.FAILED, _M._cancelled, "MISSION_ACK OPERATION_CANCELLED"),
)
