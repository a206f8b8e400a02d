"""The mission shelf, faults and pace, each by itself."""

from __future__ import annotations

import math

import pytest

from gcs.errors import UsageError
from gcs.frames import Origin
from gcs.link.dialect import MissionResult, MissionType
from gcs.link.message import GROUND, Message, Station
from gcs.link.mission_compare import compare_missions
from gcs.link.mission_receiver import MissionReceiver
from gcs.link.mission_sender import MissionSender
from gcs.mission.model import MissionItem
from sim_bridge.cli import parse_ground, parse_speedup
from sim_bridge.mission_shelf import MissionShelf, check_item
from sim_bridge.pace import CATCH_UP_S, Pace
from sim_bridge.personality import ARDUPILOT

ME = Station(3, 1)
HOME = Origin(47.0, 8.0, 400.0)
ITEMS = (
    MissionItem(16, 0, (0.0, 0.0, 0.0, 0.0), 1, 2, 3.0),
    MissionItem(22, 3, (0.0, 0.0, 0.0, 0.0), 0, 0, 3.0),
    MissionItem(178, 2, (1.0, 2.5, -1.0, 0.0), 0, 0, 0.0),
    MissionItem(21, 3, (0.0, 0.0, 0.0, 0.0), 473977420, 85455940, 0.0),
)


def shelf() -> tuple[MissionShelf, list]:
    heard: list = []
    return MissionShelf(ME, ARDUPILOT, HOME, heard.append), heard


def talk(machine, vehicle: MissionShelf, messages: list[Message]) -> None:
    """Carry messages to and fro until both are silent."""
    while messages:
        answers = [a for m in messages for a in vehicle.receive(stamped(m, GROUND), 0.0)]
        messages = [a for m in answers for a in machine.receive(stamped(m, ME), 0.0)]


def stamped(message: Message, source: Station) -> Message:
    return Message(message.name, message.fields, *source)


def upload(vehicle: MissionShelf, items=ITEMS, kind=MissionType.MISSION) -> MissionSender:
    sender = MissionSender(items, ME, mission_type=kind)
    talk(sender, vehicle, sender.start(0.0))
    return sender


def test_upload_then_download_is_equal_but_for_home():
    vehicle, heard = shelf()
    assert upload(vehicle).error is None
    assert heard == [vehicle.items()]
    receiver = MissionReceiver(ME)
    talk(receiver, vehicle, receiver.start(0.0))
    assert compare_missions(ITEMS[1:], receiver.items[1:]) == []
    assert receiver.items[0].lat_degE7 == 470000000
    assert receiver.items[0].alt_m == 400.0
    assert not vehicle.busy


def test_home_follows_the_vehicle():
    vehicle, _ = shelf()
    upload(vehicle)
    vehicle.move_home(Origin(46.0, 8.0, 401.0))
    assert vehicle.items()[0].lat_degE7 == 460000000


def test_fence_and_mission_are_kept_apart_and_cleared_each():
    vehicle, _ = shelf()
    fence = (MissionItem(5001, 0, (3.0, 0.0, 0.0, 0.0), 1, 2, 0.0),)
    upload(vehicle)
    upload(vehicle, fence, MissionType.FENCE)
    assert len(vehicle.items()) == 4
    assert vehicle.items(MissionType.FENCE) == fence
    for kind, result in ((255, MissionResult.UNSUPPORTED), (0, MissionResult.ACCEPTED)):
        clear = Message("MISSION_CLEAR_ALL", {"mission_type": kind}, *GROUND)
        assert vehicle.receive(clear, 0.0)[0].fields["type"] == result
    assert vehicle.items() == ()
    assert vehicle.items(MissionType.FENCE) == fence


def test_a_second_station_is_denied_while_the_first_uploads():
    vehicle, _ = shelf()
    count = {"count": 4, "mission_type": 0}
    assert vehicle.receive(Message("MISSION_COUNT", count, 255, 190), 0.0)[0].name == "MISSION_REQUEST"
    (ack,) = vehicle.receive(Message("MISSION_COUNT", count, 254, 190), 0.0)
    assert ack.fields["type"] == MissionResult.DENIED


def test_a_stalled_upload_is_given_up():
    vehicle, heard = shelf()
    vehicle.receive(Message("MISSION_COUNT", {"count": 4, "mission_type": 0}, *GROUND), 0.0)
    said = [message for now_s in range(1, 12) for message in vehicle.tick(float(now_s))]
    assert said[-1].fields["type"] == MissionResult.OPERATION_CANCELLED
    assert not vehicle.busy
    assert heard == []


def test_the_reject_fault_refuses_every_mission():
    vehicle, heard = shelf()
    vehicle.rejects = True
    assert upload(vehicle).error is not None
    assert heard == []


@pytest.mark.parametrize(
    ("change", "result"),
    [
        ({}, MissionResult.ACCEPTED),
        ({"command": 9999}, MissionResult.UNSUPPORTED),
        ({"frame": 99}, MissionResult.UNSUPPORTED_FRAME),
        ({"alt_m": math.nan}, MissionResult.INVALID_PARAM7),
        ({"params": (math.nan, 0.0, 0.0, 0.0)}, MissionResult.INVALID_PARAM1),
        ({"lat_degE7": 1_900_000_000}, MissionResult.INVALID_PARAM5_X),
        ({"lon_degE7": 1_900_000_000}, MissionResult.INVALID_PARAM6_Y),
    ],
)
def test_items_are_refused_with_arducopters_reasons(change, result):
    fields = {"command": 16, "frame": 3, "params": (0.0,) * 4, "lat_degE7": 1, "lon_degE7": 1, "alt_m": 3.0}
    assert check_item(3, MissionItem(**(fields | change))) == result


def test_pace_is_absolute_and_forgives_a_stall():
    pace = Pace(1.0)
    assert pace.wait_s(0.0, 100.0, 2.0) == 0.0
    assert pace.wait_s(1.0, 100.2, 2.0) == pytest.approx(0.3)
    assert pace.wait_s(1.0, 100.5 + 0.5 * CATCH_UP_S, 2.0) == 0.0  # late, to be made up for
    assert pace.wait_s(1.1, 100.5 + 0.5 * CATCH_UP_S, 2.0) == pytest.approx(0.05 - 0.5 * CATCH_UP_S)
    assert pace.wait_s(1.1, 200.0, 2.0) == 0.0  # a stall: starts anew
    assert pace.wait_s(1.3, 200.0, 2.0) == pytest.approx(0.1)
    assert pace.wait_s(9.0, 200.0, math.inf) == 0.0


@pytest.mark.parametrize("text", ["x", "0", "-1", "nan", "inf"])
def test_wrong_speedups(text):
    with pytest.raises(UsageError):
        parse_speedup(text)


@pytest.mark.parametrize("text", ["14550", "host:", ":14550", "host:0", "host:99999"])
def test_wrong_grounds(text):
    with pytest.raises(UsageError):
        parse_ground(text)
