"""Fast frames: messages whose fields are numbers and texts are packed and read directly, without objects of pymavlink.

Nine of ten messages are of this kind; pymavlink takes several times as long. Arrays are not handled, and signatures are
not written.
"""

from __future__ import annotations

from collections.abc import Sequence
from struct import Struct
from typing import Any

from fastcrc.crc16 import mcrf4xx

_MARKER = b"\xfd"
_HEADER, _CHECKSUM = 10, 2
_CRC_START = 0xFFFF


class FrameLayout:
    """The field layout of one message on the wire.

    `wire_order` lists its fields in the order that `packer` packs them, `fields` the same in the order of the message
    definition. `texts` are the fields of characters, `crc_extra` is the dialect's byte in the checksum.
    """

    def __init__(
        self,
        *,
        name: str,
        message_id: int,
        crc_extra: int,
        packer: Struct,
        wire_order: Sequence[str],
        fields: Sequence[str],
        texts: Sequence[str],
    ) -> None:
        self.name = name
        self._id = message_id.to_bytes(3, "little")
        self._crc_extra = bytes([crc_extra])
        self._packer = packer
        self._wire_order = tuple(wire_order)
        self._fields = [(field, wire_order.index(field)) for field in fields]
        self._texts = [wire_order.index(field) for field in texts]

    def pack(self, fields: dict[str, Any], station: tuple[int, int], seq: int) -> bytes | None:
        """Return the frame from a station (system, component); None unless `fields` are exactly those of the message.

        Raises struct.error, TypeError or ValueError for a value that does not fit.
        """
        if len(fields) != len(self._wire_order):
            return None
        try:
            values = [fields[field] for field in self._wire_order]
        except KeyError:
            return None
        for at in self._texts:
            if isinstance(values[at], str):
                values[at] = values[at].encode()
        packed = self._packer.pack(*values)
        payload = packed.rstrip(b"\0") or packed[:1]
        body = bytes((len(payload), 0, 0, seq, *station)) + self._id + payload
        return _MARKER + body + mcrf4xx(body + self._crc_extra, _CRC_START).to_bytes(_CHECKSUM, "little")

    def read(self, frame: bytes) -> dict[str, Any]:
        """Return the fields of a whole frame whose checksum is right."""
        size, length = self._packer.size, frame[1]
        if length < size:  # without the zeros at its end
            values = list(self._packer.unpack(frame[_HEADER : _HEADER + length].ljust(size, b"\0")))
        else:
            values = list(self._packer.unpack_from(frame, _HEADER))
        for at in self._texts:
            values[at] = values[at].partition(b"\0")[0].decode("utf-8", "replace")
        return {field: values[at] for field, at in self._fields}
