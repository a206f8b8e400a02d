"""One item of a stored mission is replaced: that item and no other, and it is never believed wrongly."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.link.mission_protocol.partial_write.item_rewrite import ItemRewrite, RewriteState
from gcs.link.mission_protocol.read_back import compare_missions
from gcs.link.mission_protocol.rules import MissionRefused
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MissionResult
from gcs.mission.model import Command, MissionItem
from tests.air import VEHICLE, Air, Weather

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
    machine = ItemRewrite(wanted, VEHICLE, AP, look_first=look_first)
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
    air.run(ItemRewrite({2: until(56.0)}, VEHICLE, AP))
    assert air.now_s == pytest.approx(3 * CALM.round_trip_s)
    assert air.sent[GROUND] == 3  # range, item, question


def test_an_item_beyond_the_end_is_refused_and_nothing_changes():
    air = Air(AP, CALM, 0)
    before = air.shelf.items()
    machine = ItemRewrite({40: until(56.0)}, VEHICLE, AP)
    air.run(machine)
    assert isinstance(machine.error, MissionRefused)
    assert air.shelf.items() == before


def test_an_autopilot_without_partial_writes_times_out():
    air = Air(Autopilot.PX4, CALM, 0)
    machine = ItemRewrite({2: until(56.0)}, VEHICLE, Autopilot.PX4)
    air.run(machine)
    assert isinstance(machine.error, PeerTimeout)
    assert "mission item 2" in machine.error.message


def test_a_vehicle_that_refuses_every_item_is_named():
    air = Air(AP, CALM, 0)
    air.shelf.rejects = True
    before = air.shelf.items()
    machine = ItemRewrite({2: until(56.0)}, VEHICLE, AP)
    air.run(machine)
    assert isinstance(machine.error, MissionRefused)
    assert air.shelf.items() == before


def test_what_is_there_already_is_not_sent():
    air = Air(AP, CALM, 0)
    air.run(ItemRewrite({2: until(56.0)}, VEHICLE, AP))
    air.shelf.rejects = True
    before = air.sent[GROUND]
    again = ItemRewrite({2: until(56.0)}, VEHICLE, AP, look_first=True)
    air.run(again)
    assert again.error is None
    assert air.sent[GROUND] == before + 1


def test_an_acknowledgement_proves_nothing():
    machine = ItemRewrite({2: until(56.0)}, VEHICLE, AP)
    machine.start(0.0)
    machine.receive(addressed("MISSION_REQUEST", seq=2), 0.1)
    assert [m.name for m in machine.receive(addressed("MISSION_ACK", type=0), 0.2)] == ["MISSION_REQUEST_INT"]
    assert not machine.done


def test_an_item_that_was_lost_is_sent_again():
    machine = ItemRewrite({2: until(56.0)}, VEHICLE, AP)
    machine.start(0.0)
    machine.receive(addressed("MISSION_REQUEST", seq=2), 0.1)
    assert [m.name for m in machine.tick(5.0)] == ["MISSION_REQUEST_INT"]
    denied = addressed("MISSION_ACK", type=int(MissionResult.DENIED))
    assert [m.name for m in machine.receive(denied, 5.1)] == ["MISSION_ITEM_INT"]
    assert [m.name for m in machine.receive(addressed("MISSION_REQUEST", seq=2), 5.2)] == ["MISSION_ITEM_INT"]
    assert machine.state is RewriteState.READING


def test_other_conversations_and_misuse():
    machine = ItemRewrite({2: until(56.0)}, VEHICLE, AP)
    assert machine.receive(addressed("MISSION_REQUEST", seq=2), 0.0) == []
    machine.start(0.0)
    assert machine.receive(addressed("MISSION_REQUEST", seq=3), 0.0) == []
    assert machine.receive(Message("HEARTBEAT", {}, *VEHICLE), 0.0) == []
    with pytest.raises(ProtocolMisuse):
        machine.start(0.0)
    assert machine.cancel() == []
    assert machine.done


def test_nothing_to_replace_is_done_at_once():
    machine = ItemRewrite({}, VEHICLE, AP)
    assert machine.start(0.0) == []
    assert machine.done
    assert machine.error is None
