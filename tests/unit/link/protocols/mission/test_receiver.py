"""MissionReceiver, step by step: what it requests, when it repeats, when and with which words it gives up."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs.autopilots.protocol_timers import MissionTimers, ProtocolTimers
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.wire.message import GROUND
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

TIMERS = MissionTimers(reply_s=1.5, item_s=0.25, retries=2, give_up_s=9.0, doubt_s=1.2)
ITEMS = missions(9)


def listed(**how):
    """A download that was asked for at 10 s."""
    given = {name: how.pop(name) for name in ("timers", "round_trip") if name in how}
    exchange = talking(Autopilot.ARDUPILOT, **{"timers": TIMERS, **given})
    least = MissionTimers(request_again_min_s=how.pop("wait_min_s", 0.0))
    exchange.link = replace(exchange.link, timers=ProtocolTimers(mission=least))
    receiver = MissionReceiver(exchange, **{"window": 1, **how})
    assert (receiver.deadline_s, receiver.tick(50.0)) == (None, [])
    assert line(receiver.start(10.0)) == "REQUEST_LIST"
    return receiver


def given(receiver, seq, now_s, **changes):
    fields = {**item_to_message(ITEMS[seq], seq, GROUND).fields, **changes}
    del fields["target_system"], fields["target_component"], fields["mission_type"]
    return told(receiver, "MISSION_ITEM_INT", now_s, **fields)


def test_a_download_by_the_timers_of_the_guide():
    receiver = listed()
    assert until(receiver) == 11.5
    assert given(receiver, 0, 10.1) == ("", 11.5)  # nothing was requested
    assert told(receiver, "MISSION_COUNT", 10.2, count=3) == ("REQUEST_INT 0", 10.45)
    assert told(receiver, "MISSION_COUNT", 10.3, count=3) == ("", 10.45)  # a late copy
    assert given(receiver, 1, 10.3) == ("", 10.45)
    assert given(receiver, 0, 10.4) == ("REQUEST_INT 1", 10.65)
    assert line(receiver.tick(10.65)) == "REQUEST_INT 1"
    assert (until(receiver), receiver.progress, receiver.count) == (10.9, 1, 3)
    assert given(receiver, 1, 10.7) == ("REQUEST_INT 2", 10.95)
    with pytest.raises(ProtocolMisuse):
        _ = receiver.items
    assert given(receiver, 2, 10.8) == ("ACK 0", None)
    assert receiver.items == ITEMS[:3]
    assert [given(receiver, seq, 11.0)[0] for seq in (0, 1, 2)] == ["", "", "ACK 0"]
    assert told(receiver, "MISSION_COUNT", 11.1, count=2) == ("", None)
    assert receiver.cancel() == []


def test_another_count_begins_anew():
    receiver = listed()
    told(receiver, "MISSION_COUNT", 10.2, count=3)
    given(receiver, 0, 10.3)
    assert told(receiver, "MISSION_COUNT", 10.4, count=2) == ("REQUEST_INT 0", 10.65)
    assert (receiver.progress, receiver.count) == (0, 2)


@pytest.mark.parametrize(
    ("how", "counted", "said", "awaited"),
    [
        ({}, False, [(11.5, "REQUEST_LIST"), (13.0, "REQUEST_LIST"), (14.5, "ACK 15")], "its MISSION_COUNT"),
        (
            {"round_trip": SteadyTrip()},
            False,
            [*((at_s, "REQUEST_LIST") for at_s in (10.5, 11.25, 12.25, 13.5, 15.0, 16.75, 18.75)), (19.0, "ACK 15")],
            "its MISSION_COUNT",
        ),
        (
            {"round_trip": SteadyTrip(), "wait_min_s": 1.2},
            False,
            [
                *((at_s, "REQUEST_LIST") for at_s in (11.2, 12.4, 13.6, 14.85, 16.35, 18.1)),
                (19.0, "ACK 15"),
            ],
            "its MISSION_COUNT",
        ),
        (
            {},
            True,
            [(10.25, "REQUEST_INT 1"), (10.5, "REQUEST_INT 1"), (10.75, "ACK 15")],
            "its mission item 1 of 3",
        ),
        (
            {"round_trip": SteadyTrip(), "window": 2},
            True,
            [
                *((at_s, "REQUEST_INT 1, REQUEST_INT 2") for at_s in (10.5, 11.25, 12.25, 13.5, 15.0, 16.75, 18.75)),
                (19.0, "ACK 15"),
            ],
            "its mission item 1 of 3",
        ),
    ],
)
def test_silence_is_answered_with_repetitions_and_named_at_the_end(how, counted, said, awaited):
    receiver = listed(**how)
    if counted:
        told(receiver, "MISSION_COUNT", 10.0, count=3)
        given(receiver, 0, 10.0)
    assert ticks(receiver) == said
    assert isinstance(receiver.error, PeerTimeout)
    assert f"vehicle 4 stopped answering: {awaited} did not arrive" in receiver.error.message
    assert given(receiver, 0, 50.0) == told(receiver, "MISSION_COUNT", 50.1, count=3) == ("", None)


def test_a_window_moves_with_the_first_missing_item():
    receiver = listed(window=3)
    assert told(receiver, "MISSION_COUNT", 10.2, count=6)[0] == "REQUEST_INT 0, REQUEST_INT 1, REQUEST_INT 2"
    assert given(receiver, 2, 10.3) == ("", 10.55)
    assert given(receiver, 1, 10.4) == ("", 10.65)
    assert given(receiver, 1, 10.5) == ("", 10.65)
    assert given(receiver, 0, 10.6)[0] == "REQUEST_INT 3, REQUEST_INT 4, REQUEST_INT 5"
    assert given(receiver, 4, 10.7)[0] == ""
    assert line(receiver.tick(10.95)) == "REQUEST_INT 3, REQUEST_INT 5"
    assert [given(receiver, seq, 11.0)[0] for seq in (5, 3)] == ["", "ACK 0"]
    assert receiver.items == ITEMS[:6]


def test_round_trips_are_measured_from_what_was_sent_once():
    trip = SteadyTrip()
    receiver = listed(round_trip=trip, window=2)
    told(receiver, "MISSION_COUNT", 10.2, count=4)
    given(receiver, 0, 10.5)
    given(receiver, 1, 10.6)
    assert trip.samples_s == [0.2, 0.3, 0.4]
    receiver.tick(11.1)
    given(receiver, 2, 11.2)
    assert trip.samples_s == [0.2, 0.3, 0.4]
    late = listed(round_trip=(trip := SteadyTrip()))
    late.tick(10.5)
    told(late, "MISSION_COUNT", 10.6, count=1)
    assert trip.samples_s == []


def test_the_time_for_the_whole_mission_is_not_prolonged_by_beginning_anew():
    receiver = MissionReceiver(talking(timers=TIMERS))
    for at_s in (10.0, 30.0, 36.9):
        told(receiver, "MISSION_COUNT", at_s, count=1)
    assert until(receiver) == 10.0 + 9.0 * (1 + 2)
    assert line(receiver.tick(37.0)) == "ACK 15"
    assert isinstance(receiver.error, PeerTimeout)
    waiting = listed(timers=MissionTimers(reply_s=40.0, give_up_s=9.0))
    assert until(waiting) == 19.0
    for at_s in (12.0, 20.0, 28.0, 36.0, 38.9):  # the time counts from the first of them
        told(waiting, "MISSION_COUNT", at_s, count=1 if at_s == 12.0 else int(at_s))
    assert until(waiting) == 12.0 + 9.0 * (1 + 2)


@pytest.mark.parametrize("count", [0, 3, 4])
def test_more_items_than_fit_are_refused_at_once(count):
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False), capacity=3)
    answer = told(receiver, "MISSION_COUNT", 10.0, count=count)[0]
    assert answer == {0: "ACK 0", 3: "REQUEST_INT 0", 4: f"ACK {int(MissionResult.NO_SPACE)}"}[count]
    assert (receiver.error is None) is (count < 4)
    assert receiver.state is {0: MachineState.DONE, 3: MachineState.PULLING, 4: MachineState.FAILED}[count]


def test_an_item_without_a_place_is_refused_with_the_reason_and_nothing_of_the_mission_is_kept():
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    told(receiver, "MISSION_COUNT", 10.0, count=3)
    given(receiver, 0, 10.1)
    fields = {**item_to_message(ITEMS[1], 1, GROUND).fields, "x": math.nan, "y": 1.0}
    del fields["target_system"], fields["target_component"], fields["mission_type"]
    answer = told(receiver, "MISSION_ITEM", 10.2, **fields)
    assert answer == (f"ACK {int(MissionResult.INVALID_PARAM5_X)}", None)
    assert "the mission of vehicle 4 was refused: " in str(receiver.error)
    assert receiver.progress == 0


@pytest.mark.parametrize("result", [MissionResult.ACCEPTED, MissionResult.INVALID_SEQUENCE])
def test_acknowledgements_that_refuse_nothing_are_ignored(result):
    receiver = listed()
    assert told(receiver, "MISSION_ACK", 10.1, type=int(result)) == ("", 11.5)
    assert receiver.error is None


@pytest.mark.parametrize(("counted", "seq"), [(False, None), (True, 1)])
@pytest.mark.parametrize(
    ("trip", "result", "at_once"),
    [
        (None, MissionResult.DENIED, True),
        (None, MissionResult.UNSUPPORTED, True),
        (SteadyTrip(), MissionResult.UNSUPPORTED, True),
        (SteadyTrip(), MissionResult.DENIED, False),
        (SteadyTrip(), MissionResult.ERROR, False),
    ],
)
def test_a_refusal_names_what_was_requested(counted, seq, trip, result, at_once):
    receiver = listed(round_trip=trip)
    if counted:
        told(receiver, "MISSION_COUNT", 10.0, count=3)
        given(receiver, 0, 10.0)
    told(receiver, "MISSION_ACK", 10.3, type=int(result))
    assert receiver.done is at_once
    if not at_once:
        assert ticks(receiver)[-1] == (12.3, "ACK 15")  # four waits later
    assert isinstance(receiver.error, MissionRefused)
    assert (receiver.error.result, receiver.error.seq) == (result, seq)


def test_a_doubt_ends_with_the_answer_and_does_not_prolong_the_wait():
    receiver = listed(round_trip=SteadyTrip())
    told(receiver, "MISSION_ACK", 10.3, type=1)
    told(receiver, "MISSION_COUNT", 10.4, count=1)
    assert ticks(receiver)[-1] == (19.4, "ACK 15")
    assert isinstance(receiver.error, PeerTimeout)
    late = listed(round_trip=SteadyTrip())
    told(late, "MISSION_ACK", 18.5, type=1)
    assert ticks(late)[-1] == (19.0, "ACK 15")


def test_what_was_not_asked_for_yet_cannot_be_refused():
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    assert told(receiver, "MISSION_ACK", 10.0, type=1) == ("", None)
    assert receiver.error is None


def test_every_message_names_the_station_and_the_kind_of_items():
    receiver = listed(mission_type=2)
    target = {"target_system": 4, "target_component": 1, "mission_type": 2}
    assert receiver.tick(11.5)[0].fields == target
    assert told(receiver, "MISSION_COUNT", 11.6, count=1, kind=2)[0] == "REQUEST_INT 0"
    (request,) = receiver.tick(11.85)
    assert request.fields == {**target, "seq": 0}
    (cancelled,) = receiver.cancel()
    assert cancelled.fields == {**target, "type": 15}
    assert "from vehicle 4 was cancelled" in str(receiver.error)


@pytest.mark.parametrize("autopilot", list(Autopilot))
def test_each_autopilot_is_read_with_as_many_requests_as_it_bears(autopilot):
    link = autopilot.traits.link
    quick = SteadyTrip()
    quick.wait_s = lambda repeats=0: 0.01
    receiver = MissionReceiver(Exchange(VEHICLE, autopilot, round_trip=quick), mission_type=1)
    assert line(receiver.start(10.0)) == "REQUEST_LIST"
    assert until(receiver) == pytest.approx(10.0 + max(0.01, link.timers.mission.request_again_min_s))
    requests = told(receiver, "MISSION_COUNT", 10.1, count=90, kind=1)[0]
    assert requests == ", ".join(f"REQUEST_INT {n}" for n in range(link.requests_in_flight))
    for timers, give_up_s in ((None, link.timers.mission.give_up_s), (MissionTimers(give_up_s=0.1), 0.1)):
        own = timers and ProtocolTimers(mission=timers)
        alone = MissionReceiver(Exchange(VEHICLE, autopilot, timers=own, round_trip=SteadyTrip()))
        alone.start(10.0)
        assert ticks(alone)[-1] == (10.0 + give_up_s, "ACK 15")
