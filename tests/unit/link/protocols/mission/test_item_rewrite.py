"""One item of a stored mission is replaced: that item and no other, and it is never believed wrongly."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gcs.autopilots.protocol_timers import MissionTimers, ProtocolTimers
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.item_rewrite import ItemRewrite
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MissionResult
from gcs.mission.model import Command, MissionItem
from tests.air import VEHICLE, Air, Weather
from tests.unit.link.protocols.mission.conversation import SteadyTrip, ticks

CALM = Weather(0.1, 0.0, 0.0, 0.0)
AP = Autopilot.ARDUPILOT


def until(second: float) -> MissionItem:
    return MissionItem(Command.NAV_DELAY, 2, (-1.0, 12.0, 34.0, second), 0, 0, 0.0)


def addressed(name, **fields):
    target = {"target_system": GROUND.sysid, "target_component": GROUND.compid, "mission_type": 0}
    return Message(name, {**target, **fields}, *VEHICLE)


def same(ours, theirs):
    return compare_missions(ours, theirs, autopilot=AP) == []


@example(18145242, 0.05, 0.0, 0.3, [1, 2, 3], True)
@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, 2**32),
    st.sampled_from([0.0, 0.05, 0.2, 0.5, 1.0]),
    st.sampled_from([0.0, 0.05, 0.4]),
    st.sampled_from([0.0, 0.02, 0.3]),
    st.lists(st.integers(1, 11), min_size=1, max_size=3, unique=True),
    st.booleans(),
)
def test_what_is_believed_is_on_board_and_nothing_else_has_changed(
    seed, loss, round_trip_s, mischief, numbers, look_first
):
    air = Air(AP, Weather(round_trip_s, loss, mischief, mischief), seed)
    before = air.shelf.items()
    wanted = {number: until(float(number)) for number in numbers}
    machine = ItemRewrite(wanted, Exchange(VEHICLE, AP), look_first=look_first)
    air.run(machine)
    after = air.shelf.items()
    assert len(after) == len(before)
    for number, (old, now) in enumerate(zip(before[1:], after[1:], strict=True), start=1):  # item 0 is home
        new = same([wanted.get(number, old)], [now])
        assert new or (machine.error is not None and same([old], [now]))
    assert loss < 1.0 or isinstance(machine.error, PeerTimeout)
    assert loss > 0.1 or machine.error is None


def test_a_calm_link_costs_three_round_trips():
    air = Air(AP, CALM, 0)
    air.run(ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP)))
    assert air.now_s == pytest.approx(3 * CALM.round_trip_s)
    assert air.sent[GROUND] == 3  # range, item, question


def test_an_item_beyond_the_end_is_refused_and_nothing_changes():
    air = Air(AP, CALM, 0)
    before = air.shelf.items()
    machine = ItemRewrite({40: until(56.0)}, Exchange(VEHICLE, AP))
    air.run(machine)
    assert isinstance(machine.error, MissionRefused)
    assert air.shelf.items() == before


def test_an_autopilot_without_partial_writes_times_out():
    air = Air(Autopilot.PX4, CALM, 0)
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, Autopilot.PX4))
    air.run(machine)
    assert isinstance(machine.error, PeerTimeout)
    assert "mission item 2" in machine.error.message


def test_a_vehicle_that_refuses_every_item_is_named():
    air = Air(AP, CALM, 0)
    air.shelf.rejects = True
    before = air.shelf.items()
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP))
    air.run(machine)
    assert isinstance(machine.error, MissionRefused)
    assert air.shelf.items() == before


def test_what_is_there_already_is_not_sent():
    air = Air(AP, CALM, 0)
    air.run(ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP)))
    air.shelf.rejects = True
    before = air.sent[GROUND]
    again = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP), look_first=True)
    air.run(again)
    assert again.error is None
    assert air.sent[GROUND] == before + 1


def test_an_acknowledgement_proves_nothing():
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP))
    machine.start(0.0)
    machine.receive(addressed("MISSION_REQUEST", seq=2), 0.1)
    assert [m.name for m in machine.receive(addressed("MISSION_ACK", type=0), 0.2)] == ["MISSION_REQUEST_INT"]
    assert not machine.done


def test_an_item_that_was_lost_is_sent_again():
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP))
    machine.start(0.0)
    machine.receive(addressed("MISSION_REQUEST", seq=2), 0.1)
    assert [m.name for m in machine.tick(5.0)] == ["MISSION_REQUEST_INT"]
    denied = addressed("MISSION_ACK", type=int(MissionResult.DENIED))
    assert [m.name for m in machine.receive(denied, 5.1)] == ["MISSION_ITEM_INT"]
    assert [m.name for m in machine.receive(addressed("MISSION_REQUEST", seq=2), 5.2)] == ["MISSION_ITEM_INT"]
    assert machine.state is MachineState.READING


def test_other_conversations_and_misuse():
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP))
    assert machine.receive(addressed("MISSION_REQUEST", seq=2), 0.0) == []
    machine.start(0.0)
    assert machine.receive(addressed("MISSION_REQUEST", seq=3), 0.0) == []
    assert machine.receive(Message("HEARTBEAT", {}, *VEHICLE), 0.0) == []
    with pytest.raises(ProtocolMisuse):
        machine.start(0.0)
    assert machine.cancel() == []
    assert machine.done


def test_nothing_to_replace_is_done_at_once():
    machine = ItemRewrite({}, Exchange(VEHICLE, AP))
    assert machine.start(0.0) == []
    assert machine.done
    assert machine.error is None


def on_board(seq, item, now_s, machine):
    return machine.receive(replace(item_to_message(item, seq, GROUND), sysid=VEHICLE.sysid, compid=1), now_s)


def test_an_item_that_nobody_asked_for_is_no_read_back():
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP))
    machine.start(0.0)
    assert on_board(2, until(56.0), 0.1, machine) == []
    assert machine.state is MachineState.OFFERED
    machine.receive(addressed("MISSION_REQUEST", seq=2), 0.2)
    machine.receive(addressed("MISSION_ACK", type=0), 0.3)
    assert on_board(2, until(56.0), 0.4, machine) == []
    assert (machine.state, machine.error, machine.cancel(), machine.error) == (MachineState.DONE, None, [], None)


def test_what_was_on_board_before_is_no_reason_of_a_failure():
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP), look_first=True)
    assert [m.name for m in machine.start(0.0)] == ["MISSION_REQUEST_INT"]
    assert [m.name for m in on_board(2, until(34.0), 0.1, machine)] == ["MISSION_WRITE_PARTIAL_LIST"]
    while not machine.done:
        machine.tick(machine.deadline_s)
    assert isinstance(machine.error, PeerTimeout)


def test_every_item_has_its_own_tries_and_its_own_time():
    """Each differs once when it is read back; then it is on board."""
    timers = ProtocolTimers(mission=MissionTimers(give_up_s=9.0))
    machine = ItemRewrite(
        {2: until(2.0), 5: until(5.0)}, Exchange(VEHICLE, AP, timers=timers, round_trip=SteadyTrip()), tries=2
    )
    said = machine.start(10.0)
    for seq in (2, 5):
        for wrong in (1.0, 0.0):
            assert [(m.name, m.fields["start_index"], m.fields["end_index"]) for m in said] == [
                ("MISSION_WRITE_PARTIAL_LIST", seq, seq)
            ]
            assert machine.deadline_s == 10.5
            (item,) = machine.receive(addressed("MISSION_REQUEST_INT", seq=seq), 10.0)
            assert (item.fields["seq"], item.fields["param4"]) == (seq, float(seq))
            (question,) = machine.receive(addressed("MISSION_ACK", type=0), 10.0)
            assert (question.name, question.fields["seq"]) == ("MISSION_REQUEST_INT", seq)
            said = on_board(seq, until(seq + wrong), 10.0, machine)
    assert machine.done and machine.error is None
    alone = ItemRewrite({2: until(2.0)}, Exchange(VEHICLE, AP, timers=timers, round_trip=SteadyTrip()), tries=2)
    alone.start(10.0)
    for _ in range(2):
        alone.receive(addressed("MISSION_REQUEST_INT", seq=2), 10.0)
        alone.receive(addressed("MISSION_ACK", type=0), 10.0)
        on_board(2, until(3.0), 10.0, alone)
    assert "differs from what was sent" in str(alone.error)


@pytest.mark.parametrize(
    ("heard", "said"),
    [
        ((), "WRITE_PARTIAL_LIST 2"),
        (("MISSION_REQUEST",), "REQUEST_INT 2"),
        (("MISSION_REQUEST", "MISSION_ACK"), "REQUEST_INT 2"),
    ],
)
def test_silence_is_answered_with_repetitions_until_it_is_given_up(heard, said):
    """Waits of 0.5 s, 0.25 s more each time; after an item the first wait ends with the question."""
    machine = ItemRewrite(
        {2: until(56.0)},
        Exchange(VEHICLE, AP, timers=ProtocolTimers(mission=MissionTimers(give_up_s=3.0)), round_trip=SteadyTrip()),
    )
    machine.start(10.0)
    for name in heard:
        machine.receive(addressed(name, seq=2, type=0) if name == "MISSION_ACK" else addressed(name, seq=2), 10.0)
    first = [(10.5, said)] if heard != ("MISSION_REQUEST",) else [(10.5, said), (11.0, said)]
    later = {1: [11.25, 12.25], 2: [11.75, 12.75]}[len(first)]
    assert ticks(machine) == [*first, *((at_s, said) for at_s in later), (13.0, "")]
    assert "mission item 2" in machine.error.message


@pytest.mark.parametrize(
    ("result", "end_s"),
    [(MissionResult.ERROR, 12.0), (MissionResult.UNSUPPORTED, 10.0), (MissionResult.ACCEPTED, 19.0)],
)
def test_a_refused_range_ends_it_at_once_or_after_four_waits_of_doubt(result, end_s):
    timers = ProtocolTimers(mission=MissionTimers(give_up_s=9.0, doubt_s=1.2))
    machine = ItemRewrite({2: until(56.0)}, Exchange(VEHICLE, AP, timers=timers, round_trip=SteadyTrip()))
    machine.start(10.0)
    machine.receive(addressed("MISSION_ACK", type=int(result)), 10.0)
    assert (ticks(machine) or [(10.0, "")])[-1] == (end_s, "")
    assert isinstance(machine.error, PeerTimeout if result == MissionResult.ACCEPTED else MissionRefused)


@pytest.mark.parametrize("repeats", [False, True])
def test_round_trips_of_what_was_sent_once_are_learned(repeats):
    """The request for the item answers the range, and the read-back the question; the item itself is not measured."""
    trip = SteadyTrip()
    machine = ItemRewrite({2: until(2.0)}, Exchange(VEHICLE, AP, round_trip=trip))
    machine.start(10.0)
    if repeats:
        assert machine.tick(10.5)
    machine.receive(addressed("MISSION_REQUEST_INT", seq=2), 10.7)
    machine.receive(addressed("MISSION_REQUEST_INT", seq=2), 10.8)
    machine.receive(addressed("MISSION_ACK", type=0), 11.0)
    if repeats:
        assert machine.tick(11.5)
    on_board(2, until(2.0), 11.6, machine)
    assert machine.done
    assert trip.samples_s == ([] if repeats else [0.7, 0.6])
