import pytest

from gcs.autopilots.protocol_timers import CommandTimers
from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.link.protocols.command import CommandMemory, CommandRefused, CommandSender, Position, command_ack
from gcs.link.protocols.exchange import Exchange
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MavCommand, MavResult

VEHICLE = Station(2, 1)
ARM = MavCommand.COMPONENT_ARM_DISARM


def ack(result, command=ARM, source=VEHICLE, target=GROUND):
    fields = {"command": command, "result": int(result), "target_system": target.sysid}
    return Message("COMMAND_ACK", {**fields, "target_component": target.compid}, *source)


TIMERS = CommandTimers(reply_s=1.0, retries=2, progress_s=5.0, limit_s=12.0)


def started():
    sender = CommandSender(ARM, (1.0,), Exchange(VEHICLE), timers=TIMERS)
    (first,) = sender.start(0.0)
    assert first.name == "COMMAND_LONG"
    assert [first.fields[f"param{n}"] for n in range(1, 8)] == [1.0] + [0.0] * 6
    return sender


def test_accepted():
    sender = started()
    sender.receive(ack(MavResult.ACCEPTED), 0.5)
    assert sender.done
    assert sender.error is None
    assert sender.ack is not None


def test_repeats_count_their_confirmation_and_end():
    sender = started()
    sent = []
    while not sender.done:
        sent += sender.tick(sender.deadline_s)
    assert [m.fields["confirmation"] for m in sent] == [1, 2]
    assert isinstance(sender.error, PeerTimeout)
    assert "vehicle 2" in sender.error.message
    assert "MAV_CMD_COMPONENT_ARM_DISARM" in sender.error.message


@pytest.mark.parametrize("result", [r for r in MavResult if r not in (0, 5)])
def test_refusals_say_why(result):
    sender = started()
    sender.receive(ack(result), 0.1)
    assert isinstance(sender.error, CommandRefused)
    assert sender.error.result == result
    assert f"MAV_RESULT_{result.name}" in sender.error.message
    assert "Compass" in sender.error.because("Arm: Compass not healthy").message


@pytest.mark.parametrize(
    "foreign",
    [{"command": 22}, {"source": Station(3, 1)}, {"target": Station(254, 190)}, {"target": Station(255, 0xBF)}],
)
def test_acks_of_others_are_ignored(foreign):
    sender = started()
    sender.receive(ack(MavResult.ACCEPTED, **foreign), 0.1)
    assert not sender.done


def test_in_progress_buys_time_without_repetition_and_not_for_ever():
    sender = started()
    sender.receive(ack(MavResult.IN_PROGRESS), 0.5)
    assert sender.tick(3.0) == []
    assert not sender.done
    sender.receive(ack(MavResult.IN_PROGRESS), 5.0)
    sender.receive(ack(MavResult.IN_PROGRESS), 9.0)
    assert sender.deadline_s == 12.0
    assert sender.tick(12.0) == []
    assert isinstance(sender.error, PeerTimeout)


def test_a_position_makes_it_a_command_int():
    sender = CommandSender(192, (1.0,), Exchange(VEHICLE), position=Position(6, 473977420, 85455939, 10.0))
    (message,) = sender.start(0.0)
    assert message.name == "COMMAND_INT"
    assert (message.fields["x"], message.fields["y"], message.fields["z"]) == (473977420, 85455939, 10.0)
    with pytest.raises(ProtocolMisuse, match="4 parameters"):
        CommandSender(192, (1.0,) * 5, Exchange(VEHICLE), position=Position(6, 0, 0, 0.0))


def test_misuse():
    with pytest.raises(ProtocolMisuse):
        started().start(0.0)
    with pytest.raises(ProtocolMisuse, match="7 parameters"):
        CommandSender(ARM, (0.0,) * 8, Exchange(VEHICLE))


def test_a_repeated_command_is_recognised_and_a_new_one_is_not():
    memory = CommandMemory(memory_s=10.0)
    sender = started()
    (again,) = sender.tick(1.0)
    first = Message("COMMAND_LONG", {**again.fields, "confirmation": 0}, *GROUND)
    again = Message("COMMAND_LONG", again.fields, *GROUND)
    assert memory.repeated(again, 0.0) is None
    answer = command_ack(first, MavResult.ACCEPTED)
    memory.answered(first, answer, 0.0)
    assert memory.repeated(first, 1.0) is None
    assert memory.repeated(again, 1.0) == answer
    assert memory.repeated(again, 11.0) is None
    assert memory.repeated(Message("COMMAND_LONG", {**again.fields, "param1": 0.0}, *GROUND), 1.0) is None
    assert memory.repeated(Message("COMMAND_LONG", again.fields, 254, 190), 1.0) is None
    assert (answer.fields["target_system"], answer.fields["target_component"]) == GROUND
