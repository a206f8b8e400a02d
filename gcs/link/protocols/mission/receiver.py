"""MissionReceiver: requests the peer's mission, item by item, and acknowledges the whole.

It follows the MAVLink mission protocol. Numbers in brackets are the rules in `gcs.link.protocols.mission.rules`.

    state      event                                       next       sends
    IDLE       start (ground station: a download)          LISTED     MISSION_REQUEST_LIST
    IDLE       MISSION_COUNT (vehicle: an upload)          PULLING    request 0
    LISTED     MISSION_COUNT                               PULLING    request 0
    LISTED     reply_s passed                              LISTED     MISSION_REQUEST_LIST            (5)
    PULLING    the requested item                          PULLING    requests up to the window's end (1, 4, 10)
    PULLING    ... the last one                            DONE       MISSION_ACK ACCEPTED            (7)
    PULLING    ... refused by `check` or `capacity`        FAILED     MISSION_ACK of refusal
    PULLING    MISSION_COUNT that was not requested        PULLING    request 0                       (6)
    PULLING    item_s passed                               PULLING    the same request                (5)
    PULLING    an item of the window, not the next one     PULLING                                    (10)
    DONE       the last item again                         DONE       MISSION_ACK ACCEPTED            (7)
    any        MISSION_ACK of refusal                      FAILED                                     (8)
    any        ... ERROR, DENIED, CANCELLED, RttEstimator  same: doubt, until answered                (8)
    any        retries used up, or give_up_s               FAILED     MISSION_ACK OPERATION_CANCELLED (9)
    any        cancel                                      FAILED     MISSION_ACK OPERATION_CANCELLED

MISSION_COUNT 0 leads directly to DONE. Items that were not requested, or came before, are ignored.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from gcs.autopilots.protocol_timers import STANDARD, MissionTimers
from gcs.autopilots.traits import link_behaviour
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.mission.item_messages import item_from_message
from gcs.link.protocols.mission.mission_dat import ITEMS_MAX
from gcs.link.protocols.mission.rules import DOUBTFUL, MissionRefused, doubt_s, mission_ack, mission_type_of
from gcs.link.protocols.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from gcs.mavlink_names import mission_result_words
from gcs.mission.model import MissionItem

ItemCheck = Callable[[int, MissionItem], MissionResult]
_ITEMS = ("MISSION_ITEM_INT", "MISSION_ITEM")


class ReceiverState(Enum):
    """The states of the table above."""

    IDLE = auto()
    LISTED = auto()
    PULLING = auto()
    DONE = auto()
    FAILED = auto()


def _accept_any(_seq: int, _item: MissionItem) -> MissionResult:
    return MissionResult.ACCEPTED


class MissionReceiver:
    """One transfer of a mission from `peer` to `me`.

    A ground station calls `start` first. A vehicle that receives MISSION_COUNT creates a receiver and passes it that
    message. `check(seq, item)` can refuse an item with a reason, `capacity` limits the count, and `int_requests=False`
    sends MISSION_REQUEST, as ArduPilot does. With a `round_trip` the wait before a repetition is estimated, at least
    `wait_min_s`. `window` items are requested at a time. `items` is the mission once `done` and `error` is None.
    """

    def __init__(
        self,
        peer: Station,
        *,
        me: Station = GROUND,
        mission_type: int = MissionType.MISSION,
        timers: MissionTimers = STANDARD.mission,
        capacity: int = ITEMS_MAX,
        check: ItemCheck = _accept_any,
        int_requests: bool = True,
        round_trip: RttEstimator | None = None,
        window: int = 1,
        wait_min_s: float = 0.0,
    ) -> None:
        self.peer = peer
        self.me = me
        self.mission_type = mission_type
        self.state = ReceiverState.IDLE
        self.error: GcsError | None = None
        self.count: int | None = None
        self._timers = timers
        self._capacity = capacity
        self._check = check
        self._request_name = "MISSION_REQUEST_INT" if int_requests else "MISSION_REQUEST"
        self._round_trip = round_trip
        self._window = window
        self._wait_min_s = wait_min_s
        self._items: list[MissionItem] = []  # in order, up to the first that is missing
        self._out_of_order: dict[int, MissionItem] = {}  # behind the missing one
        self._requested: dict[int, float | None] = {}  # open requests: time sent, None if sent more than once
        self._listed = False  # we requested the list; else the peer sent MISSION_COUNT
        self._listed_s: float | None = None  # time sent, if sent once
        self._doubt: MissionRefused | None = None
        self._repeats = 0
        self._resend_s = 0.0
        self._give_up_s = 0.0
        self._end_s: float | None = None

    @property
    def done(self) -> bool:
        """Whether the transfer has ended: with success if `error` is None."""
        return self.state in (ReceiverState.DONE, ReceiverState.FAILED)

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The whole mission. Raises `ProtocolMisuse` before it is complete."""
        if self.state is not ReceiverState.DONE:
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

    def start(self, now_s: float) -> list[Message]:
        """Return the request for the peer's mission. Raises `ProtocolMisuse` if called twice."""
        if self.state is not ReceiverState.IDLE:
            raise ProtocolMisuse("a MissionReceiver was started twice: create a new one.")
        self.state = ReceiverState.LISTED
        self._end_s = now_s + self._timers.give_up_s
        self._listed, self._listed_s = True, now_s
        self._progressed(now_s, self._timers.reply_s)
        return [self._request_list()]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if not self._is_ours(message):
            return []
        if self.state is ReceiverState.DONE:
            repeated = message.name in _ITEMS and message.fields["seq"] == len(self._items) - 1
            return [self._ack(MissionResult.ACCEPTED)] if repeated else []
        if self.state is ReceiverState.FAILED:
            return []
        if message.name == "MISSION_COUNT":
            copy = self._listed and self.state is ReceiverState.PULLING and message.fields["count"] == self.count
            return [] if copy else self._begin(message.fields["count"], now_s)
        if self.state is ReceiverState.PULLING and message.name in _ITEMS:
            return self._accept(message, now_s)
        if message.name == "MISSION_ACK" and self.state is not ReceiverState.IDLE:
            self._acknowledged(message.fields["type"], now_s)
        return []

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        deadline_s = self.deadline_s
        if deadline_s is None or now_s < deadline_s:
            return []
        used_up = self._round_trip is None and self._repeats >= self._timers.retries
        if used_up or self._end_s is None or now_s >= min(self._give_up_s, self._end_s):
            self._fail(self._doubt or PeerTimeout(f"{self.peer} stopped answering: {self._awaited()} did not arrive."))
            return [self._ack(MissionResult.OPERATION_CANCELLED)]
        self._repeats += 1
        if self.state is ReceiverState.LISTED:
            self._listed_s = None
            self._resend_s = now_s + self._wait_s(self._timers.reply_s)
            return [self._request_list()]
        self._resend_s = now_s + self._wait_s(self._timers.item_s)
        self._requested = dict.fromkeys(self._requested)
        return [self._request(seq) for seq in sorted(self._requested)]

    def cancel(self) -> list[Message]:
        """End the transfer; return the MISSION_ACK that ends it on the peer."""
        if self.done:
            return []
        self._fail(PeerError(f"the mission transfer from {self.peer} was cancelled."))
        return [self._ack(MissionResult.OPERATION_CANCELLED)]

    def _is_ours(self, message: Message) -> bool:
        return (
            message.comes_from(self.peer) and message.is_for(self.me) and mission_type_of(message) == self.mission_type
        )

    def _begin(self, count: int, now_s: float) -> list[Message]:
        if self.state is not ReceiverState.PULLING:  # a restart does not extend the time limit
            self._end_s = now_s + self._timers.give_up_s * (count + 2)
            if self._round_trip is not None and self._listed_s is not None:
                self._round_trip.learn(now_s - self._listed_s)
        self.state = ReceiverState.PULLING
        self.count = count
        self._items.clear()
        self._out_of_order.clear()
        self._requested.clear()
        if count > self._capacity:
            return self._refuse(MissionResult.NO_SPACE, f"{count} items exceed the capacity of {self._capacity}")
        return self._next_requests(now_s)

    def _accept(self, message: Message, now_s: float) -> list[Message]:
        seq = message.fields["seq"]
        if seq not in self._requested:
            return []
        try:
            item = item_from_message(message)
        except PeerError as error:
            return self._refuse(MissionResult.INVALID_PARAM5_X, error.message)
        verdict = self._check(seq, item)
        if verdict != MissionResult.ACCEPTED:
            return self._refuse(verdict, f"item {seq}: {mission_result_words(verdict)}")
        sent_s = self._requested.pop(seq)
        if self._round_trip is not None and sent_s is not None:
            self._round_trip.learn(now_s - sent_s)
        self._out_of_order[seq] = item
        while len(self._items) in self._out_of_order:
            self._items.append(self._out_of_order.pop(len(self._items)))
        return self._next_requests(now_s)

    def _next_requests(self, now_s: float) -> list[Message]:
        if len(self._items) == self.count:
            self.state = ReceiverState.DONE
            return [self._ack(MissionResult.ACCEPTED)]
        self._progressed(now_s, self._timers.item_s)
        return self._request_more(now_s)

    def _request_more(self, now_s: float) -> list[Message]:
        """Requests for the next items, as many as the window allows."""
        first, end = len(self._items), min(len(self._items) + self._window, self.count or 0)
        new = [seq for seq in range(first, end) if seq not in self._requested and seq not in self._out_of_order]
        self._requested |= dict.fromkeys(new, now_s)
        return [self._request(seq) for seq in new]

    def _wait_s(self, spec_s: float) -> float:
        if self._round_trip is None:
            return spec_s
        return max(self._round_trip.wait_s(self._repeats), self._wait_min_s)

    def _refuse(self, result: MissionResult, reason: str) -> list[Message]:
        self._fail(PeerError(f"the mission of {self.peer} was refused: {reason}."))
        return [self._ack(result)]

    def _acknowledged(self, result: int, now_s: float) -> None:
        if result in (MissionResult.ACCEPTED, MissionResult.INVALID_SEQUENCE):
            return
        refusal = MissionRefused(self.peer, result, len(self._items) if self.state is ReceiverState.PULLING else None)
        if self._round_trip is not None and result in DOUBTFUL:
            self._doubt = refusal
            self._give_up_s = min(self._give_up_s, now_s + doubt_s(self._round_trip, self._timers))
        else:
            self._fail(refusal)

    def _progressed(self, now_s: float, answer_s: float) -> None:
        self._repeats = 0
        self._doubt = None
        self._resend_s = now_s + self._wait_s(answer_s)
        self._give_up_s = now_s + self._timers.give_up_s

    def _fail(self, error: GcsError) -> None:
        self.error = error
        self.state = ReceiverState.FAILED
        self._items.clear()

    def _awaited(self) -> str:
        if self.state is ReceiverState.LISTED:
            return "its MISSION_COUNT"
        return f"its mission item {len(self._items)} of {self.count}"

    def _ack(self, result: MissionResult) -> Message:
        return mission_ack(self.peer, result, self.mission_type)

    def _target(self) -> dict[str, int]:
        return {**self.peer.target, "mission_type": self.mission_type}

    def _request_list(self) -> Message:
        return Message("MISSION_REQUEST_LIST", self._target())

    def _request(self, seq: int) -> Message:
        return Message(self._request_name, {**self._target(), "seq": seq})


def reader(
    peer: Station,
    autopilot: int,
    *,
    me: Station = GROUND,
    mission_type: int = MissionType.MISSION,
    timers: MissionTimers | None = None,
    round_trip: RttEstimator,
) -> MissionReceiver:
    """Return a receiver that downloads with as many requests at a time as this autopilot allows.

    Its `timers` are those of the autopilot's row unless others are given.
    """
    link = link_behaviour(autopilot)
    return MissionReceiver(
        peer,
        me=me,
        mission_type=mission_type,
        timers=timers or link.timers.mission,
        round_trip=round_trip,
        window=link.requests_in_flight,
        wait_min_s=link.timers.mission.request_again_min_s,
    )
