"""Hostile bytes by the hundred thousand, made with NumPy: noise, broken, cut and oversized frames, and nonsense.

What a right frame says is drawn field by field from values that hurt: NaN, infinities, 0, the extremes, 65,535. Only
what any station may rightly order is left out: clearing a mission, or sending a whole new one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

Bytes = NDArray[np.uint8]
Generator = np.random.Generator

HEADER, CHECKSUM = 10, 2
_KINDS = {"f": "<f4", "d": "<f8", "b": "i1", "B": "u1", "c": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4"}
_KINDS |= {"q": "<i8", "Q": "<u8"}
_FLOATS = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 3.4e38, -3.4e38, 1e-45, 4.0, 400.0, 65535.0])
UNKNOWN_COMMANDS = (9999, 65535, 0, 7, 12345)
# Most of what stations say to vehicles, and some of what they never should.
MESSAGES = (
    *(0, 2, 4, 11, 20, 21, 23, 24, 30, 37, 38, 39, 40, 41, 43, 44, 45, 46, 47, 48, 51, 55, 66, 69, 70, 73, 75, 76),
    *(77, 82, 84, 86, 109, 110, 111, 126, 147, 148, 179, 233, 243, 244, 253, 385, 400, 512),
)
COMMANDS = (
    *(16, 17, 20, 21, 22, 84, 93, 176, 178, 179, 192, 193, 207, 224, 241, 245, 252, 300, 400, 410, 420, 510, 511, 512),
    *(519, 520, 528, 2510, 4501, 31010, 31011, 42428, 50000, 65535),
)
PARAMS = (b"WPNAV_SPEED", b"RTL_ALT", b"GUID_TIMEOUT", b"MPC_XY_CRUISE", b"COM_OF_LOSS_T", b"FENCE_ENABLE", b"NO_SUCH")


def _crc_table() -> NDArray[np.uint16]:
    table = np.arange(256, dtype=np.uint16)
    low = table ^ ((table << 4) & 0xFF)
    return ((low << 8) ^ (low << 3) ^ (low >> 4)).astype(np.uint16)


_TABLE = _crc_table()


def checksums(rows: Bytes, extra: int) -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX of rows (N, L) and one more byte."""
    crc = np.full(len(rows), 0xFFFF, dtype=np.uint16)
    for column in [*rows.T, np.full(len(rows), extra, dtype=np.uint8)]:
        crc = (crc >> 8) ^ _TABLE[(crc ^ column) & 0xFF]
    return crc


@dataclass
class Hostility:
    """Chunks of bytes for vehicles `sysids` whose missions have at least `items` items. `counts` by kind of attack."""

    seed: int
    sysids: tuple[int, ...]
    items: int
    counts: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self._dtypes = {number: _dtype(number) for number in MESSAGES if number in dialect.mavlink_map}

    def chunks(self, frames: int, *, batch: int = 20_000) -> Iterator[bytes]:
        """So many frames, one to eight to a chunk, in no order."""
        made = 0
        while made < frames:
            rows = [row for kind in (self._nonsense, self._broken, self._cut, self._noise) for row in kind(batch // 4)]
            rows = rows[: frames - made]
            made += len(rows)
            order = self._random.permutation(len(rows))
            at = 0
            for size in self._random.integers(1, 9, len(rows)):
                if at >= len(rows):
                    break
                yield b"".join(rows[i] for i in order[at : at + size])
                at += size

    def _nonsense(self, count: int) -> list[bytes]:
        """Right frames, wrong words."""
        self._count("right frames that say nonsense", count)
        return self._frames(count)

    def _broken(self, count: int) -> list[bytes]:
        """Frames with bits turned over."""
        self._count("broken frames", count)
        random, frames = self._random, []
        turns, where, bits = random.integers(1, 9, count), random.random((count, 8)), random.integers(0, 8, (count, 8))
        for frame, n, places, turned in zip(
            self._frames(count), turns.tolist(), where.tolist(), bits.tolist(), strict=True
        ):
            row = bytearray(frame)
            for place, bit in zip(places[:n], turned, strict=False):
                row[int(place * len(row))] ^= 1 << bit
            frames.append(bytes(row))
        return frames

    def _cut(self, count: int) -> list[bytes]:
        """Frames cut short, and frames that claim or bring more than they should."""
        self._count("cut and oversized frames", count)
        frames, junk = [], self._random.bytes(1000)
        for frame, how, much in zip(
            self._frames(count), range(count), self._random.random(count).tolist(), strict=True
        ):
            if how % 3 == 0:
                frames.append(frame[: 1 + int(much * (len(frame) - 1))])
            elif how % 3 == 1:
                frames.append(frame[:1] + b"\xff" + frame[2:] + junk[int(much * 600) :][: int(much * 400)])
            else:
                frames.append(frame + junk[int(much * 900) :][: 1 + int(much * 60)])
        return frames

    def _noise(self, count: int) -> list[bytes]:
        """Bytes from nowhere, with the marks of frames among them."""
        self._count("noise", count)
        sizes = self._random.integers(1, 120, count)
        noise = self._random.integers(0, 256, int(sizes.sum()), dtype=np.uint8)
        noise[self._random.random(len(noise)) < 0.03] = 0xFD
        ends = np.cumsum(sizes).tolist()
        data = noise.tobytes()
        return [data[end - size : end] for end, size in zip(ends, sizes.tolist(), strict=True)]

    def _count(self, kind: str, count: int) -> None:
        self.counts[kind] = self.counts.get(kind, 0) + count

    def _frames(self, count: int) -> list[bytes]:
        """Right frames of all messages."""
        random, frames = self._random, []
        numbers = random.choice(list(self._dtypes), count)
        for number in np.unique(numbers):
            rows = self._rows(int(number), int((numbers == number).sum()))
            frames += [row.tobytes() for row in rows]
        return frames

    def _rows(self, number: int, count: int) -> Bytes:
        """Frames (N, length) of one message."""
        random, dtype = self._random, self._dtypes[number]
        fields = np.zeros(count, dtype=dtype)
        for name in dtype.names or ():
            fields[name] = self._values(dtype[name], (count, *dtype[name].shape))
        self._aim(number, fields)
        payload = fields.view(np.uint8).reshape(count, dtype.itemsize)
        rows = np.zeros((count, HEADER + dtype.itemsize + CHECKSUM), dtype=np.uint8)
        rows[:, 0], rows[:, 1] = 0xFD, dtype.itemsize
        rows[:, 4] = random.integers(0, 256, count)
        rows[:, 5] = random.choice([255, 255, 255, 1, 0, 77], count)
        rows[:, 6] = random.choice([190, 190, 0, 1], count)
        rows[:, 7], rows[:, 8] = number & 0xFF, number >> 8
        rows[:, HEADER:-CHECKSUM] = payload
        crc = checksums(rows[:, 1:-CHECKSUM], dialect.mavlink_map[number].crc_extra)
        rows[:, -2], rows[:, -1] = crc & 0xFF, crc >> 8
        return rows

    def _values(self, dtype: np.dtype, shape: tuple[int, ...]) -> NDArray:
        random, base = self._random, dtype.base
        if base.kind == "f":
            with np.errstate(over="ignore"):
                wild = random.standard_normal(shape) * 10.0 ** random.integers(-3, 9, shape)
                return np.where(random.random(shape) < 0.6, random.choice(_FLOATS, shape), wild).astype(base)
        info = np.iinfo(base)
        wild = np.frombuffer(random.bytes(math.prod(shape) * base.itemsize), dtype=base).reshape(shape)
        few = np.array([0, 1, 2, 255 & info.max, info.max, info.min, 65_535 & info.max], dtype=base)
        return np.where(random.random(shape) < 0.6, random.choice(few, shape), wild)

    def _aim(self, number: int, fields: NDArray) -> None:
        """At the vehicles; and away from what would rightly change a mission."""
        random, count, names = self._random, len(fields), fields.dtype.names or ()
        if "target_system" in names:
            fields["target_system"] = random.choice([0, *self.sysids, *self.sysids], count)
        if "command" in names and number in (75, 76):
            fields["command"] = random.choice(COMMANDS, count)
        if number in (39, 73):  # no station means these
            fields["command"] = random.choice(UNKNOWN_COMMANDS, count)
        if number == 44:  # fewer would cut an ArduPilot's mission short, as it should
            fields["count"] = np.where(random.random(count) < 0.5, 65_535, random.integers(self.items, 700, count))
        if number == 45:
            fields["mission_type"] = random.integers(3, 255, count)
        if number in (20, 23):
            fields["param_id"] = np.frombuffer(
                b"".join(random.choice(PARAMS).ljust(16, b"\0") for _ in range(count)), dtype="u1"
            ).reshape(count, 16)


def _dtype(number: int) -> np.dtype:
    """A message's fields as they lie in its payload."""
    cls = dialect.mavlink_map[number]
    kinds = cls.native_format.decode().lstrip("<")
    columns = zip(cls.ordered_fieldnames, kinds, cls.array_lengths, strict=True)
    return np.dtype([(name, _KINDS[kind], (length,) if length else ()) for name, kind, length in columns])
