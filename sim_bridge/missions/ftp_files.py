"""Missions, fence and rally points as ArduPilot's files: @MISSION/mission.dat, fence.dat and rally.dat.

`gcs.link.protocols.mission.mission_dat` has the layout. In ArduCopter up to 4.6 (`file_leftovers`) the bytes depend on
how they are read: each reading of a piece fills one item after the other into the same memory, which begins with zeros.
An item without a position therefore has the x, y and z of the item before it, if that was in the same piece.
CalcFileCRC32 reads pieces of 64 bytes: its answer is not the checksum of the bytes that a client reads.

A file is invalid with another magic number, with a count of items that does not match its length, or with an item that
is all zeros: a part that never arrived.
"""

import struct
import zlib

from gcs.autopilots.mission_commands import has_position
from gcs.errors import PeerError
from gcs.link.protocols.ftp.payload import FtpOpcode, read_payload
from gcs.link.protocols.mission.item_messages import item_from_message
from gcs.link.protocols.mission.mission_dat import FIELDS, HEADER, ITEM, MAGIC, path_of
from gcs.link.wire.message import Message
from gcs.mavlink import MissionType
from sim_bridge.missions.store import MissionStore

WRITTEN_MAX = HEADER.size + 0xFFFF * ITEM.size
_CRC_PIECE = 64
_ALL_BITS = 0xFFFFFFFF
_PLACE = slice(16, 28)  # x, y and z in an item
_COMMAND, _COMMAND_AT = struct.Struct("<H"), 30
_KEEP_OTHERS = 1  # an option: keep items before `start` and after the last
_KINDS = {path_of(kind): kind for kind in (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)}


def items_in(message: Message) -> range:
    """Return the numbers of the items that a WRITE_FILE request touches."""
    request = read_payload(message)
    if request is None or request.opcode != FtpOpcode.WRITE_FILE:
        return range(0)
    first, end = request.offset - HEADER.size, request.offset + len(request.data) - HEADER.size
    return range(max(first, 0) // ITEM.size, max(-(-end // ITEM.size), 0))


def piece_of(data: bytes, offset: int, size: int) -> bytes:
    """Return bytes of a file as one reading gives them: with leftovers in items without a position."""
    end = min(offset + size, len(data))
    piece = bytearray(data[offset:end])
    place = bytes(_PLACE.stop - _PLACE.start)
    for item in range(max(offset - HEADER.size, 0) // ITEM.size, max(-(-(end - HEADER.size) // ITEM.size), 0)):
        begin = HEADER.size + item * ITEM.size
        (command,) = _COMMAND.unpack_from(data, begin + _COMMAND_AT)
        if has_position(command):
            place = data[begin + _PLACE.start : begin + _PLACE.stop]
            continue
        for at, byte in enumerate(place, begin + _PLACE.start - offset):
            if 0 <= at < len(piece):
                piece[at] = byte
    return bytes(piece)


def crc32(data: bytes, crc: int = 0) -> int:
    """Return the checksum of CalcFileCRC32: the usual polynomial, begun with 0, without the final inversion."""
    return zlib.crc32(data, crc ^ _ALL_BITS) ^ _ALL_BITS


class MissionFiles:
    """The virtual folder of one vehicle."""

    def __init__(self, store: MissionStore) -> None:
        self._store = store

    def has(self, path: str) -> bool:
        """Whether there is such a file."""
        return path in _KINDS

    def read(self, path: str) -> bytes:
        """Return the present content of the file, without leftovers. Raises KeyError."""
        kind = _KINDS[path]
        messages = self._store.read_back(kind)
        rows = (ITEM.pack(*(message.fields[name] for name in FIELDS)) for message in messages)
        return HEADER.pack(MAGIC, kind, 0, 0, len(messages)) + b"".join(rows)

    def checksum(self, path: str) -> int:
        """Return the answer to CalcFileCRC32. Raises KeyError."""
        data = self.read(path)
        crc = 0
        for offset in range(0, len(data), _CRC_PIECE):
            crc = crc32(self.piece(data, offset, _CRC_PIECE), crc)
        return crc

    def piece(self, data: bytes, offset: int, size: int) -> bytes:
        """Return bytes of a content as this autopilot sends them."""
        return piece_of(data, offset, size) if self._store.file_leftovers else data[offset : offset + size]

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
