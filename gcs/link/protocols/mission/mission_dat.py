"""ArduPilot's mission file: all items of one type as one file in its virtual folder @MISSION (4.1 and newer).

    magic 0x763d | MAV_MISSION_TYPE | options | number of the first item | number of items      (uint16, little endian)
    per item the 38 bytes of MISSION_ITEM_INT, in the order of the wire

The numbers x, y and z of an item without a position mean nothing in a file of ArduPilot up to 4.6. It prepares items
one after the other in the same memory, anew for each piece that is read, so they are those of the item before, or 0.
The three are read as 0.

ArduPilot replaces the mission when the file is closed. It refuses a file with an item of zeros, which is a piece that
never arrived. Pieces therefore end at the end of an item: only whole items can be missing.
"""

import struct
from collections.abc import Sequence
from dataclasses import replace

from gcs.autopilots.mission_commands import has_position
from gcs.errors import PeerError, ProtocolMisuse
from gcs.link.protocols.ftp.payload import DATA_MAX
from gcs.link.protocols.mission.item_messages import item_from_message, item_to_message
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
ITEMS_MAX = 4096  # more than any autopilot can store
_PATHS = {
    int(MissionType.MISSION): "@MISSION/mission.dat",
    int(MissionType.FENCE): "@MISSION/fence.dat",
    int(MissionType.RALLY): "@MISSION/rally.dat",
}


def path_of(mission_type: int) -> str:
    """Return the path of the file on board. Raises KeyError for a type without a file."""
    return _PATHS[mission_type]


def write_mission_file(items: Sequence[MissionItem], mission_type: int = MissionType.MISSION) -> bytes:
    """Return the file that replaces all items of a type. Raises `ProtocolMisuse` for values outside the wire format."""
    parts = [HEADER.pack(MAGIC, mission_type, 0, 0, len(items))]
    for seq, item in enumerate(items):
        fields = item_to_message(item, seq, Station(0, 0), mission_type=mission_type).fields
        try:
            parts.append(ITEM.pack(*(fields[name] for name in FIELDS)))
        except (struct.error, OverflowError, TypeError) as error:
            raise ProtocolMisuse(f"mission item {seq} cannot be written to a mission file: {error}.") from error
    return b"".join(parts)


def length_of(head: bytes, mission_type: int, peer: Station) -> int:
    """Return the length of the file that begins with `head`. Raises `PeerError` if it is no file of this type."""
    if len(head) < HEADER.size:
        raise PeerError(f"{peer} sent a mission file without a header.")
    magic, kind, _, first, count = HEADER.unpack_from(head)
    if magic != MAGIC or kind != mission_type or first or count > ITEMS_MAX:
        raise PeerError(f"{peer} sent a mission file with an invalid header: {head[: HEADER.size].hex(' ')}.")
    return HEADER.size + int(count) * ITEM.size


def read_mission_file(data: bytes, mission_type: int, peer: Station) -> tuple[MissionItem, ...]:
    """Return the items of a whole file, those without a position with zeros there. Raises `PeerError`."""
    if length_of(data, mission_type, peer) != len(data):
        raise PeerError(f"{peer} sent a mission file of {len(data)} bytes; its header gives another length.")
    rows = (dict(zip(FIELDS, values, strict=True)) for values in ITEM.iter_unpack(data[HEADER.size :]))
    items = (item_from_message(Message("MISSION_ITEM_INT", fields, *peer)) for fields in rows)
    return tuple(i if has_position(i.command) else replace(i, lat_degE7=0, lon_degE7=0, alt_m=0.0) for i in items)


def pieces_of(data: bytes) -> list[tuple[int, bytes]]:
    """Return the file as (offset, at most 239 bytes), cut at the ends of items. The first piece contains the header."""
    each = (DATA_MAX - HEADER.size) // ITEM.size * ITEM.size
    ends = range(HEADER.size + each, len(data) + each, each)
    starts = [0, *(end for end in ends if end < len(data))]
    return [(start, data[start:end]) for start, end in zip(starts, [*starts[1:], len(data)], strict=True)]
