"""What both sides of the mission protocol share: timers, results, errors, and the rules.

Knows: nothing of sockets, clocks or sleeps: time is the argument `now_s`, seconds of any monotonic clock.
Does not know: who is the ground station and who the vehicle. The protocol has two parts, and each station
may play either: an upload is the ground station's `MissionSender` with the vehicle's `MissionReceiver`, a
download the reverse. Each machine lives for one transfer:

    messages = machine.start(now_s)                 # to be sent
    messages = machine.receive(message, now_s)      # for every message that arrives, also those of others
    messages = machine.tick(now_s)                  # at `deadline_s`, or whenever convenient
    machine.done -> machine.error, machine.items    # error is None, PeerTimeout, MissionRefused or PeerError

Rules
1.  The receiver pulls: each item is asked for by number, and sent only when asked for.
2.  A message counts if it comes from the peer, is addressed to us (or to nobody), and names our mission type.
    Everything else belongs to other conversations and is ignored.
3.  Every request is answered, however often it is repeated, always with MISSION_ITEM_INT.
4.  Both kinds of request and both kinds of item are understood.
5.  What got no answer is said again: `reply_s` after a list, a count, or the last item; `item_s` after a
    request for an item; `retries` times. Between items the sender is silent: asking is the receiver's part.
    A machine that is given a `RttEstimator` asks again as soon as that says, until `give_up_s`; and a sender then says
    the item it was asked for last once more, and the next one with it: whichever of item and request was lost, one of
    the two is what the receiver waits for, and it takes no other.
6.  A new MISSION_COUNT starts the receiver afresh: items of two missions never mix.
7.  The receiver ends the transfer with MISSION_ACK. It repeats it when the last item comes once more, since
    that means the first one was lost.
8.  ACCEPTED before the last item was sent belongs to an earlier transfer and is ignored. INVALID_SEQUENCE is
    a reproach, after which ArduPilot asks again. ERROR after a repeated MISSION_COUNT says that the first one
    had arrived and the transfer goes on (PX4: "busy"). ERROR after a repeated last item says that the transfer was
    over and its MISSION_ACK is lost. Any other result ends it: `MissionRefused`. With a `RttEstimator`, where much is
    said twice, ERROR, DENIED and OPERATION_CANCELLED may be about a copy that came late: they end the transfer if
    nothing is asked, or answered, for some waits after them.
9.  `give_up_s` without progress ends it: `PeerTimeout`. So does a peer that asks for ever without progress.
10. With a `window` a receiver asks for several items at a time, where the peer keeps no track of what it was asked
    for (ArduPilot); items are taken in any order.
11. Arrival of the last item without a MISSION_ACK is no proof of anything: `MissionSender.all_sent` tells the
    caller that it pays to read the mission back.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.errors import PeerRefusal
from gcs.link.microservices.rtt import RttEstimator
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionResult, mission_result_words


@dataclass(frozen=True)
class Timers:
    """How long to wait, in seconds. The defaults are the MAVLink guide's."""

    reply_s: float = 1.5  # for an answer to a list, a count, the last item
    item_s: float = 0.25  # for an item asked for
    retries: int = 5
    give_up_s: float = 9.0  # without progress; longer than any autopilot's own patience (8 s)

    def __post_init__(self) -> None:
        if not (self.reply_s > 0 and self.item_s > 0 and self.give_up_s > 0 and self.retries >= 0):
            raise ValueError(f"timers must be positive: {self}")


GROUND_TIMERS = Timers()
DOUBTFUL = frozenset({MissionResult.ERROR, MissionResult.DENIED, MissionResult.OPERATION_CANCELLED})


def doubt_s(round_trip: RttEstimator) -> float:
    """How long to go on after a refusal that may be about something else: ArduPilot asks again once a second."""
    return max(4.0 * round_trip.wait_s(), 1.2)


class MissionRefused(PeerRefusal):
    """The peer ended the transfer with a MISSION_ACK other than ACCEPTED.

    `result` is the MAV_MISSION_RESULT; `seq` the item it was about, or None if none had been asked for.
    """

    def __init__(self, peer: Station, result: int, seq: int | None) -> None:
        where = "the mission" if seq is None else f"the mission at item {seq}"
        super().__init__(
            f"{peer} refused {where}: {mission_result_words(result)}.",
            hint="nothing was armed; look at that item, or at the vehicle's own messages, and upload again",
        )
        self.result = result
        self.seq = seq


def mission_ack(target: Station, result: MissionResult, mission_type: int) -> Message:
    """MISSION_ACK to `target`."""
    return Message(
        "MISSION_ACK",
        {
            "target_system": target.sysid,
            "target_component": target.compid,
            "type": int(result),
            "mission_type": mission_type,
        },
    )


def mission_type_of(message: Message) -> int:
    """The mission type a message names; MAVLink 1 has no such field and means 0."""
    return int(message.fields.get("mission_type", 0))
