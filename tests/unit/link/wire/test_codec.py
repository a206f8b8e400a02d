import math
import re

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import ProtocolMisuse
from gcs.link.protocols.mission.item_messages import item_from_message, item_to_message
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
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


def test_the_short_way_is_the_dialects_bit_by_bit():
    """Most messages are packed and read without pymavlink's objects: the same frames, the same fields."""
    rng, checked = np.random.default_rng(1), 0
    for cls in dialect.mavlink_map.values():
        letters = re.findall(r"[0-9]*[a-zA-Z]", cls.native_format.decode().lstrip("<"))
        kinds = dict(zip(cls.ordered_fieldnames, letters, strict=True))
        for zeros in (0.0, 0.7, 1.0):
            lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
            fields = {name: _value(rng, kinds[name], lengths[name], zeros) for name in cls.fieldnames}
            theirs, ours = dialect.MAVLink(None, 7, 1), Codec(7, 1)
            frame = ours.encode(Message(cls.msgname, fields))
            assert frame == cls(**fields).pack(theirs), cls.msgname
            (message,) = ours.decode(frame)
            by_dialect = ours._decode_by_dialect(frame)
            assert message.source == by_dialect.source == Station(7, 1)
            assert repr(list(message.fields.items())) == repr(list(by_dialect.fields.items()))
            longer = bytes([0xFD, 255]) + frame[2:10] + frame[10:-2].ljust(255, b"\1")
            longer += dialect.x25crc(longer[1:] + bytes([cls.crc_extra])).crc.to_bytes(2, "little")
            assert repr(ours.decode(longer)[0].fields) == repr(ours._decode_by_dialect(longer).fields)
            assert ours.decode(frame[:-1] + bytes([frame[-1] ^ 1])) == []
            checked += 1
    assert checked > 500


def _value(rng, kind, length, zeros):
    if rng.random() < zeros:
        return b"" if kind[-1] == "s" else b"\0" if kind == "c" else [0] * length if length else 0
    if kind[-1] in "cs":
        return rng.bytes(int(kind[:-1] or 1))
    dtype = np.dtype("<" + kind[-1])
    numbers = np.frombuffer(rng.bytes(dtype.itemsize * max(length, 1)), dtype=dtype).tolist()
    return numbers if length else numbers[0]


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
