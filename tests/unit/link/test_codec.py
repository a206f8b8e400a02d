import math
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import ProtocolMisuse
from gcs.link.codec import Codec, Message, Station, item_from_message, item_to_message
from gcs.mission.model import MissionItem

POSITION = Message(
    "LOCAL_POSITION_NED", {"time_boot_ms": 5, "x": 1.0, "y": 2.0, "z": 3.0, "vx": 4.0, "vy": 5.0, "vz": 6.0}
)
TEXT = Message("STATUSTEXT", {"severity": 4, "text": "Höhe 3 m", "id": 7, "chunk_seq": 0})
VEHICLE, GROUND = Codec(3, 1), Codec(255, 190)


def test_frames_are_mavlink_2_and_numbered():
    codec = Codec(3, 1)
    first, second = codec.encode(POSITION), codec.encode(POSITION)
    assert first[0] == 0xFD
    assert (second[4] - first[4]) % 256 == 1
    numbers = [codec.encode(POSITION)[4] for _ in range(300)]
    assert max(numbers) == 255
    assert min(numbers) == 0


def test_frames_of_numbers_are_the_dialects_own_bit_by_bit():
    """They are packed by a shorter way than pymavlink's."""
    rng, checked = np.random.default_rng(1), 0
    for cls in dialect.mavlink_map.values():
        if any(cls.array_lengths) or "char" in cls.fieldtypes:
            continue
        for zeros in (0.0, 0.7, 1.0):
            fields = {}
            for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
                bits = 8 * dict(zip(cls.ordered_fieldnames, _sizes(cls), strict=True))[name]
                low = 0 if kind.startswith("uint") else -(2 ** (bits - 1))
                value = rng.uniform(-1e3, 1e3) if kind in ("float", "double") else int(rng.integers(0, 2 ** (bits - 1)))
                fields[name] = 0 if rng.random() < zeros else value if kind in ("float", "double") else value + low
            theirs, ours = dialect.MAVLink(None, 7, 1), Codec(7, 1)
            theirs.seq = 0
            assert ours.encode(Message(cls.msgname, fields)) == cls(**fields).pack(theirs), cls.msgname
            checked += 1
    assert checked > 300


def _sizes(cls):
    return [struct.calcsize("<" + letter) for letter in cls.native_format.decode()[1:]]


def test_what_is_encoded_is_decoded_with_its_source_and_raw_frame():
    frame = VEHICLE.encode(TEXT)
    (message,) = GROUND.decode(frame)
    assert message.name == "STATUSTEXT"
    assert message.fields["text"] == "Höhe 3 m"
    assert message.source == Station(3, 1)
    assert message.raw == frame


def test_a_message_may_name_its_own_source_once():
    codec = Codec(3, 1)
    frames = codec.encode(Message(POSITION.name, POSITION.fields, sysid=9, compid=2)) + codec.encode(POSITION)
    assert [m.source for m in GROUND.decode(frames)] == [Station(9, 2), Station(3, 1)]


def test_a_broken_frame_does_not_take_the_good_one_behind_it_along():
    frame = VEHICLE.encode(POSITION)
    broken = bytearray(frame)
    broken[1] = 0xFF  # claims to be longer than everything that follows
    codec = Codec(255, 190)
    assert [m.name for m in codec.decode(bytes(broken) + frame)] == [POSITION.name]
    assert [m.name for m in codec.decode(b"0 0 " + frame[:-1] + b"\x00" + frame)] == [POSITION.name]


def test_a_frame_cut_in_two_is_joined_per_source():
    frame = VEHICLE.encode(POSITION)
    codec = Codec(255, 190)
    assert codec.decode(frame[:20], "a") == []
    assert codec.decode(frame[20:], "b") == []
    assert [m.name for m in codec.decode(frame[20:], "a")] == [POSITION.name]


def test_a_lost_rest_does_not_spoil_the_next_datagram():
    frame = VEHICLE.encode(POSITION)
    codec = Codec(255, 190)
    assert codec.decode(frame[:20]) == []
    assert len(codec.decode(frame)) == 1


def test_unknown_message_ids_are_stepped_over():
    frame = VEHICLE.encode(POSITION)
    unknown = bytes([0xFD, 3, 0, 0, 0, 1, 1, 0x0F, 0xFF, 0x0F, 0xFD, 0xFE, 0xFD, 1, 2])
    assert [m.name for m in Codec(255, 190).decode(frame + unknown + frame)] == [POSITION.name] * 2


@pytest.mark.parametrize(
    ("name", "fields", "word"),
    [
        ("NO_SUCH_MESSAGE", {}, "NO_SUCH_MESSAGE"),
        ("HEARTBEAT", {"type": 2}, "missing"),
        ("MISSION_COUNT", {"target_system": 1, "target_component": 1, "count": 70_000}, "MISSION_COUNT"),
        ("SYSTEM_TIME", {"time_unix_usec": 1, "time_boot_ms": 1, "colour": 3}, "colour"),
    ],
)
def test_misuse_is_ours(name, fields, word):
    with pytest.raises(ProtocolMisuse, match=word):
        GROUND.encode(Message(name, fields))


@pytest.mark.parametrize(("file_frame", "wire_frame"), [(0, 5), (3, 6), (10, 11), (2, 2), (99, 99)])
def test_items_change_frames_on_the_wire_and_come_back(file_frame, wire_frame):
    item = MissionItem(16, file_frame, (1.5, math.inf, 0.0, 0.25), -353632610, 1491652300, 12.5)
    message = item_to_message(item, 4, Station(1, 1), current=True)
    assert message.fields["frame"] == wire_frame
    (received,) = GROUND.decode(VEHICLE.encode(message))
    assert item_from_message(received) == item
    assert received.fields["seq"] == 4
    assert received.fields["current"] == 1


def test_float_items_are_rounded_not_cut():
    fields = item_to_message(MissionItem(16, 3, (0.0,) * 4, 0, 0, 1.0), 0, Station(1, 1)).fields
    message = Message("MISSION_ITEM", {**fields, "frame": 3, "x": 47.39774, "y": -8.5455935})
    item = item_from_message(message)
    assert (item.lat_degE7, item.lon_degE7) == (473977400, -85455935)
