"""Mission items on the wire: what every field becomes, there and back, and degrees rounded to 1e-7, not cut."""

from __future__ import annotations

import math

import pytest

from gcs.errors import PeerError
from gcs.link.protocols.mission.item_messages import (
    file_frame,
    home_item,
    item_from_message,
    item_to_message,
    with_home,
)
from gcs.link.protocols.mission.rules import mission_type_of
from gcs.link.wire.message import Message, Station
from gcs.mission.model import Home, MissionItem

VEHICLE = Station(3, 1)
ITEM = MissionItem(16, 3, (0.5, 1.5, 2.5, 3.5), 473977420, -85455939, 12.25, autocontinue=False)
FIELDS = {
    **{"target_system": 3, "target_component": 1, "seq": 7, "frame": 6, "command": 16, "current": 0, "autocontinue": 0},
    **{"param1": 0.5, "param2": 1.5, "param3": 2.5, "param4": 3.5},
    **{"x": 473977420, "y": -85455939, "z": 12.25, "mission_type": 0},
}


@pytest.mark.parametrize(
    ("how", "fields"),
    [
        ({}, {}),
        ({"current": True}, {"current": 1}),
        ({"mission_type": 2}, {"mission_type": 2}),
        ({"integer_frames": False}, {"frame": 3}),
    ],
)
def test_every_field_of_an_item_stands_in_its_place(how, fields):
    message = item_to_message(ITEM, 7, VEHICLE, **how)
    assert (message.name, message.fields) == ("MISSION_ITEM_INT", {**FIELDS, **fields})
    assert item_from_message(message) == ITEM


@pytest.mark.parametrize(("file", "wire"), [(0, 5), (3, 6), (10, 11), (2, 2), (21, 21)])
def test_frames_of_files_and_of_links(file, wire):
    item = MissionItem(16, file, (0.0,) * 4, 0, 0, 0.0)
    assert item_to_message(item, 0, VEHICLE).fields["frame"] == wire
    assert file_frame(wire) == file_frame(file) == file


@pytest.mark.parametrize(
    ("deg", "degE7"),
    [(47.3977420, 473977420), (0.00000006, 1), (-0.00000006, -1), (-0.00000004, 0), (-122.25678886, -1222567889)],
)
def test_degrees_are_rounded_to_the_nearest_step_of_the_wire(deg, degE7):
    for x, y in ((deg, 1.0), (1.0, deg)):
        item = item_from_message(Message("MISSION_ITEM", {**FIELDS, "x": x, "y": y}, *VEHICLE))
        assert (item.lat_degE7, item.lon_degE7) == ((degE7, 10**7) if x == deg else (10**7, degE7))
        home = home_item(Home(x, y, 488.0))
        assert (home.lat_degE7, home.lon_degE7) == (item.lat_degE7, item.lon_degE7)


@pytest.mark.parametrize(("x", "y"), [(math.nan, 8.0), (47.0, math.inf), (math.nan, math.nan)])
def test_a_place_that_is_no_number_is_named_with_its_item(x, y):
    with pytest.raises(PeerError, match="vehicle 3 sent mission item 7 without a finite position"):
        item_from_message(Message("MISSION_ITEM", {**FIELDS, "x": x, "y": y}, *VEHICLE))


def test_ardupilot_gets_home_as_item_0_above_mean_sea_level():
    home = Home(47.397742, 8.5455939, 488.5)
    assert with_home([ITEM, ITEM], home) == (
        MissionItem(16, 0, (0.0, 0.0, 0.0, 0.0), 473977420, 85455939, 488.5, autocontinue=True),
        ITEM,
        ITEM,
    )


def test_mavlink_1_has_only_flight_missions():
    assert mission_type_of(Message("MISSION_ACK", {"type": 0})) == 0
    assert mission_type_of(Message("MISSION_ACK", {"type": 0, "mission_type": 2})) == 2
