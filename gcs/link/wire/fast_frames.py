"""Frames of messages whose fields are numbers and words: nine in ten of all that are sent, packed and read directly.

Knows: MAVLink 2 framing, checksums. Does not know: pymavlink (whose objects take several times as long), signatures,
messages with lists among their fields.
"""

from __future__ import annotations

from struct import Struct
from typing import Any

from fastcrc.crc16 import mcrf4xx

MARKER = 0xFD
HEADER, CHECKSUM = 10, 2
_CRC_BEGINS = 0xFFFF


class FrameLayout:
    """Where the fields of message `name`, number `number`, are on the wire.

    `wire` are its fields in wire order, packed by `numbers`; `order` the same fields as people list them; `texts` those
    that are words; `seed` the byte of the dialect in its checksums.
    """

    def __init__(
        self, name: str, number: int, seed: int, numbers: Struct, wire: list[str], order: list[str], texts: list[str]
    ) -> None:
        self.name = name
        self._number = number.to_bytes(3, "little")
        self._seed = bytes([seed])
        self._numbers = numbers
        self._wire = tuple(wire)
        self._order = [(field, wire.index(field)) for field in order]
        self._texts = [wire.index(field) for field in texts]

    def pack(self, fields: dict[str, Any], station: tuple[int, int], seq: int) -> bytes | None:
        """The frame, from a station (system, component); None where not all fields are there, and no others.

        Raises struct.error, TypeError or ValueError for a value that does not fit.
        """
        if len(fields) != len(self._wire):
            return None
        try:
            values = [fields[field] for field in self._wire]
        except KeyError:
            return None
        for at in self._texts:
            if isinstance(values[at], str):
                values[at] = values[at].encode()
        packed = self._numbers.pack(*values)
        payload = packed.rstrip(b"\0") or packed[:1]
        body = bytes((len(payload), 0, 0, seq, *station)) + self._number + payload
        return b"\xfd" + body + mcrf4xx(body + self._seed, _CRC_BEGINS).to_bytes(CHECKSUM, "little")

    def read(self, frame: bytes) -> dict[str, Any] | None:
        """The fields of a whole, unsigned frame; None where its checksum is wrong."""
        if mcrf4xx(frame[1:-CHECKSUM] + self._seed, _CRC_BEGINS) != int.from_bytes(frame[-CHECKSUM:], "little"):
            return None
        size = self._numbers.size
        values = list(self._numbers.unpack(frame[HEADER:-CHECKSUM].ljust(size, b"\0")[:size]))
        for at in self._texts:
            values[at] = values[at].partition(b"\0")[0].decode("utf-8", "replace")
        return {field: values[at] for field, at in self._order}
