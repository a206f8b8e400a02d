import pytest

from gcs.autopilots.protocol_timers import MissionTimers, ProtocolTimers
from gcs.errors import PeerError, PeerTimeout, ProtocolMisuse
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import MachineState
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.rules import MissionRefused, mission_ack
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult
from gcs.mission.model import MissionItem

VEHICLE = Station(4, 1)
ITEMS = tuple(MissionItem(16, 3, (0.0, 0.0, 0.0, 0.0), 100 * n, -100 * n, 10.0 + n) for n in range(3))


def from_vehicle(name, source=VEHICLE, target=GROUND, **fields):
    addressed = {"target_system": target.sysid, "target_component": target.compid, "mission_type": 0}
    return Message(name, {**addressed, **fields}, source.sysid, source.compid)


def names(messages):
    return [m.name for m in messages]


def ask(sender, seq, now_s=0.1, name="MISSION_REQUEST_INT", **kwargs):
    return sender.receive(from_vehicle(name, seq=seq, **kwargs), now_s)


def ack(machine, result, now_s=1.0, **kwargs):
    return machine.receive(from_vehicle("MISSION_ACK", type=int(result), **kwargs), now_s)


def started_sender(items=ITEMS):
    sender = MissionSender(items, Exchange(VEHICLE, estimates=False))
    assert names(sender.start(0.0)) == ["MISSION_COUNT"]
    return sender


def all_sent_sender():
    sender = started_sender()
    for seq in range(3):
        ask(sender, seq)
    assert sender.state is MachineState.ALL_SENT
    return sender


@pytest.mark.parametrize("name", ["MISSION_REQUEST", "MISSION_REQUEST_INT"])
def test_both_kinds_of_request_get_integer_items_as_often_as_they_come(name):
    sender = started_sender()
    for seq in (0, 0, 1, 1, 1, 2, 0, 2):
        (item,) = ask(sender, seq, name=name)
        assert item.name == "MISSION_ITEM_INT"
        assert item.fields["seq"] == seq
        assert item.fields["z"] == ITEMS[seq].alt_m
    ack(sender, MissionResult.ACCEPTED)
    assert sender.done
    assert sender.error is None


@pytest.mark.parametrize(
    "foreign",
    [
        {"source": Station(5, 1)},
        {"source": Station(4, 100)},
        {"target": Station(254, 190)},
        {"target": Station(255, 1)},
        {"mission_type": 1},
    ],
)
def test_other_conversations_are_ignored(foreign):
    sender = started_sender()
    assert ask(sender, 0, **foreign) == []
    assert ack(sender, MissionResult.DENIED, **foreign) == []
    assert sender.state is MachineState.OFFERED
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    receiver.start(0.0)
    assert receiver.receive(from_vehicle("MISSION_COUNT", count=2, **foreign), 0.1) == []
    assert receiver.state is MachineState.LISTED


@pytest.mark.parametrize("result", [r for r in MissionResult if r not in (0, 13)])
def test_refusal_names_item_and_reason(result):
    sender = started_sender()
    ask(sender, 0)
    ask(sender, 1)
    ack(sender, result)
    assert isinstance(sender.error, MissionRefused)
    assert sender.error.result == result
    assert sender.error.seq == 1
    assert f"MAV_MISSION_{result.name}" in sender.error.message
    assert "item 1" in sender.error.message


def test_unknown_refusals_keep_their_number():
    sender = started_sender()
    ack(sender, 77)
    assert "77" in str(sender.error)


def test_invalid_sequence_is_not_fatal():
    sender = started_sender()
    ask(sender, 0)
    ack(sender, MissionResult.INVALID_SEQUENCE)
    assert not sender.done
    assert names(ask(sender, 1)) == ["MISSION_ITEM_INT"]


def test_acceptance_before_the_last_item_belongs_to_an_earlier_transfer():
    sender = started_sender()
    ack(sender, MissionResult.ACCEPTED)
    ask(sender, 0)
    ack(sender, MissionResult.ACCEPTED)
    assert not sender.done


def test_busy_after_a_repeated_count_is_forgiven_once_per_repetition():
    sender = started_sender()
    assert names(sender.tick(1.5)) == ["MISSION_COUNT"]
    ack(sender, MissionResult.ERROR, 1.6)
    assert not sender.done
    ack(sender, MissionResult.ERROR, 1.7)
    assert isinstance(sender.error, MissionRefused)


def test_error_after_a_repeated_last_item_says_that_the_acknowledgement_was_lost():
    sender = started_sender()
    for seq in range(len(ITEMS)):
        ask(sender, seq)
    assert names(sender.tick(sender.deadline_s)) == ["MISSION_ITEM_INT"]
    ack(sender, MissionResult.ERROR)
    assert isinstance(sender.error, PeerTimeout)
    assert sender.all_sent  # so that the caller reads back
    sender = started_sender()
    for seq in range(len(ITEMS)):
        ask(sender, seq)
    ack(sender, MissionResult.ERROR)
    assert isinstance(sender.error, MissionRefused)


def test_count_is_repeated_until_the_vehicle_counts_as_silent():
    timers = ProtocolTimers(mission=MissionTimers(reply_s=1.0, retries=2, give_up_s=4.0))
    sender = MissionSender(ITEMS, Exchange(VEHICLE, timers=timers, estimates=False))
    sender.start(0.0)
    sent = []
    while not sender.done:
        now_s = sender.deadline_s
        sent += [(now_s, m.name) for m in sender.tick(now_s)]
    assert sent == [(1.0, "MISSION_COUNT"), (2.0, "MISSION_COUNT")]
    assert isinstance(sender.error, PeerTimeout)
    assert "vehicle 4" in sender.error.message
    assert "first mission item" in sender.error.message
    assert not sender.all_sent


def test_a_lost_ack_ends_in_a_timeout_that_says_all_was_sent():
    sender = all_sent_sender()
    repeated = []
    while not sender.done:
        repeated += sender.tick(sender.deadline_s)
    assert {(m.name, m.fields["seq"]) for m in repeated} == {("MISSION_ITEM_INT", 2)}
    assert len(repeated) == 5
    assert isinstance(sender.error, PeerTimeout)
    assert "MISSION_ACK" in sender.error.message
    assert sender.all_sent


def test_asking_for_ever_is_no_progress():
    sender = started_sender()
    now_s = 0.0
    while not sender.done:
        now_s += 0.5
        ask(sender, 1, now_s)
        sender.tick(now_s)
        assert now_s < 100
    assert isinstance(sender.error, PeerTimeout)


def test_alternating_requests_end_too():
    sender = started_sender()
    now_s = 0.0
    while not sender.done:
        now_s += 0.5
        ask(sender, int(now_s * 2) % 2, now_s)
        sender.tick(now_s)
        assert now_s < 100
    assert isinstance(sender.error, PeerTimeout)


def test_an_empty_mission_is_count_and_ack():
    sender = started_sender(())
    ack(sender, MissionResult.ACCEPTED)
    assert sender.done
    assert sender.error is None


def test_requests_beyond_the_mission_are_not_answered():
    assert ask(started_sender(), 3) == []


def test_a_vehicle_repeats_its_count_when_asked_again():
    sender = started_sender()
    assert names(sender.receive(from_vehicle("MISSION_REQUEST_LIST"), 0.2)) == ["MISSION_COUNT"]


def test_misuse():
    sender = MissionSender(ITEMS, Exchange(VEHICLE, estimates=False))
    with pytest.raises(ProtocolMisuse):
        ask(sender, 0)
    sender.start(0.0)
    with pytest.raises(ProtocolMisuse):
        sender.start(0.0)
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    with pytest.raises(ProtocolMisuse):
        _ = receiver.items
    receiver.start(0.0)
    with pytest.raises(ProtocolMisuse):
        receiver.start(0.0)


def give(receiver, seq, item=None, now_s=0.1):
    fields = item_to_message(item or ITEMS[seq], seq, GROUND).fields
    return receiver.receive(Message("MISSION_ITEM_INT", fields, *VEHICLE), now_s)


def counted_receiver(count=3, **kwargs):
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False), **kwargs)
    (request,) = receiver.receive(from_vehicle("MISSION_COUNT", count=count), 0.0)
    return receiver, request


def test_a_vehicle_pulls_and_acknowledges():
    receiver, request = counted_receiver()
    assert request.name == "MISSION_REQUEST_INT"
    assert [m.fields["seq"] for seq in (0, 1) for m in give(receiver, seq)] == [1, 2]
    (last,) = give(receiver, 2)
    assert (last.name, last.fields["type"]) == ("MISSION_ACK", 0)
    assert receiver.items == ITEMS
    assert names(give(receiver, 2)) == ["MISSION_ACK"]  # the first may have been lost
    assert give(receiver, 1) == []


def test_repeated_and_early_items_are_ignored():
    receiver, _ = counted_receiver()
    assert give(receiver, 1) == []
    give(receiver, 0)
    assert give(receiver, 0) == []
    assert receiver.progress == 1


def test_a_new_count_starts_afresh():
    receiver, _ = counted_receiver()
    give(receiver, 0)
    (request,) = receiver.receive(from_vehicle("MISSION_COUNT", count=1), 0.2)
    assert request.fields["seq"] == 0
    other = MissionItem(22, 3, (0.0, 0.0, 0.0, 0.0), 7, 7, 7.0)
    give(receiver, 0, other)
    assert receiver.items == (other,)


def test_too_many_items_are_refused_with_a_reason():
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False), capacity=2)
    (refusal,) = receiver.receive(from_vehicle("MISSION_COUNT", count=3), 0.0)
    assert refusal.fields["type"] == MissionResult.NO_SPACE
    assert isinstance(receiver.error, PeerError)
    with pytest.raises(ProtocolMisuse):
        _ = receiver.items


def test_silence_of_the_sender_is_named_and_cancelled():
    receiver, _ = counted_receiver()
    give(receiver, 0)
    sent = []
    while not receiver.done:
        sent += receiver.tick(receiver.deadline_s)
    assert names(sent) == ["MISSION_REQUEST_INT"] * 5 + ["MISSION_ACK"]
    assert sent[-1].fields["type"] == MissionResult.OPERATION_CANCELLED
    assert isinstance(receiver.error, PeerTimeout)
    assert "mission item 1 of 3" in receiver.error.message


def test_a_download_that_is_denied():
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    receiver.start(0.0)
    ack(receiver, MissionResult.DENIED)
    assert isinstance(receiver.error, MissionRefused)
    assert receiver.error.seq is None


@pytest.mark.parametrize("make", [all_sent_sender, lambda: counted_receiver()[0]])
def test_cancelling_tells_the_peer_once(make):
    machine = make()
    (told,) = machine.cancel()
    assert told == mission_ack(VEHICLE, MissionResult.OPERATION_CANCELLED, 0)
    assert isinstance(machine.error, PeerError)
    assert machine.cancel() == []
    assert machine.deadline_s is None
