"""Partial writes: the emulated ArduCopter answers what ArduCopter 4.5.6 answered to the same messages, recorded."""

from __future__ import annotations

import pytest

from gcs.frames import Origin
from gcs.link.protocols.mission.item_messages import item_to_message
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionType
from gcs.mission.model import Command, MissionItem
from sim_bridge.missions.store import MissionStore
from sim_bridge.personality.ardupilot_missions import MISSIONS
from sim_bridge.personality.px4_missions import MISSIONS as PX4

VEHICLE = Station(9, 1)
TO = {"target_system": 9, "target_component": 1, "mission_type": 0}
OK, ERROR, OUT_OF_ORDER, DENIED, CANCELLED = 0, 1, 13, 14, 15


def item(second: float) -> MissionItem:
    return MissionItem(Command.NAV_DELAY, 2, (-1.0, 4.0, 5.0, second), 0, 0, 0.0)


def write(first, last):
    return Message("MISSION_WRITE_PARTIAL_LIST", {**TO, "start_index": first, "end_index": last}, *GROUND)


def read(seq):
    return Message("MISSION_REQUEST_INT", {**TO, "seq": seq}, *GROUND)


def put(seq):
    message = item_to_message(item(float(seq)), seq, VEHICLE)
    return Message(message.name, message.fields, *GROUND)


# What was sent (a number: seconds of silence) and what came back: the number of an item, the result of a MISSION_ACK.
RECORDED = {
    "one item": ([write(2, 2), put(2), read(2)], ["ask 2", OK, "item 2"]),
    "two items": ([write(3, 4), put(3), put(4)], ["ask 3", "ask 4", OK]),
    "appended": ([write(6, 6)], ["ask 6"]),
    "beyond the end": ([write(41, 41)], [ERROR]),
    "ends before it begins": ([write(3, 2)], [ERROR]),
    "read too early": ([write(2, 2), read(2)], ["ask 2", DENIED]),
    "silence": ([write(2, 2), 8.5], ["ask 2", *["ask 2"] * 7, CANCELLED]),
    "not requested": ([put(2)], [ERROR]),
    "another one": ([write(2, 2), put(4), put(2)], ["ask 2", OUT_OF_ORDER, OK]),
    "changed its mind": ([write(2, 2), write(4, 4), put(4)], ["ask 2", "ask 4", OK]),
}


def told(messages):
    names = {"MISSION_REQUEST": "ask", "MISSION_ITEM_INT": "item"}
    return [m.fields["type"] if m.name == "MISSION_ACK" else f"{names[m.name]} {m.fields['seq']}" for m in messages]


def vehicle(traits=MISSIONS):
    store = MissionStore(VEHICLE, traits, Origin(47.0, 8.0, 400.0), lambda *_: None, lambda *_: None)
    store._items[MissionType.MISSION] = tuple(item(30.0 + n) for n in range(6))
    return store


@pytest.mark.parametrize("scene", RECORDED)
def test_it_answers_as_recorded(scene):
    sent, came = RECORDED[scene]
    store, now_s, answers = vehicle(), 0.0, []
    for one in sent:
        if isinstance(one, float):
            for _ in range(round(one / 0.1)):
                now_s += 0.1
                answers += store.tick(now_s)
        else:
            answers += store.receive(one, now_s)
    assert told(answers) == came


def test_only_the_items_of_the_range_change():
    store = vehicle()
    for message in RECORDED["two items"][0]:
        store.receive(message, 0.0)
    seconds = [one.params[3] for one in store.items()[1:]]
    assert seconds == [31.0, 32.0, 3.0, 4.0, 35.0]


def test_px4_does_not_know_them():
    assert vehicle(PX4).receive(write(2, 2), 0.0) == []
