"""Finds frames in received bytes, in linear time for any input.

A header must be plausible before anything is computed, and checksums have a budget. Bytes that exhaust it are no
link with errors, but an attack or another protocol: the rest of the chunk is dropped whole.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from fastcrc.crc16 import mcrf4xx

V1, V2 = 0xFE, 0xFD
HEADER_V1, HEADER_V2, CHECKSUM, SIGNATURE = 6, 10, 2, 13
_AROUND_V1, _AROUND_V2 = HEADER_V1 + CHECKSUM, HEADER_V2 + CHECKSUM
_SIGNED = 0x01  # the only flag of MAVLink 2 that there is
_CRC_START = 0xFFFF
_ENDS = (b"", b"\xfe", b"\xfd")  # the next byte after a frame of an unknown message, whose checksum cannot be verified
_CANDIDATE = re.compile(rb"\xfe|\xfd(?=.[\x00\x01]|.?\Z)", re.DOTALL)  # looks ahead: markers may follow each other
_LONG = 256  # bytes from which on all candidates are found at once
# The work for one chunk, in bytes of checksum. A failed header costs as much as _ATTEMPT bytes.
_PER_BYTE, _FREE, _ATTEMPT = 4, 2048, 32
_FAR_BACK = 128  # a larger gap means a late frame or a copy


@dataclass(frozen=True)
class FrameKind:
    """One message on the wire: its size with all extensions, and its byte in the checksum."""

    size: int
    crc_extra: int


class Scan:
    """What one chunk contained."""

    __slots__ = ("dropped", "frames", "tail", "work")

    def __init__(self) -> None:
        self.frames: list[bytes] = []  # whole, of known messages, with the right checksum
        self.tail = b""  # the beginning of a frame at the end
        self.dropped = 0  # bytes that the budget left unread
        self.work = 0  # bytes of checksum, and some for each failed header


class FrameScanner:
    """The scanner of one dialect: `kinds` by message id."""

    def __init__(self, kinds: Mapping[int, FrameKind]) -> None:
        self._extra = {number: bytes([kind.crc_extra]) for number, kind in kinds.items()}
        sizes = np.full(256, 255)  # an unknown message may have any length
        for number, kind in kinds.items():
            if number < len(sizes):
                sizes[number] = kind.size
        self._largest_v1 = sizes

    def scan(self, data: bytes) -> Scan:
        """Return the frames in `data`, one datagram or a piece of a stream. Never raises."""
        found = Scan()
        frames, at, size, cut = found.frames, 0, len(data), -1
        budget = _PER_BYTE * size + _FREE
        candidates: Iterator[int] | None = None
        extras = self._extra
        while at < size:
            length = frame_length(data, at)
            if length > size - at:
                cut = at if cut < 0 and self._plausible(data, at) else cut
            elif length:
                end = at + length
                is_v2 = data[at] == V2
                number = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16 if is_v2 else data[at + 5]
                extra = extras.get(number)
                if extra is None:
                    if end == size:
                        cut = at if cut < 0 else cut  # what follows will tell whether it was a frame
                    if data[end : end + 1] in _ENDS:
                        at = end
                        continue
                elif is_v2 or self._plausible(data, at):
                    found.work += length
                    frame = data[at:end]
                    if _checksum_is_right(frame, extra):
                        frames.append(frame)
                        cut, at = -1, end
                        continue
            found.work += _ATTEMPT
            if found.work > budget:
                found.dropped = size - at
                return found
            if candidates is None:
                candidates = self._candidates(data, at + 1)
            at = next((place for place in candidates if place > at), size)
        if cut >= 0:
            found.tail = data[cut:]
        return found

    def first_frame(self, data: bytes) -> bytes | None:
        """Return the frame of a known message that `data` begins with, if its checksum is right."""
        length = frame_length(data, 0) if data else 0
        if not 0 < length <= len(data) or not self._plausible(data, 0):
            return None
        extra = self._extra.get(message_id(data))
        return data[:length] if extra is not None and _checksum_is_right(data[:length], extra) else None

    def _plausible(self, data: bytes, at: int) -> bool:
        """Whether a MAVLink 1 header can be one: its message is never longer than all its fields. MAVLink 2 may be."""
        if data[at] == V2 or len(data) - at < HEADER_V1:
            return True
        return data[at + 1] <= int(self._largest_v1[data[at + 5]])

    def _candidates(self, data: bytes, begin: int) -> Iterator[int]:
        if len(data) - begin < _LONG:
            return (match.start() for match in _CANDIDATE.finditer(data, begin))
        octets = np.frombuffer(data, dtype=np.uint8)
        padded = np.concatenate((octets[begin:], np.zeros(HEADER_V1, dtype=np.uint8)))
        places = np.flatnonzero((octets[begin:] == V1) | (octets[begin:] == V2))
        is_v2 = padded[places] == V2
        fits_v1 = padded[places + 1] <= self._largest_v1[padded[places + 5]]
        fits_v2 = padded[places + 2] <= _SIGNED
        near_end = places > len(octets) - begin - HEADER_V1
        return iter((begin + places[np.where(is_v2, fits_v2, fits_v1) | near_end]).tolist())


def frame_length(data: bytes, at: int) -> int:
    """Return the frame length by the header at `at`: 0 if there is no header, more than the rest of `data` if cut."""
    marker, left = data[at], len(data) - at
    if marker == V2:
        if left < 3:
            return left + 1
        flags = data[at + 2]
        if flags > _SIGNED:
            return 0
        return _AROUND_V2 + data[at + 1] + (SIGNATURE if flags else 0)
    if marker == V1:
        return _AROUND_V1 + data[at + 1] if left > 1 else left + 1
    return 0


def frame_system(frame: bytes) -> int:
    """Return the system id of a whole frame's sender."""
    return frame[5] if frame[0] == V2 else frame[3]


def message_id(frame: bytes) -> int:
    """Return the message id of a whole frame."""
    return frame[7] | frame[8] << 8 | frame[9] << 16 if frame[0] == V2 else frame[5]


def _checksum_is_right(frame: bytes, extra: bytes) -> bool:
    end = (HEADER_V2 if frame[0] == V2 else HEADER_V1) + frame[1]
    return mcrf4xx(frame[1:end] + extra, _CRC_START) == frame[end] | frame[end + 1] << 8


class LinkQuality:
    """Lost frames of one component of one vehicle, counted by the gaps in the sequence numbers of its frames."""

    def __init__(self) -> None:
        self.received = 0
        self.lost = 0
        self._last = -1

    @property
    def loss(self) -> float | None:
        """The share of lost frames; None before the first frame."""
        return self.lost / (self.received + self.lost) if self.received else None

    def receive(self, frame: bytes) -> None:
        """Count one whole frame."""
        if not frame:
            return
        number = frame[4] if frame[0] == V2 else frame[2]
        if number == self._last:
            return  # a copy: a radio repeats frames
        gap = (number - self._last - 1) & 0xFF if self._last >= 0 else 0
        self.received += 1
        if gap >= _FAR_BACK:
            self.lost = max(self.lost - 1, 0)  # it had been counted as lost
            return
        self.lost += gap
        self._last = number
