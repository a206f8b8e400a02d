"""MissionReceiver: requests the peer's mission, item by item, and acknowledges the whole.

It follows the MAVLink mission protocol (`gcs.link.protocols.mission.rules`), by the table at the end.
"""

from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import TIMER, Guard, MachineEvent, MachineState, Table, ignore
from gcs.link.protocols.machine import Transition as Row
from gcs.link.protocols.mission.item_messages import item_from_message
from gcs.link.protocols.mission.mission_dat import ITEMS_MAX
from gcs.link.protocols.mission.rules import EVENTS, IN_DOUBT, NO_REFUSAL, MissionMachine, MissionRefused, doubt_s
from gcs.link.wire.message import Message
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

_E, _S = MachineEvent, MachineState
_ASKED = (_S.LISTED, _S.PULLING)


class MissionReceiver(MissionMachine):
    """One transfer of the peer's mission.

    A ground station calls `start` first. A vehicle that receives MISSION_COUNT creates a receiver and passes it that
    message. `capacity` limits the count. `window` items are requested at a time; if it is None, as many as the
    autopilot allows. `items` is the mission once `done` and `error` is None.
    """

    def __init__(
        self,
        exchange: Exchange,
        *,
        mission_type: int = MissionType.MISSION,
        capacity: int = ITEMS_MAX,
        window: int | None = None,
    ) -> None:
        super().__init__(RECEIVER, exchange, mission_type)
        self.count: int | None = None
        self._capacity = capacity
        self._window = window or exchange.link.requests_in_flight
        self._items: list[MissionItem] = []  # in order, up to the first that is missing
        self._out_of_order: dict[int, MissionItem] = {}  # behind the missing one
        self._requested: dict[int, float | None] = {}  # open requests: time sent, None if sent more than once
        self._listed = False  # we requested the list; else the peer sent MISSION_COUNT
        self._listed_s: float | None = None  # time sent, if sent once
        self._refusal = ""  # of an item that cannot be used
        self._doubt: MissionRefused | None = None
        self._resend_s = 0.0
        self._give_up_s = 0.0
        self._end_s: float | None = None

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The whole mission. Raises `ProtocolMisuse` before it is complete."""
        if self.state is not _S.DONE:
            raise ProtocolMisuse("the items of a MissionReceiver were read before its transfer succeeded.")
        return tuple(self._items)

    @property
    def progress(self) -> int:
        """The number of items that have arrived, up to the first missing one."""
        return len(self._items)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done or self._end_s is None:
            return None
        return min(self._resend_s, self._give_up_s, self._end_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        event = EVENTS.get(message.name)
        if event is None or not self._is_ours(message):
            return []
        if event is _E.ITEM and message.fields["seq"] in self._requested:
            event = self._take(message)
        return self._follow(event, message, now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        deadline_s = self.deadline_s
        if deadline_s is None or self._end_s is None or now_s < deadline_s:
            return []
        return self._follow(_E.LIMIT if now_s >= min(self._give_up_s, self._end_s) else _E.WAIT, TIMER, now_s)

    def _take(self, message: Message) -> MachineEvent:
        """Keep a requested item, or the reason why it cannot be used."""
        seq = message.fields["seq"]
        try:
            item = item_from_message(message)
        except PeerError as error:
            self._refusal = error.message
            return _E.UNUSABLE_ITEM
        self._out_of_order[seq] = item
        return _E.ITEM

    def _list(self, _: Message, now_s: float) -> list[Message]:
        self._end_s = now_s + self._timers.give_up_s
        self._listed, self._listed_s = True, now_s
        self._progressed(now_s, self._timers.reply_s)
        return [self._request_list()]

    def _list_again(self, _: Message, now_s: float) -> list[Message]:
        self._repeats += 1
        self._listed_s = None
        self._resend_s = now_s + self._wait_s(self._timers.reply_s)
        return [self._request_list()]

    def _begin(self, message: Message, now_s: float) -> list[Message]:
        self._note_count(message.fields["count"], now_s)
        return self._next_requests(now_s)

    def _refuse_count(self, message: Message, now_s: float) -> list[Message]:
        count = message.fields["count"]
        self._note_count(count, now_s)
        return self._refuse(MissionResult.NO_SPACE, f"{count} items exceed the capacity of {self._capacity}")

    def _note_count(self, count: int, now_s: float) -> None:
        if self.state is not _S.PULLING:  # a restart does not extend the time limit
            self._end_s = now_s + self._timers.give_up_s * (count + 2)
            if self.exchange.estimates and self._listed_s is not None:
                self.exchange.round_trip.learn(now_s - self._listed_s)
        self.count = count
        self._items.clear()
        self._out_of_order.clear()
        self._requested.clear()

    def _store(self, message: Message, now_s: float) -> list[Message]:
        sent_s = self._requested.pop(message.fields["seq"])
        if self.exchange.estimates and sent_s is not None:
            self.exchange.round_trip.learn(now_s - sent_s)
        while len(self._items) in self._out_of_order:
            self._items.append(self._out_of_order.pop(len(self._items)))
        return self._next_requests(now_s)

    def _request_again(self, _: Message, now_s: float) -> list[Message]:
        self._repeats += 1
        self._resend_s = now_s + self._wait_s(self._timers.item_s)
        self._requested = dict.fromkeys(self._requested)
        return [self._request(seq) for seq in sorted(self._requested)]

    def _refuse_item(self, _message: Message, _now_s: float) -> list[Message]:
        return self._refuse(MissionResult.INVALID_PARAM5_X, self._refusal)

    def _acknowledge(self, _message: Message, _now_s: float) -> list[Message]:
        return [self._ack(MissionResult.ACCEPTED)]

    def _doubt_it(self, ack: Message, now_s: float) -> list[Message]:
        self._doubt = self._refused_by(ack)
        self._give_up_s = min(self._give_up_s, now_s + doubt_s(self.exchange))
        return []

    def _refused(self, ack: Message, _: float) -> list[Message]:
        return self._fail(self._refused_by(ack))

    def _silent(self, _message: Message, _now_s: float) -> list[Message]:
        silence = PeerTimeout(f"{self.peer} stopped answering: {self._awaited()} did not arrive.")
        return self._cancel(self._doubt or silence)

    def _cancelled(self, _message: Message, _now_s: float) -> list[Message]:
        return self._cancel(PeerError(f"the mission transfer from {self.peer} was cancelled."))

    def _next_requests(self, now_s: float) -> list[Message]:
        """Requests for the next items, as many as the window allows; after the last one the MISSION_ACK."""
        if len(self._items) == self.count:
            return [self._ack(MissionResult.ACCEPTED)]
        self._progressed(now_s, self._timers.item_s)
        first, end = len(self._items), min(len(self._items) + self._window, self.count or 0)
        new = [seq for seq in range(first, end) if seq not in self._requested and seq not in self._out_of_order]
        self._requested |= dict.fromkeys(new, now_s)
        return [self._request(seq) for seq in new]

    def _wait_s(self, spec_s: float) -> float:
        talk = self.exchange
        if not talk.estimates:
            return spec_s
        return max(talk.round_trip.wait_s(self._repeats), talk.link.timers.mission.request_again_min_s)

    def _refuse(self, result: MissionResult, reason: str) -> list[Message]:
        self._fail(PeerError(f"the mission of {self.peer} was refused: {reason}."))
        return [self._ack(result)]

    def _refused_by(self, ack: Message) -> MissionRefused:
        return MissionRefused(self.peer, ack.fields["type"], len(self._items) if self.state is _S.PULLING else None)

    def _progressed(self, now_s: float, answer_s: float) -> None:
        self._repeats = 0
        self._doubt = None
        self._resend_s = now_s + self._wait_s(answer_s)
        self._give_up_s = now_s + self._timers.give_up_s

    def _fail(self, error: GcsError) -> list[Message]:
        self._items.clear()
        return super()._fail(error)

    def _cancel(self, error: GcsError) -> list[Message]:
        self._fail(error)
        return [self._ack(MissionResult.OPERATION_CANCELLED)]

    def _awaited(self) -> str:
        if self.state is _S.LISTED:
            return "its MISSION_COUNT"
        return f"its mission item {len(self._items)} of {self.count}"

    def _request_list(self) -> Message:
        return Message("MISSION_REQUEST_LIST", {**self.peer.target, "mission_type": self.mission_type})

    def _request(self, seq: int) -> Message:
        return Message("MISSION_REQUEST_INT", {**self.peer.target, "mission_type": self.mission_type, "seq": seq})


_M = MissionReceiver
_If = Guard[_M]
_COPY = _If(
    "we requested the list, and it has the same count",
    lambda m, counted: m._listed and counted.fields["count"] == m.count,
)
_TOO_MANY = _If("more than `capacity`", lambda m, counted: counted.fields["count"] > m._capacity)
_NONE = _If("0", lambda _, counted: counted.fields["count"] == 0)
_UNREQUESTED = _If("it is not requested", lambda m, item: item.fields["seq"] not in m._requested)
_COMPLETES = _If("it is the last missing one", lambda m, _: len(m._items) + len(m._out_of_order) == m.count)
_LAST = _If("it is the last one", lambda m, item: item.fields["seq"] == len(m._items) - 1)
_USED_UP = _If("round trips are not estimated, and no `retries` are left", lambda m, _: not m._may_repeat)

RECEIVER: Table[MissionReceiver] = Table(
    Row((_S.IDLE,), _E.START, None, _S.LISTED, _M._list, "MISSION_REQUEST_LIST"),
    Row((_S.LISTED,), _E.WAIT, _USED_UP, _S.FAILED, _M._silent, "MISSION_ACK OPERATION_CANCELLED", "5"),
    Row((_S.LISTED,), _E.WAIT, None, None, _M._list_again, "MISSION_REQUEST_LIST", "5"),
    Row((_S.PULLING,), _E.COUNT, _COPY, None, ignore),
    Row((_S.IDLE, *_ASKED), _E.COUNT, _TOO_MANY, _S.FAILED, _M._refuse_count, "MISSION_ACK NO_SPACE"),
    Row((_S.IDLE, *_ASKED), _E.COUNT, _NONE, _S.DONE, _M._begin, "MISSION_ACK ACCEPTED", "7"),
    Row((_S.IDLE, *_ASKED), _E.COUNT, None, _S.PULLING, _M._begin, "requests from item 0 on", "1, 6, 10"),
    Row((_S.PULLING,), _E.ITEM, _UNREQUESTED, None, ignore),
    Row((_S.PULLING,), _E.ITEM, _COMPLETES, _S.DONE, _M._store, "MISSION_ACK ACCEPTED", "4, 7"),
    Row((_S.PULLING,), _E.ITEM, None, None, _M._store, "requests up to the end of the window", "1, 4, 10"),
    Row((_S.PULLING,), _E.UNUSABLE_ITEM, None, _S.FAILED, _M._refuse_item, "MISSION_ACK of refusal"),
    Row((_S.PULLING,), _E.WAIT, _USED_UP, _S.FAILED, _M._silent, "MISSION_ACK OPERATION_CANCELLED", "5"),
    Row((_S.PULLING,), _E.WAIT, None, None, _M._request_again, "the open requests", "5"),
    Row(_ASKED, _E.MISSION_ACK, NO_REFUSAL, None, ignore, "", "8"),
    Row(_ASKED, _E.MISSION_ACK, IN_DOUBT, None, _M._doubt_it, "", "8"),
    Row(_ASKED, _E.MISSION_ACK, None, _S.FAILED, _M._refused, "", "8"),
    Row((_S.DONE,), _E.ITEM, _LAST, None, _M._acknowledge, "MISSION_ACK ACCEPTED", "7"),
    Row(_ASKED, _E.LIMIT, None, _S.FAILED, _M._silent, "MISSION_ACK OPERATION_CANCELLED", "9"),
    Row((_S.IDLE, *_ASKED), _E.CANCEL, None, _S.FAILED, _M._cancelled, "MISSION_ACK OPERATION_CANCELLED"),
)
