"""Missions, fence and rally points as ArduPilot's files: @MISSION/mission.dat, fence.dat and rally.dat.

`gcs.link.mission_protocol.mission_dat` has the layout. A file is invalid with another magic number, with a count of
items that does not match its length, or with an item that is all zeros: a part that never arrived.
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
_KEEP_OTHERS = 1  # an option: keep items before `start` and after the last
_KINDS = {path_of(kind): kind for kind in (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)}


def items_in(message: Message) -> range:
    """Return the numbers of the items that a WRITE_FILE request touches."""
    request = read_payload(message)
    if request is None or request.opcode != FtpOpcode.WRITE_FILE:
        return range(0)
    first, end = request.offset - HEADER.size, request.offset + len(request.data) - HEADER.size
    return range(max(first, 0) // ITEM.size, max(-(-end // ITEM.size), 0))


class MissionFiles:
    """The virtual folder of one vehicle."""

    def __init__(self, store: MissionStore) -> None:
        self._store = store

    def has(self, path: str) -> bool:
        """Whether there is such a file."""
        return path in _KINDS

    def read(self, path: str) -> bytes:
        """Return the present content of the file. Raises KeyError."""
        kind = _KINDS[path]
        messages = self._store.read_back(kind)
        rows = (ITEM.pack(*(message.fields[name] for name in FIELDS)) for message in messages)
        return HEADER.pack(MAGIC, kind, 0, 0, len(messages)) + b"".join(rows)

    def write(self, path: str, data: bytes) -> bool:
        """Store a file that was closed; return False if it is refused. Raises KeyError."""
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
        return self._store.replace(kind, items, start=start, clear=not options & _KEEP_OTHERS)
