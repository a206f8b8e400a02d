"""MissionSender, step by step: what it answers, when it repeats, when and with which words it gives up."""

from __future__ import annotations

import pytest

from gcs.autopilots.protocol_timers import MissionTimers
from gcs.errors import PeerError, PeerTimeout
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.message import Message
from gcs.mavlink import MissionResult
from tests.unit.link.protocols.mission.conversation import (
    VEHICLE,
    SteadyTrip,
    line,
    missions,
    talking,
    ticks,
    told,
    until,
)

TIMERS = MissionTimers(reply_s=1.5, item_s=0.25, retries=2, give_up_s=9.0, ack_s=2.5, doubt_s=1.2)
ASKED = "MISSION_REQUEST_INT"
AMBIGUOUS_RESULTS = pytest.mark.parametrize(
    "result", [MissionResult.ERROR, MissionResult.DENIED, MissionResult.OPERATION_CANCELLED]
)


def started(count=3, **how):
    """A sender that made its offer at 10 s."""
    given = {name: how.pop(name) for name in ("timers", "round_trip") if name in how}
    sender = MissionSender(missions(count), talking(**{"timers": TIMERS, **given}), **how)
    assert (sender.deadline_s, sender.all_sent, sender.tick(50.0)) == (None, False, [])
    assert line(sender.start(10.0)) == f"COUNT {count}"
    return sender


def test_a_transfer_by_the_timers_of_the_guide():
    sender = started()
    assert (until(sender), sender.heard) == (11.5, False)
    assert told(sender, "MISSION_REQUEST_LIST", 10.2) == ("COUNT 3", 11.5)
    assert sender.heard
    assert told(sender, ASKED, 10.4, seq=0) == ("ITEM_INT 0", 19.4)  # requests are the receiver's part
    assert told(sender, ASKED, 11.0, seq=0) == ("ITEM_INT 0", 19.4)  # once more is no progress
    assert told(sender, "MISSION_REQUEST", 12.0, seq=1) == ("ITEM_INT 1", 21.0)
    assert told(sender, "MISSION_REQUEST_LIST", 12.5) == ("", 21.0)
    assert sender.tick(20.9) == []
    assert (sender.all_sent, sender.state) == (False, MachineState.SENDING)
    assert told(sender, ASKED, 13.0, seq=2) == ("ITEM_INT 2", 14.5)
    assert (sender.all_sent, sender.state) == (True, MachineState.ALL_SENT)
    assert told(sender, ASKED, 13.5, seq=0) == ("ITEM_INT 0", 15.0)
    assert (line(sender.tick(15.0)), until(sender)) == ("ITEM_INT 2", 16.5)  # the last item, whatever came last
    assert told(sender, "MISSION_ACK", 16.0, type=0) == ("", None)
    assert sender.done and sender.error is None
    assert told(sender, ASKED, 16.1, seq=0) == ("", None)


@pytest.mark.parametrize(
    ("asked", "said", "awaited"),
    [
        ([], [(11.5, "COUNT 3"), (13.0, "COUNT 3"), (19.0, "")], "its request for the first mission item"),
        ([0, 1], [(19.0, "")], "its request after mission item 1 of 3"),
        (
            [0, 1, 2],
            [(11.5, "ITEM_INT 2"), (13.0, "ITEM_INT 2"), (19.0, "")],
            "its MISSION_ACK after the last item",
        ),
    ],
)
def test_silence_is_answered_with_repetitions_and_named_at_the_end(asked, said, awaited):
    sender = started()
    for seq in asked:
        told(sender, ASKED, 10.0, seq=seq)
    assert ticks(sender) == said
    assert isinstance(sender.error, PeerTimeout)
    assert f"vehicle 4 stopped answering: {awaited} did not arrive" in sender.error.message


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ([], [*((at_s, "COUNT 3") for at_s in (10.5, 11.25, 12.25, 13.5, 15.0, 16.75, 18.75)), (19.0, "")]),
        (
            [0],
            [
                *((at_s, "ITEM_INT 0, ITEM_INT 1") for at_s in (10.5, 11.25, 12.25, 13.5, 15.0, 16.75, 18.75)),
                (19.0, ""),
            ],
        ),
        # From here on the receiver may have everything: ack_s after the next repetition is enough.
        ([0, 1], [*((at_s, "ITEM_INT 1, ITEM_INT 2") for at_s in (10.5, 11.25, 12.25, 13.5)), (13.75, "")]),
        ([0, 1, 2], [*((at_s, "ITEM_INT 2") for at_s in (10.5, 11.25, 12.25)), (12.5, "")]),
    ],
)
def test_with_an_estimated_round_trip_the_item_and_the_next_are_repeated(asked, said):
    sender = started(round_trip=SteadyTrip())
    for seq in asked:
        told(sender, ASKED, 10.0, seq=seq)
    assert ticks(sender) == said
    assert sender.all_sent is ("MISSION_ACK after the last item" in str(sender.error)) is (len(asked) > 1)


def test_the_acknowledgement_is_not_awaited_longer_than_any_answer():
    sender = started(1, timers=MissionTimers(give_up_s=9.0, ack_s=20.0), round_trip=SteadyTrip())
    told(sender, ASKED, 10.0, seq=0)
    assert ticks(sender)[-1] == (19.0, "")


def test_round_trips_are_measured_from_what_was_sent_once():
    trip = SteadyTrip()
    sender = started(5, round_trip=trip)
    for at_s, seq in ((10.2, 0), (10.6, 1), (10.7, 1), (10.9, 2), (11.0, 3)):
        told(sender, ASKED, at_s, seq=seq)
    assert trip.samples_s == [0.2, 0.4, 0.1]  # not of item 1, which was asked for twice
    sender.tick(11.5)
    told(sender, ASKED, 11.6, seq=4)
    assert trip.samples_s == [0.2, 0.4, 0.1]
    late = started(round_trip=(trip := SteadyTrip()))
    late.tick(10.5)
    told(late, ASKED, 10.6, seq=0)
    assert trip.samples_s == []


def test_requests_for_ever_end_with_the_time_for_the_whole_mission():
    sender = started()
    for n in range(6):
        told(sender, ASKED, 10.0 + 8 * n, seq=n % 2)
    assert until(sender) == 10.0 + 9.0 * (3 + 2)
    assert sender.tick(55.0) == [] and isinstance(sender.error, PeerTimeout)


@AMBIGUOUS_RESULTS
@pytest.mark.parametrize(("doubt_s", "end_s"), [(1.2, 12.3), (3.0, 13.3)])  # four waits, but doubt_s at least
def test_a_refusal_that_may_answer_a_late_copy_ends_it_if_nothing_follows(result, doubt_s, end_s):
    timers = MissionTimers(give_up_s=9.0, doubt_s=doubt_s)
    sender = started(timers=timers, round_trip=SteadyTrip())
    told(sender, "MISSION_ACK", 10.3, type=int(result))
    assert ticks(sender)[-1] == (end_s, "")
    assert isinstance(sender.error, MissionRefused)
    assert (sender.error.result, sender.error.seq) == (result, None)
    sender = started(timers=timers, round_trip=SteadyTrip())
    told(sender, "MISSION_ACK", 10.3, type=int(result))
    told(sender, ASKED, 10.4, seq=0)
    assert sender.doubt is None
    assert ticks(sender)[-1] == (19.4, "")
    assert isinstance(sender.error, PeerTimeout)


def test_a_doubt_does_not_prolong_the_wait_and_after_the_last_item_it_is_a_lost_acknowledgement():
    sender = started(round_trip=SteadyTrip())
    told(sender, "MISSION_ACK", 18.5, type=1)
    sender.tick(18.5)
    assert until(sender) == 19.0
    sender = started(1, round_trip=SteadyTrip())
    told(sender, ASKED, 10.2, seq=0)
    told(sender, "MISSION_ACK", 10.3, type=1)
    assert ticks(sender)[-1] == (12.3, "")
    assert isinstance(sender.error, PeerTimeout)
    assert sender.doubt is not None


@pytest.mark.parametrize("trip", [None, SteadyTrip()])
def test_any_other_refusal_ends_it_at_once_with_the_item(trip):
    sender = started(round_trip=trip)
    told(sender, ASKED, 10.1, seq=0)
    told(sender, ASKED, 10.2, seq=1)
    assert told(sender, "MISSION_ACK", 10.3, type=int(MissionResult.UNSUPPORTED)) == ("", None)
    assert isinstance(sender.error, MissionRefused)
    assert (sender.error.result, sender.error.seq) == (MissionResult.UNSUPPORTED, 1)


@AMBIGUOUS_RESULTS
def test_without_an_estimate_every_refusal_is_meant(result):
    sender = started()
    told(sender, "MISSION_ACK", 10.3, type=int(result))
    assert isinstance(sender.error, MissionRefused)


@pytest.mark.parametrize(("asked", "over"), [([0, 1, 2, 2], True), ([0, 0, 1, 1, 2], False)])
def test_only_a_repeated_last_item_makes_an_error_a_lost_acknowledgement(asked, over):
    sender = started()
    for seq in asked:
        told(sender, ASKED, 10.1, seq=seq)
    told(sender, "MISSION_ACK", 10.2, type=1)
    assert isinstance(sender.error, PeerTimeout if over else MissionRefused)


def test_an_empty_mission_is_offered_again_until_it_is_acknowledged():
    sender = started(0)
    assert (line(sender.tick(11.5)), sender.all_sent) == ("COUNT 0", True)
    told(sender, "MISSION_ACK", 11.6, type=1)  # the first count had arrived
    assert told(sender, "MISSION_ACK", 11.7, type=0) == ("", None)
    assert sender.error is None
    assert ticks(started(0)) == [(11.5, "COUNT 0"), (13.0, "COUNT 0"), (19.0, "")]
    trip = started(0, round_trip=SteadyTrip())
    assert line(trip.tick(10.5)) == "COUNT 0"


def asked(seq, kind):
    fields = {"target_system": 255, "target_component": 190, "seq": seq, "mission_type": kind}
    return Message(ASKED, fields, *VEHICLE)


@pytest.mark.parametrize(
    ("how", "kind", "frame"),
    [({}, 0, 6), ({"mission_type": 1, "integer_frames": False}, 1, 3)],
)
def test_items_carry_their_type_their_frames_and_the_mark_of_the_first(how, kind, frame):
    sender = started(**how)
    for seq in range(3):
        (item,) = sender.receive(asked(seq, kind), 10.1)
        fields = item.fields
        assert (fields["current"], fields["mission_type"], fields["frame"]) == (int(seq == 0), kind, frame)


def test_other_messages_are_not_heard_and_a_cancelled_transfer_says_nothing_more():
    sender = started(mission_type=1)
    sender.receive(Message("HEARTBEAT", {}, *VEHICLE), 10.1)
    assert not sender.heard
    (told_peer,) = sender.cancel()
    assert told_peer.fields == {"target_system": 4, "target_component": 1, "type": 15, "mission_type": 1}
    assert isinstance(sender.error, PeerError) and "to vehicle 4 was cancelled" in sender.error.message
    assert sender.receive(asked(0, 1), 10.2) == sender.tick(99.0) == sender.cancel() == []
