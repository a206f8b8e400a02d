"""ArduPilot's mission file: all items of one type as one file of its virtual folder @MISSION (4.1 and newer).

Knows: the file's layout, and where to cut it. Does not know: how files travel.

    magic 0x763d | MAV_MISSION_TYPE | options | number of the first item | number of items      (uint16, little endian)
    per item the 38 bytes of MISSION_ITEM_INT, in the order of the wire

ArduPilot replaces the mission when the file is closed, and refuses a file with an item that is all zeros: a piece that
never came. So pieces end where items end: whatever is missing is a whole item.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from gcs.errors import PeerError, ProtocolMisuse
from gcs.link.ftp.payload import DATA_MAX
from gcs.link.mission_protocol.item_messages import item_from_message, item_to_message
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem

MAGIC = 0x763D
HEADER = struct.Struct("<5H")
ITEM = struct.Struct("<4fiif2H6B")
FIELDS = (
    *("param1", "param2", "param3", "param4", "x", "y", "z", "seq", "command"),
    *("target_system", "target_component", "frame", "current", "autocontinue", "mission_type"),
)
ITEMS_MAX = 4096  # more than any autopilot stores
_PATHS = {
    int(MissionType.MISSION): "@MISSION/mission.dat",
    int(MissionType.FENCE): "@MISSION/fence.dat",
    int(MissionType.RALLY): "@MISSION/rally.dat",
}


def path_of(mission_type: int) -> str:
    """The file's name on board. Raises KeyError for a type that has none."""
    return _PATHS[mission_type]


def write_mission_file(items: Sequence[MissionItem], mission_type: int = MissionType.MISSION) -> bytes:
    """The file that replaces all items of a type. Raises `ProtocolMisuse` for values that the wire does not carry."""
    parts = [HEADER.pack(MAGIC, mission_type, 0, 0, len(items))]
    for seq, item in enumerate(items):
        fields = item_to_message(item, seq, Station(0, 0), mission_type=mission_type).fields
        try:
            parts.append(ITEM.pack(*(fields[name] for name in FIELDS)))
        except (struct.error, OverflowError, TypeError) as error:
            raise ProtocolMisuse(f"mission item {seq} cannot be written: {error}.") from error
    return b"".join(parts)


def length_of(head: bytes, mission_type: int, peer: Station) -> int:
    """How long the file is that begins so. Raises `PeerError` where it is none of this type."""
    if len(head) < HEADER.size:
        raise PeerError(f"{peer} sent a mission file without a header.")
    magic, kind, _, first, count = HEADER.unpack_from(head)
    if magic != MAGIC or kind != mission_type or first or count > ITEMS_MAX:
        raise PeerError(f"{peer} sent a mission file that is none: {head[: HEADER.size].hex(' ')}.")
    return HEADER.size + int(count) * ITEM.size


def read_mission_file(data: bytes, mission_type: int, peer: Station) -> tuple[MissionItem, ...]:
    """The items of a whole file. Raises `PeerError`: no half is ever believed."""
    if length_of(data, mission_type, peer) != len(data):
        raise PeerError(f"{peer} sent a mission file of {len(data)} bytes, which is not what its header says.")
    rows = (dict(zip(FIELDS, values, strict=True)) for values in ITEM.iter_unpack(data[HEADER.size :]))
    return tuple(item_from_message(Message("MISSION_ITEM_INT", fields, *peer)) for fields in rows)


def pieces_of(data: bytes) -> list[tuple[int, bytes]]:
    """The file as offsets and at most 239 bytes each, cut where items end; the first has the header and its items."""
    each = (DATA_MAX - HEADER.size) // ITEM.size * ITEM.size
    ends = range(HEADER.size + each, len(data) + each, each)
    starts = [0, *(end for end in ends if end < len(data))]
    return [(start, data[start:end]) for start, end in zip(starts, [*starts[1:], len(data)], strict=True)]
