"""Encoder and decoder of MAVLink 2 frames: the only module that imports pymavlink (dialect ardupilotmega).

Bytes that are no frame of this dialect are skipped: vehicles write console text into the link. A corrupt frame must not
discard the valid frame behind it.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Hashable
from typing import Any

os.environ["MAVLINK20"] = "1"  # read once, when the dialect is imported

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import ProtocolMisuse
from gcs.link.wire.fast_frames import FrameLayout
from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import Signature

_CLASSES: dict[str, Any] = {cls.msgname: cls for cls in dialect.mavlink_map.values()}
_TEXT_FIELDS: dict[str, tuple[str, ...]] = {
    name: tuple(f for f, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True) if kind == "char")
    for name, cls in _CLASSES.items()
}
_V1, _V2 = 0xFE, 0xFD

_MARKER = re.compile(b"[\xfd\xfe]")
_ENDS = (b"", b"\xfe", b"\xfd")  # the next byte after a frame of an unknown message, whose checksum cannot be verified
_SIGNED = 0x01
_HEADER_V1, _HEADER_V2, _CHECKSUM, _SIGNATURE = 6, 10, 2, 13
_MAX_SOURCES = 64
# All messages without arrays and single characters among their fields.
_LAYOUTS: dict[str, FrameLayout] = {
    name: FrameLayout(
        name=name,
        message_id=cls.id,
        crc_extra=cls.crc_extra,
        packer=cls.unpacker,
        wire_order=cls.ordered_fieldnames,
        fields=cls.fieldnames,
        texts=_TEXT_FIELDS[name],
    )
    for name, cls in _CLASSES.items()
    if all(
        (length > 0) == (cls.ordered_fieldnames[at] in _TEXT_FIELDS[name])
        for at, length in enumerate(cls.array_lengths)
    )
}
_LAYOUT_BY_ID: dict[bytes, FrameLayout] = {
    _CLASSES[name].id.to_bytes(3, "little"): layout for name, layout in _LAYOUTS.items()
}


class Codec:
    """The encoder of one station, with its own sequence number, and a decoder with one buffer for each source.

    If a chunk ends inside a frame, the next chunk of the same source completes it. If the next chunk begins with a
    whole frame, the rest of the cut frame was lost.
    """

    def __init__(self, sysid: int, compid: int) -> None:
        self._encoder = dialect.MAVLink(None, sysid, compid)
        self._decoder = dialect.MAVLink(None)
        self._tails: dict[Hashable, bytes] = {}

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

    def decode(self, data: bytes, source: Hashable = None) -> list[Message]:
        """Return all whole messages in `data`: one datagram, or the next bytes of a stream, from `source`.

        `source` is any key that distinguishes senders, such as an address. Never raises.
        """
        tail = self._tails.pop(source, b"") if self._tails else b""
        if tail and not self._begins_with_frame(data):
            data = tail + data
        messages: list[Message] = []
        at, size, cut = 0, len(data), -1
        while at < size:
            length = frame_length(data, at)
            if length > size - at:
                cut = at if cut < 0 else cut
                length = 0
            frame = data[at : at + length]
            message = self.decode_frame(frame) if length else None
            if message is not None:
                messages.append(message)
                cut = -1
            elif not (length and _is_unknown(frame) and data[at + length : at + length + 1] in _ENDS):
                marker = _MARKER.search(data, at + 1)
                length = (marker.start() if marker is not None else size) - at
            at += length
        if cut >= 0 and len(self._tails) < _MAX_SOURCES:
            self._tails[source] = data[cut:]
        return messages

    def decode_frame(self, frame: bytes) -> Message | None:
        """Return the message of one whole frame of `frame_length`; None if its checksum is wrong or its id unknown."""
        layout = _LAYOUT_BY_ID.get(frame[7:10]) if frame[0] == _V2 and not frame[2] else None
        if layout is not None:
            fields = layout.read(frame)
            return Message(layout.name, fields, frame[5], frame[6], frame) if fields is not None else None
        return None if _is_unknown(frame) else self._decode_by_dialect(frame)

    def _begins_with_frame(self, data: bytes) -> bool:
        length = frame_length(data, 0) if data else 0
        return 0 < length <= len(data) and self.decode_frame(data[:length]) is not None

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


def frame_length(data: bytes, at: int) -> int:
    """Return the frame length by the header at `at`: 0 if there is no header, more than the rest of `data` if cut."""
    marker, left = data[at], len(data) - at
    if marker == _V2:
        if left < 3:
            return left + 1
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return 0
        return _HEADER_V2 + data[at + 1] + _CHECKSUM + (_SIGNATURE if flags else 0)
    if marker == _V1:
        return _HEADER_V1 + data[at + 1] + _CHECKSUM if left > 1 else left + 1
    return 0


def _is_unknown(frame: bytes) -> bool:
    """Whether the message id is not in the dialect, so that the checksum cannot be verified."""
    number = int.from_bytes(frame[7:10], "little") if frame[0] == _V2 else frame[5]
    return number not in dialect.mavlink_map
