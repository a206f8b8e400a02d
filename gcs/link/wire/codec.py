"""Encoder and decoder of MAVLink 2 frames: the only module that imports pymavlink (dialect ardupilotmega).

Bytes that are no frame of this dialect are skipped: vehicles write console text into the link. A corrupt frame must not
discard the valid frame behind it. The work for a chunk is bounded by its length (`frame_scanner`).
"""

import itertools
import os
import struct
from collections.abc import Hashable

os.environ["MAVLINK20"] = "1"  # read once, when the dialect is imported

from struct import Struct
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import ProtocolMisuse
from gcs.link.wire.frame_scanner import V2, FrameKind, FrameScanner, message_id
from gcs.link.wire.message import Fields, Message, Station
from gcs.link.wire.signing import Signature

_MARKER = b"\xfd"
_HEADER, _CHECKSUM = 10, 2
_CRC_START = 0xFFFF
_CLASSES = {cls.msgname: cls for cls in dialect.mavlink_map.values()}
_TEXT_FIELDS: dict[str, tuple[str, ...]] = {
    name: tuple(f for f, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True) if kind == "char")
    for name, cls in _CLASSES.items()
}
_SCANNER = FrameScanner({n: FrameKind(cls.unpacker.size, cls.crc_extra) for n, cls in dialect.mavlink_map.items()})
_MAX_SOURCES = 64


class FrameLayout:
    """The field layout of one message on the wire; pymavlink's objects take several times as long. It does not sign."""

    def __init__(self, message: Any) -> None:
        """`message`: its class in the dialect."""
        self.name: str = message.msgname
        self._id = int(message.id).to_bytes(3, "little")
        self._crc_extra = bytes([message.crc_extra])
        self._packer: Struct = message.unpacker
        self._wire_order: tuple[str, ...] = tuple(message.ordered_fieldnames)
        ends = list(itertools.accumulate(message.lengths))  # of each field among all values; a text is one value
        wire = {
            field: end - 1 if length == 1 else slice(end - length, end)
            for field, length, end in zip(self._wire_order, message.lengths, ends, strict=True)
        }
        self._fields = [(field, wire[field]) for field in message.fieldnames]
        self._arrays = [at for at, length in enumerate(message.lengths) if length > 1]
        self._texts = [at for field in _TEXT_FIELDS[self.name] if isinstance(at := wire[field], int)]

    def pack(self, fields: Fields, station: tuple[int, int], seq: int) -> bytes | None:
        """Return the frame from a station (system, component); None unless `fields` are exactly those of the message.

        Raises struct.error, TypeError or ValueError for a value that does not fit.
        """
        if len(fields) != len(self._wire_order):
            return None
        try:
            values = [fields[field] for field in self._wire_order]
        except KeyError:
            return None
        for at in reversed(self._arrays):
            values[at : at + 1] = values[at]
        for at in self._texts:
            if isinstance(values[at], str):
                values[at] = values[at].encode()
        packed = self._packer.pack(*values)
        payload = packed.rstrip(b"\0") or packed[:1]
        body = bytes((len(payload), 0, 0, seq, *station)) + self._id + payload
        return _MARKER + body + mcrf4xx(body + self._crc_extra, _CRC_START).to_bytes(_CHECKSUM, "little")

    def read(self, frame: bytes) -> Fields:
        """Return the fields of a whole frame whose checksum is right."""
        size, length = self._packer.size, frame[1]
        if length < size:  # without the zeros at its end
            values = list(self._packer.unpack(frame[_HEADER : _HEADER + length].ljust(size, b"\0")))
        else:
            values = list(self._packer.unpack_from(frame, _HEADER))
        for at in self._texts:
            values[at] = values[at].partition(b"\0")[0].decode("utf-8", "replace")
        return {field: values[at] for field, at in self._fields}


_LAYOUTS: dict[str, FrameLayout] = {name: FrameLayout(cls) for name, cls in _CLASSES.items()}
_LAYOUT_BY_ID: dict[int, FrameLayout] = {_CLASSES[name].id: layout for name, layout in _LAYOUTS.items()}


class Codec:
    """The encoder of one station, with its own sequence number, and a decoder with one buffer for each source.

    If a chunk ends inside a frame, the next chunk of the same source completes it. If the next chunk begins with a
    whole frame, the rest of the cut frame was lost.
    """

    def __init__(self, sysid: int, compid: int) -> None:
        self._encoder = dialect.MAVLink(None, sysid, compid)
        self._decoder = dialect.MAVLink(None)
        self._tails: dict[Hashable, bytes] = {}
        self.dropped_bytes = 0  # of chunks that had little else than broken headers

    @property
    def station(self) -> Station:
        """The source of the frames that this codec encodes."""
        return Station(self._encoder.srcSystem, self._encoder.srcComponent)

    def encode(self, message: Message, signature: Signature | None = None) -> bytes:
        """Return the message as a MAVLink 2 frame, signed if there is a signature.

        The source is this codec's station unless the message names another. Raises `ProtocolMisuse` for a name, a field
        or a value that the dialect does not have.
        """
        encoder = self._encoder
        if signature is None:
            frame = self._packed(message)
            if frame is not None:
                return frame
        own = encoder.srcSystem, encoder.srcComponent
        if signature is not None:
            signing = encoder.signing
            signing.secret_key, signing.link_id, signing.timestamp = signature.key, signature.link_id, signature.ticks
        encoder.signing.sign_outgoing = signature is not None
        try:
            fields = message.fields
            text = _TEXT_FIELDS[message.name]
            if text:
                fields = {k: v.encode() if k in text and isinstance(v, str) else v for k, v in fields.items()}
            encoder.srcSystem = message.sysid or own[0]
            encoder.srcComponent = message.compid or own[1]
            frame = bytes(_CLASSES[message.name](**fields).pack(encoder))
        except KeyError:
            raise ProtocolMisuse(f"{message.name!r} is no MAVLink message of this dialect.") from None
        except (TypeError, struct.error, AttributeError, OverflowError) as error:
            raise ProtocolMisuse(f"{message.name} cannot be encoded: {error}.") from error
        finally:
            encoder.srcSystem, encoder.srcComponent = own
        encoder.seq = (encoder.seq + 1) & 0xFF
        return frame

    def _packed(self, message: Message) -> bytes | None:
        """The message as a frame, or None if it has no `FrameLayout`."""
        layout, encoder = _LAYOUTS.get(message.name), self._encoder
        if layout is None:
            return None
        station = message.sysid or encoder.srcSystem, message.compid or encoder.srcComponent
        try:
            frame = layout.pack(message.fields, station, encoder.seq)
        except (TypeError, ValueError, struct.error, OverflowError) as error:
            raise ProtocolMisuse(f"{message.name} cannot be encoded: {error}.") from error
        if frame is not None:
            encoder.seq = (encoder.seq + 1) & 0xFF
        return frame

    def decode(self, data: bytes, source: Hashable = None, *, joins: bool = True) -> list[Message]:
        """Return all whole messages in `data`: one datagram, or the next bytes of a stream, from `source`.

        `source` is any key that distinguishes senders, such as an address. Without `joins` nothing is kept of a frame
        that the end of `data` cuts. Never raises.
        """
        tail = self._tails.pop(source, b"") if self._tails else b""
        if tail and _SCANNER.first_frame(data) is None:
            data = tail + data
        found = _SCANNER.scan(data)
        self.dropped_bytes += found.dropped
        if found.tail and joins:
            if len(self._tails) >= _MAX_SOURCES:
                del self._tails[next(iter(self._tails))]  # the oldest
            self._tails[source] = found.tail
        return [message for frame in found.frames if (message := self._message(frame)) is not None]

    def decode_frame(self, frame: bytes) -> Message | None:
        """Return the message of one whole frame of `frame_length`; None if its checksum is wrong or its id unknown."""
        return None if _SCANNER.first_frame(frame) is None else self._message(frame)

    def _message(self, frame: bytes) -> Message | None:
        layout = _LAYOUT_BY_ID.get(message_id(frame)) if frame[0] == V2 else None
        if layout is None:
            return self._decode_by_dialect(frame)
        return Message(layout.name, layout.read(frame), frame[5], frame[6], frame)

    def _decode_by_dialect(self, frame: bytes) -> Message | None:
        try:
            decoded = self._decoder.decode(bytearray(frame))
        except dialect.MAVError:
            return None
        name = decoded.msgname
        if name not in _CLASSES:
            return None
        fields = {field: getattr(decoded, field) for field in decoded.fieldnames}
        for field in _TEXT_FIELDS[name]:
            raw: bytes = getattr(decoded, f"_{field}_raw")  # pymavlink's own str is ASCII only
            fields[field] = raw.partition(b"\0")[0].decode("utf-8", "replace")
        header = decoded.get_header()
        return Message(name, fields, header.srcSystem, header.srcComponent, frame)
