"""MissionSender: offers a mission and answers the peer's requests for its items.

It follows the MAVLink mission protocol. Numbers in brackets are the rules in `gcs.link.protocols.mission.rules`.

    state      event                                         next       sends
    IDLE       start                                         OFFERED    MISSION_COUNT
    OFFERED    MISSION_REQUEST(_INT) seq                     SENDING    item seq                        (1, 3)
    OFFERED    MISSION_REQUEST_LIST                          OFFERED    MISSION_COUNT
    OFFERED    reply_s passed                                OFFERED    MISSION_COUNT                   (5)
    SENDING    MISSION_REQUEST(_INT) seq                     SENDING    item seq                        (1, 3)
    SENDING    ... and every item has been sent              ALL_SENT   item seq
    SENDING    its wait passed, with a RttEstimator          SENDING    the same item and the next      (5)
    ALL_SENT   MISSION_REQUEST(_INT) seq                     ALL_SENT   item seq                        (3)
    ALL_SENT   reply_s passed                                ALL_SENT   the last item                   (5)
    ALL_SENT   MISSION_ACK ACCEPTED                          DONE                                       (8)
    ALL_SENT   MISSION_ACK ERROR, last item was repeated     FAILED                                     (8, 11)
    ALL_SENT   ack_s without MISSION_ACK, RttEstimator       FAILED                                     (11)
    any        MISSION_ACK of refusal                        FAILED                                     (8)
    any        ... ERROR, DENIED, CANCELLED, RttEstimator    same: doubt, until the next request        (8)
    any        some waits in doubt                           FAILED                                     (8)
    any        give_up_s without progress                    FAILED                                     (9)
    any        cancel                                        FAILED     MISSION_ACK OPERATION_CANCELLED

An empty mission clears the peer's. It starts in ALL_SENT, with MISSION_COUNT in place of the last item.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, auto

from gcs.autopilots.protocol_timers import STANDARD, MissionTimers
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.rules import DOUBTFUL, MissionRefused, doubt_s, mission_ack, mission_type_of
from gcs.link.protocols.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

_REQUESTS = ("MISSION_REQUEST_INT", "MISSION_REQUEST")


class SenderState(Enum):
    """The states of the table above."""

    IDLE = auto()
    OFFERED = auto()
    SENDING = auto()
    ALL_SENT = auto()
    DONE = auto()
    FAILED = auto()


class MissionSender:
    """One transfer of `items` from `me` to `peer`.

    With a `round_trip` the wait before a repetition is estimated. `integer_frames`: see `item_to_message`.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        peer: Station,
        *,
        me: Station = GROUND,
        mission_type: int = MissionType.MISSION,
        timers: MissionTimers = STANDARD.mission,
        current: int = 0,
        round_trip: RttEstimator | None = None,
        integer_frames: bool = True,
    ) -> None:
        self.items = tuple(items)
        self.peer = peer
        self.me = me
        self.mission_type = mission_type
        self.state = SenderState.IDLE
        self.error: GcsError | None = None
        self._timers = timers
        self._current = current
        self._integer_frames = integer_frames
        self._sent: set[int] = set()
        self._last_seq: int | None = None  # the last answered request
        self._repeats = 0
        self.heard = False  # whether the peer answered at all
        self.doubt: MissionRefused | None = None  # a refusal that may answer a late copy
        self._counts_repeated = 0
        self._round_trip = round_trip
        self._sent_s: float | None = None  # time of the message that awaits an answer, if sent once
        self._last_repeated = False
        self._resend_s = 0.0
        self._give_up_s = 0.0
        self._end_s = 0.0

    @property
    def done(self) -> bool:
        """Whether the transfer has ended: with success if `error` is None."""
        return self.state in (SenderState.DONE, SenderState.FAILED)

    @property
    def all_sent(self) -> bool:
        """Whether every item was sent at least once: if MISSION_ACK was lost, the peer may have all of them."""
        return self.state is not SenderState.IDLE and len(self._sent) == len(self.items)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done or self.state is SenderState.IDLE:
            return None
        last = min(self._give_up_s, self._end_s)
        return min(self._resend_s, last) if self._may_resend else last

    def start(self, now_s: float) -> list[Message]:
        """Return the offer of the mission. Raises `ProtocolMisuse` if called twice."""
        if self.state is not SenderState.IDLE:
            raise ProtocolMisuse("a MissionSender was started twice: create a new one.")
        self.state = SenderState.OFFERED if self.items else SenderState.ALL_SENT
        self._end_s = now_s + self._timers.give_up_s * (len(self.items) + 2)
        self._progressed(now_s)
        self._sent_s = now_s
        return [self._count()]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.state is SenderState.IDLE:
            raise ProtocolMisuse("a MissionSender received a message before it was started.")
        if self.done or not message.name.startswith("MISSION_") or not self._is_ours(message):
            return []
        self.heard = True
        if message.name in _REQUESTS:
            return self._answer(message.fields["seq"], now_s)
        if message.name == "MISSION_REQUEST_LIST" and self.state is SenderState.OFFERED:
            return [self._count()]
        if message.name == "MISSION_ACK":
            self._acknowledged(message.fields["type"], now_s)
        return []

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done or self.state is SenderState.IDLE:
            return []
        if now_s >= min(self._give_up_s, self._end_s):
            timeout = PeerTimeout(f"{self.peer} stopped answering: {self._awaited()} did not arrive.")
            self._fail(timeout if self.doubt is None or self.all_sent else self.doubt)
            return []
        if not self._may_resend or now_s < self._resend_s:
            return []
        self._repeats += 1
        self._resend_s = now_s + self._wait_s()
        self._sent_s = None
        if self.state is SenderState.OFFERED or not self.items:
            self._counts_repeated += 1
            return [self._count()]
        if self._round_trip is not None and self._last_seq is not None:
            return self._repeat_item(self._last_seq)
        self._last_repeated = True
        return [self._item(len(self.items) - 1)]

    def cancel(self) -> list[Message]:
        """End the transfer; return the MISSION_ACK that ends it on the peer."""
        if self.done:
            return []
        self._fail(PeerError(f"the mission transfer to {self.peer} was cancelled."))
        return [mission_ack(self.peer, MissionResult.OPERATION_CANCELLED, self.mission_type)]

    @property
    def _may_resend(self) -> bool:
        if self._round_trip is not None:
            return True
        return self.state is not SenderState.SENDING and self._repeats < self._timers.retries

    def _is_ours(self, message: Message) -> bool:
        return (
            message.comes_from(self.peer) and message.is_for(self.me) and mission_type_of(message) == self.mission_type
        )

    def _answer(self, seq: int, now_s: float) -> list[Message]:
        if seq >= len(self.items):
            return []
        self._mark_sent(seq)
        if seq != self._last_seq:
            if self._round_trip is not None and self._sent_s is not None:
                self._round_trip.learn(now_s - self._sent_s)
            self._last_seq = seq
            self._progressed(now_s)
            self._sent_s = now_s
        else:
            self._sent_s = None
        self.state = SenderState.ALL_SENT if self.all_sent else SenderState.SENDING
        self._resend_s = now_s + self._wait_s()
        return [self._item(seq)]

    def _repeat_item(self, seq: int) -> list[Message]:
        """The last requested item and the next one: the peer waits for one of them."""
        repeated = range(seq, min(seq + 2, len(self.items)))
        before = self.all_sent
        for one in repeated:
            self._mark_sent(one)
        if self.all_sent and not before:  # the receiver may have all items, and its MISSION_ACK was lost
            self._give_up_s = min(self._give_up_s, self._resend_s + self._timers.ack_s)
        self.state = SenderState.ALL_SENT if self.all_sent else SenderState.SENDING
        return [self._item(one) for one in repeated]

    def _mark_sent(self, seq: int) -> None:
        self._last_repeated |= seq == len(self.items) - 1 and seq in self._sent
        self._sent.add(seq)

    def _wait_s(self) -> float:
        return self._timers.reply_s if self._round_trip is None else self._round_trip.wait_s(self._repeats)

    def _acknowledged(self, result: int, now_s: float) -> None:
        if self._round_trip is not None and result in DOUBTFUL:
            self.doubt = MissionRefused(self.peer, result, self._last_seq)
            self._give_up_s = min(self._give_up_s, now_s + doubt_s(self._round_trip, self._timers))
        elif result == MissionResult.ACCEPTED:
            if self.state is SenderState.ALL_SENT:
                self.state = SenderState.DONE
        elif result == MissionResult.INVALID_SEQUENCE:
            pass
        elif result == MissionResult.ERROR and self._counts_repeated:
            self._counts_repeated -= 1
        elif result == MissionResult.ERROR and self._last_repeated:
            self._fail(PeerTimeout(f"{self.peer} has ended the transfer, and {self._awaited()} did not arrive."))
        else:
            self._fail(MissionRefused(self.peer, result, self._last_seq))

    def _progressed(self, now_s: float) -> None:
        self.doubt = None
        self._repeats = 0
        self._resend_s = now_s + self._wait_s()
        at_the_end = self._last_seq is not None and self._last_seq == len(self.items) - 1
        timeout_s = min(self._timers.give_up_s, self._timers.ack_s) if self._round_trip and at_the_end else None
        self._give_up_s = now_s + (timeout_s or self._timers.give_up_s)

    def _fail(self, error: GcsError) -> None:
        self.error = error
        self.state = SenderState.FAILED

    def _awaited(self) -> str:
        if self.state is SenderState.OFFERED:
            return "its request for the first mission item"
        if self.state is SenderState.ALL_SENT:
            return "its MISSION_ACK after the last item"
        return f"its request after mission item {self._last_seq} of {len(self.items)}"

    def _count(self) -> Message:
        return Message(
            "MISSION_COUNT", {**self.peer.target, "count": len(self.items), "mission_type": self.mission_type}
        )

    def _item(self, seq: int) -> Message:
        return item_to_message(
            self.items[seq],
            seq,
            self.peer,
            current=seq == self._current,
            mission_type=self.mission_type,
            integer_frames=self._integer_frames,
        )
