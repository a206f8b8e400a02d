"""The rules of the mission protocol (https://mavlink.io/en/services/mission.html), and what its machines share.

An upload is the ground station's `MissionSender` with the vehicle's `MissionReceiver`, a download the reverse. Each
machine lives for one transfer.

Rules
1.  The receiver controls the transfer: it requests each item by number, and the sender sends only requested items.
2.  A message counts if it comes from the peer, is addressed to us or to no station, and names our mission type. All
    other messages belong to other conversations and are ignored.
3.  Every request is answered, however often it is repeated, always with MISSION_ITEM_INT.
4.  Both kinds of request and both kinds of item are accepted.
5.  A message without an answer is repeated: `reply_s` after a list, a count, or the last item; `item_s` after the
    request of an item; `retries` times. Between items the sender is silent: requests are the receiver's part. A machine
    that estimates round trips repeats as soon as the estimated wait has passed, until `give_up_s`. As a sender it
    repeats the last requested item together with the next one: whether the item or the next request was lost, the
    receiver waits for one of the two, and ignores the other.
6.  A new MISSION_COUNT restarts the receiver: items of two missions never mix.
7.  The receiver ends the transfer with MISSION_ACK. It repeats the MISSION_ACK if the last item comes again, because
    then the first MISSION_ACK was lost.
8.  ACCEPTED before the last item was sent belongs to an earlier transfer and is ignored. After INVALID_SEQUENCE
    ArduPilot repeats its request. ERROR after a repeated MISSION_COUNT means that the first one had arrived and the
    transfer continues (PX4: "busy"). ERROR after a repeated last item means that the transfer was over and its
    MISSION_ACK was lost. Any other result ends the transfer: `MissionRefused`. Where round trips are estimated, many
    messages are repeated, and ERROR, DENIED and OPERATION_CANCELLED may answer a late copy: they end the transfer only
    if no request or answer follows within some waits.
9.  `give_up_s` without progress ends the transfer: `PeerTimeout`. So do endless requests without progress.
10. With a `window` a receiver requests several items at a time, if the peer does not track its requests (ArduPilot).
    Items are accepted in any order.
11. If all items were sent and MISSION_ACK is missing, nothing is proved. `MissionSender.all_sent` then means that a
    read-back is worthwhile.
"""

from collections.abc import Sequence
from typing import Self

from gcs.errors import GcsError, PeerError, PeerRefusal
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import TIMER, Guard, Machine, MachineEvent, MachineState, Table, TableMachine
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionResult
from gcs.mavlink_names import mission_result_words, mission_type_words
from gcs.mission.model import MissionItem

EVENTS = {
    "MISSION_COUNT": MachineEvent.COUNT,
    "MISSION_REQUEST_LIST": MachineEvent.REQUEST_LIST,
    "MISSION_REQUEST_INT": MachineEvent.REQUEST,
    "MISSION_REQUEST": MachineEvent.REQUEST,
    "MISSION_ITEM_INT": MachineEvent.ITEM,
    "MISSION_ITEM": MachineEvent.ITEM,
    "MISSION_ACK": MachineEvent.MISSION_ACK,
}
AMBIGUOUS_RESULTS = frozenset({MissionResult.ERROR, MissionResult.DENIED, MissionResult.OPERATION_CANCELLED})


NO_REFUSAL = Guard[object](
    "ACCEPTED or INVALID_SEQUENCE",
    lambda _, ack: ack.fields["type"] in (MissionResult.ACCEPTED, MissionResult.INVALID_SEQUENCE),
)
IN_DOUBT = Guard[TableMachine](
    "ERROR, DENIED or OPERATION_CANCELLED, and round trips are estimated",
    lambda machine, ack: machine.exchange.estimates and ack.fields["type"] in AMBIGUOUS_RESULTS,
)


def doubt_s(exchange: Exchange) -> float:
    """The wait after a refusal that may answer a late copy: ArduPilot repeats its requests once a second."""
    return max(4.0 * exchange.round_trip.wait_s(), exchange.timers.mission.doubt_s)


class MissionRefused(PeerRefusal):
    """The peer ended the transfer with a MISSION_ACK other than ACCEPTED.

    `result` is the MAV_MISSION_RESULT; `seq` the last requested item, or None before the first request.
    """

    def __init__(self, peer: Station, result: int, seq: int | None) -> None:
        where = "the mission" if seq is None else f"the mission at item {seq}"
        super().__init__(
            f"{peer} refused {where}: {mission_result_words(result)}.",
            hint="check that item and the vehicle's messages, then upload again; no vehicle was armed",
        )
        self.result = result
        self.seq = seq


def mission_ack(peer: Station, result: MissionResult, mission_type: int) -> Message:
    """Return MISSION_ACK to `peer`."""
    return Message("MISSION_ACK", {**peer.target, "type": int(result), "mission_type": mission_type})


def mission_type_of(message: Message) -> int:
    """Return the mission type of a message; 0 for MAVLink 1, which has no such field."""
    return int(message.fields.get("mission_type", 0))


class MissionMachine(TableMachine):
    """A machine of the mission protocol for items of one type."""

    def __init__(self, table: Table[Self], exchange: Exchange, mission_type: int) -> None:
        super().__init__(table, exchange)
        self.mission_type = mission_type
        self._timers = exchange.timers.mission
        self._repeats = 0  # of the last message

    @property
    def _may_repeat(self) -> bool:
        return self.exchange.estimates or self._repeats < self._timers.retries

    def _is_ours(self, message: Message) -> bool:
        return self.exchange.hears(message) and mission_type_of(message) == self.mission_type

    def _ack(self, result: MissionResult) -> Message:
        return mission_ack(self.peer, result, self.mission_type)


class UploadMachine(MissionMachine):
    """Runs one transfer after another, which have the messages and the timers; the end of each is the event ENDED."""

    def __init__(self, table: Table[Self], exchange: Exchange, items: Sequence[MissionItem], mission_type: int) -> None:
        super().__init__(table, exchange, mission_type)
        self.items = tuple(items)
        self.sending_ended_s: float | None = None  # end of the last sending
        self._machine: Machine | None = None  # the transfer that runs now
        self._reads = 0  # read-backs since then
        self._failure: GcsError | None = None  # of the last transfer

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no timer runs."""
        return None if self.done or self._machine is None else self._machine.deadline_s

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Return the messages to send after a received message; none if it belongs to another conversation."""
        if self.done or self._machine is None:
            return []
        return self._machine.receive(message, now_s) + self._advance(self._machine, now_s)

    def tick(self, now_s: float) -> list[Message]:
        """Return the messages to send after a timer expired."""
        if self.done or self._machine is None:
            return []
        return self._machine.tick(now_s) + self._advance(self._machine, now_s)

    def _advance(self, machine: Machine, now_s: float) -> list[Message]:
        if not machine.done:
            return []
        if self.state is not MachineState.READING:
            self.sending_ended_s = now_s
        self._failure = machine.error or self._difference()
        return self._follow(MachineEvent.ENDED, TIMER, now_s)

    def _difference(self) -> GcsError | None:
        """Why the items that were read back are not those to have; None while they are being sent."""
        raise NotImplementedError

    def _end(self, _message: Message, _now_s: float) -> list[Message]:
        self.error = self._failure
        return []

    def _cancelled(self, _message: Message, _now_s: float) -> list[Message]:
        what = mission_type_words(self.mission_type)
        self._fail(PeerError(f"the upload of the {what} to {self.peer} was cancelled."))
        return [] if self._machine is None else self._machine.cancel()
