"""ItemRewrite: replaces single items of a mission on board, reads each back and compares it.

MISSION_WRITE_PARTIAL_LIST names a range of items; here always one. ArduPilot answers it with a request for that item.

    state    event                                       next     sends
    IDLE     start                                       OFFERED  MISSION_WRITE_PARTIAL_LIST of the first item
    IDLE     start, with `look_first`                    READING  MISSION_REQUEST_INT of the first item
    OFFERED  MISSION_REQUEST(_INT) of the item           SENT     the item
    OFFERED  its wait passed                             OFFERED  MISSION_WRITE_PARTIAL_LIST
    OFFERED  MISSION_ACK of refusal                      FAILED
    OFFERED  ... ERROR, DENIED or CANCELLED              same: doubt, until the request
    OFFERED  some waits in doubt                         FAILED
    SENT     MISSION_REQUEST(_INT) of the item           SENT     the item
    SENT     MISSION_ACK, or its wait passed             READING  MISSION_REQUEST_INT
    READING  the item, equal by meaning                  OFFERED  ... of the next item; after the last one: DONE
    READING  the item, different                         OFFERED  MISSION_WRITE_PARTIAL_LIST, `tries` in all
    READING  MISSION_REQUEST(_INT) of the item           READING  the item: it was lost
    READING  MISSION_ACK DENIED: it awaits the item      READING  the item
    READING  its wait passed                             READING  MISSION_REQUEST_INT
    any      `tries` used up, or give_up_s               FAILED
    any      cancel                                      FAILED

A MISSION_ACK proves nothing, and its loss does no harm: only the read-back counts. The other items stay as they are.
After FAILED an item on board is the old one or the new one.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, auto

from gcs.autopilots.protocol_timers import MissionTimers
from gcs.autopilots.traits import link_behaviour
from gcs.errors import GcsError, PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.mission.item_messages import item_from_message, item_to_message
from gcs.link.protocols.mission.read_back import compare_missions, read_back_error
from gcs.link.protocols.mission.rules import DOUBTFUL, MissionRefused, doubt_s, mission_type_of
from gcs.link.protocols.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from gcs.mission.model import MissionItem

_REQUESTS = ("MISSION_REQUEST_INT", "MISSION_REQUEST")
_ITEMS = ("MISSION_ITEM_INT", "MISSION_ITEM")


class RewriteState(Enum):
    """The states of the table above."""

    IDLE = auto()
    OFFERED = auto()
    SENT = auto()
    READING = auto()
    DONE = auto()
    FAILED = auto()


class ItemRewrite:
    """The items `items`, by their number on the wire, in place of those on board.

    With `look_first` an item that is on board already is not sent.
    """

    def __init__(
        self,
        items: Mapping[int, MissionItem],
        peer: Station,
        autopilot: int,
        *,
        me: Station = GROUND,
        timers: MissionTimers | None = None,
        round_trip: RttEstimator | None = None,
        tries: int = 8,
        look_first: bool = False,
    ) -> None:
        self.peer = peer
        self.me = me
        self.state = RewriteState.IDLE
        self.error: GcsError | None = None
        self._autopilot = autopilot
        self._timers = timers or link_behaviour(autopilot).timers.mission
        self._round_trip = round_trip or RttEstimator()
        self._waiting = sorted(items.items())
        self._tries = tries
        self._look_first = look_first
        self._tries_left = tries
        self._repeats = 0
        self._sent_s: float | None = None  # time of the message that awaits an answer, if sent once
        self._resend_s = 0.0
        self._give_up_s = 0.0
        self._failure: GcsError | None = None  # of the last try

    @property
    def done(self) -> bool:
        """Whether it has ended: with success (these items are on board) if `error` is None."""
        return self.state in (RewriteState.DONE, RewriteState.FAILED)

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        if self.done or self.state is RewriteState.IDLE:
            return None
        return min(self._resend_s, self._give_up_s)

    def start(self, now_s: float) -> list[Message]:
        """Return the first message. Raises `ProtocolMisuse` if called twice."""
        if self.state is not RewriteState.IDLE:
            raise ProtocolMisuse("an ItemRewrite was started twice: create a new one.")
        return self._next_item(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done or self.state is RewriteState.IDLE or not self._is_ours(message):
            return []
        if message.name == "MISSION_ACK":
            return self._acknowledged(message.fields["type"], now_s)
        if message.fields.get("seq") != self._seq:
            return []
        if message.name in _REQUESTS:
            return self._requested(now_s)
        if message.name in _ITEMS and self.state is RewriteState.READING:
            return self._read(message, now_s)
        return []

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        deadline_s = self.deadline_s
        if deadline_s is None or now_s < deadline_s:
            return []
        if now_s >= self._give_up_s:
            silence = PeerTimeout(f"{self.peer} stopped answering while mission item {self._seq} was replaced.")
            return self._fail(self._failure or silence)
        self._repeats += 1
        match self.state:
            case RewriteState.OFFERED:
                return self._await(now_s, [self._offer()])
            case RewriteState.SENT:
                return self._ask_back(now_s)
            case _:
                return self._await(now_s, [self._question()])

    def cancel(self) -> list[Message]:
        """End it. The item on board is then the old one or the new one: ArduPilot has no message that stops it."""
        if not self.done:
            self._fail(PeerError(f"the change of mission item {self._seq} of {self.peer} was cancelled."))
        return []

    @property
    def _seq(self) -> int:
        return self._waiting[0][0] if self._waiting else 0

    def _is_ours(self, message: Message) -> bool:
        if not message.name.startswith("MISSION_") or mission_type_of(message) != MissionType.MISSION:
            return False
        return message.comes_from(self.peer) and message.is_for(self.me)

    def _requested(self, now_s: float) -> list[Message]:
        if self.state is RewriteState.OFFERED:
            self._learn(now_s)
            self._progressed(now_s)
            self.state = RewriteState.SENT
        self._sent_s = None  # the read-back is measured instead
        return self._await(now_s, [self._item()])

    def _acknowledged(self, result: int, now_s: float) -> list[Message]:
        if result == MissionResult.INVALID_SEQUENCE:  # it answers a late copy of another item
            return []
        match self.state:
            case RewriteState.SENT:
                if result not in (MissionResult.ACCEPTED, *DOUBTFUL):
                    self._failure = MissionRefused(self.peer, result, self._seq)
                return self._ask_back(now_s)
            case RewriteState.READING if result == MissionResult.DENIED:
                return self._await(now_s, [self._item()])
            case RewriteState.OFFERED if result != MissionResult.ACCEPTED:
                self._failure = MissionRefused(self.peer, result, self._seq)
                if result not in DOUBTFUL:
                    return self._fail(self._failure)
                wait_s = doubt_s(self._round_trip, self._timers)
                self._give_up_s = min(self._give_up_s, now_s + wait_s)
                self._resend_s = max(self._resend_s, now_s + wait_s / 4)
        return []

    def _read(self, message: Message, now_s: float) -> list[Message]:
        self._learn(now_s)
        try:
            on_board = item_from_message(message)
        except PeerError as error:
            return self._fail(error)
        differences = compare_missions([self._waiting[0][1]], [on_board], autopilot=self._autopilot)
        if differences and self._look_first and self._tries_left == self._tries:
            return self._offer_again(now_s)
        if differences:
            self._failure = self._failure or read_back_error(self.peer, MissionType.MISSION, differences)
            return self._offer_again(now_s)
        self._waiting.pop(0)
        return self._next_item(now_s)

    def _next_item(self, now_s: float) -> list[Message]:
        self._failure = None
        self._tries_left = self._tries
        if not self._waiting:
            self.state = RewriteState.DONE
            return []
        self._progressed(now_s)
        return self._ask_back(now_s) if self._look_first else self._offer_again(now_s)

    def _offer_again(self, now_s: float) -> list[Message]:
        if self._tries_left <= 0 and self._failure is not None:
            return self._fail(self._failure)
        self._tries_left -= 1
        self.state = RewriteState.OFFERED
        self._sent_s = now_s
        return self._await(now_s, [self._offer()])

    def _ask_back(self, now_s: float) -> list[Message]:
        self.state = RewriteState.READING
        self._repeats = 0
        messages = self._await(now_s, [self._question()])
        self._sent_s = now_s
        return messages

    def _await(self, now_s: float, messages: list[Message]) -> list[Message]:
        if self._repeats:
            self._sent_s = None
        self._resend_s = now_s + self._round_trip.wait_s(self._repeats)
        return messages

    def _learn(self, now_s: float) -> None:
        if self._sent_s is not None:
            self._round_trip.learn(now_s - self._sent_s)
        self._sent_s = None

    def _progressed(self, now_s: float) -> None:
        self._repeats = 0
        self._give_up_s = now_s + self._timers.give_up_s

    def _fail(self, error: GcsError) -> list[Message]:
        self.error = error
        self.state = RewriteState.FAILED
        return []

    def _offer(self) -> Message:
        fields = {**self.peer.target, "start_index": self._seq, "end_index": self._seq}
        return Message("MISSION_WRITE_PARTIAL_LIST", {**fields, "mission_type": int(MissionType.MISSION)})

    def _item(self) -> Message:
        seq, item = self._waiting[0]
        return item_to_message(item, seq, self.peer)

    def _question(self) -> Message:
        fields = {**self.peer.target, "seq": self._seq, "mission_type": int(MissionType.MISSION)}
        return Message("MISSION_REQUEST_INT", fields)
