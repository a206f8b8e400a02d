"""Missions, fence and rally points as ArduPilot's files: @MISSION/mission.dat, fence.dat and rally.dat.

Knows: the layout (`gcs.link.mission_protocol.mission_dat`), what makes a file invalid: another magic, a number of
items that is not its length's, an item that is all zeros, which is a piece that never came. Does not know: how files
travel, which items please (`shelf`).
"""

from __future__ import annotations

from gcs.errors import PeerError
from gcs.link.ftp.payload import FtpOpcode, read_payload
from gcs.link.mission_protocol.item_messages import item_from_message
from gcs.link.mission_protocol.mission_dat import FIELDS, HEADER, ITEM, MAGIC, path_of
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType
from sim_bridge.protocol.missions.store import MissionStore

WRITTEN_MAX = HEADER.size + 0xFFFF * ITEM.size
_KEEP_OTHERS = 1  # an option: items before `start` and behind the last stay
_KINDS = {path_of(kind): kind for kind in (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)}


def items_in(message: Message) -> range:
    """The numbers of the items of which a piece of a file that is written here has something."""
    asked = read_payload(message)
    if asked is None or asked.opcode != FtpOpcode.WRITE_FILE:
        return range(0)
    first, end = asked.offset - HEADER.size, asked.offset + len(asked.data) - HEADER.size
    return range(max(first, 0) // ITEM.size, max(-(-end // ITEM.size), 0))


class MissionFiles:
    """The virtual folder of one vehicle."""

    def __init__(self, shelf: MissionStore) -> None:
        self._shelf = shelf

    def has(self, path: str) -> bool:
        """Whether there is such a file."""
        return path in _KINDS

    def read(self, path: str) -> bytes:
        """The file as it would be now. Raises KeyError."""
        kind = _KINDS[path]
        told = self._shelf.told(kind)
        rows = (ITEM.pack(*(message.fields[name] for name in FIELDS)) for message in told)
        return HEADER.pack(MAGIC, kind, 0, 0, len(told)) + b"".join(rows)

    def write(self, path: str, data: bytes) -> bool:
        """Take a file that was closed; False where it is refused. Raises KeyError."""
        kind = _KINDS[path]
        if len(data) < HEADER.size:
            return False
        magic, _, options, start, count = HEADER.unpack_from(data)
        rows = [data[at : at + ITEM.size] for at in range(HEADER.size, len(data) - ITEM.size + 1, ITEM.size)]
        if magic != MAGIC or count != len(rows) or not all(map(any, rows)):
            return False
        try:
            items = tuple(
                item_from_message(Message("MISSION_ITEM_INT", dict(zip(FIELDS, ITEM.unpack(row), strict=True))))
                for row in rows
            )
        except PeerError:
            return False
        return self._shelf.replace(kind, items, start=start, clear=not options & _KEEP_OTHERS)
