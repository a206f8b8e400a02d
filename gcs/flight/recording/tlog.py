"""Reads telemetry logs (`.tlog`) of any ground station: frames in both directions, each after its time stamp.

Stamps are the writer's clock, big-endian microseconds since 1970; frames from before that clock was set have 0. In a
log without stamps (`.tlog.raw`) the vehicles' own clocks count: time_boot_ms. After a damaged section, reading
continues at the next frame.
"""

import itertools
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from gcs.errors import FileFormatError
from gcs.link.wire.codec import Codec
from gcs.link.wire.frame_scanner import frame_length
from gcs.link.wire.message import GROUND, Message
from gcs.types import Array
from gcs.util.bounded_file import MIB, TELEMETRY_LOG, open_regular, refuse_size

_STAMP = 8
_SHORTEST = 8  # bytes of a frame without payload
_V1, _MARKERS = 0xFE, (0xFD, 0xFE)
_MARKER = re.compile(b"[\xfd\xfe]")
_LEAST_SHARE = 0.1  # of a file that frames must fill: less is chance
_PAUSE_S = 600.0  # a longer silence is another flight, or a clock that was set
_TRIED_MAX = 500_000  # of false frames: each takes ten microseconds
FRAMES_MAX = 2_000_000  # of a replay: each takes about a kilobyte of memory
_WINDOW, _MARGIN = 4 * MIB, 64 * 1024  # of a file at once; no frame is longer than the margin
_BIG_ENDIAN = struct.Struct(">Q")
_TOLD_BY = 64  # pairs of frames that tell whether a log has stamps
_REBOOTED_MS = 1000  # a vehicle's clock goes back by more
_RAW_BEGINS_MS = 1000  # 0 would be a stamp that is not known


@dataclass(frozen=True, slots=True)
class LoggedFrame:
    """One frame. `message` is None for an unknown message id or a wrong checksum."""

    at: int  # offset of its stamp in the file
    stamp_us: int
    data: bytes
    message: Message | None
    stamped: bool = True  # else its stamp is from the vehicle's clock

    @property
    def sysid(self) -> int:
        """System id in its header."""
        return self.data[3] if self.data[0] == _V1 else self.data[5]


@dataclass(frozen=True, slots=True)
class Gap:
    """Bytes that are no frames; `cut`: the file ends within a frame, as when its writer was killed."""

    at: int
    size: int
    cut: bool


@dataclass(frozen=True)
class Tlog:
    """A whole log. `unix_s` (N,) is the time of each frame, in order; impossible stamps are corrected."""

    path: Path
    frames: tuple[LoggedFrame, ...]
    unix_s: Array
    notes: tuple[str, ...]  # what was left out, in sentences


def scan(path: Path) -> Iterator[LoggedFrame | Gap]:
    """Yield the frames and gaps of a file, in order. Raises FileFormatError when it cannot be read."""
    with os.fdopen(open_regular(path, hint="name a flight's folder or a .tlog"), "rb") as file:
        refuse_size(path, os.fstat(file.fileno()).st_size, TELEMETRY_LOG)
        yield from _scan(file, path)


class _BootTimes:
    """Common times from the clocks of vehicles since they were started, in the order of a log."""

    def __init__(self) -> None:
        self._now_ms = _RAW_BEGINS_MS
        self._clocks: dict[tuple[int, int], tuple[int, int]] = {}  # of each component: last reading, offset

    def stamp_us(self, message: Message | None) -> int:
        """The time of the next message."""
        boot_ms = None if message is None else message.fields.get("time_boot_ms")
        if message is not None and isinstance(boot_ms, int):
            last_ms, offset_ms = self._clocks.get((message.sysid, message.compid), (boot_ms, self._now_ms - boot_ms))
            if boot_ms < last_ms - _REBOOTED_MS:
                offset_ms = self._now_ms - boot_ms
            self._clocks[message.sysid, message.compid] = boot_ms, offset_ms
            self._now_ms = max(self._now_ms, boot_ms + offset_ms)
        return 1000 * self._now_ms


def _scan(file: IO[bytes], path: Path) -> Iterator[LoggedFrame | Gap]:
    """The frames and gaps of a file of any length: one window of it is in memory."""
    codec = Codec(*GROUND)
    data = file.read(_WINDOW)
    stamp, times = _stamp_size(data, codec), _BootTimes()
    base, at = 0, 0  # the window's offset in the file, the offset in the window
    gap: int | None = None  # where the bytes begin that are no frames
    tried, ended = 0, len(data) < _WINDOW
    while True:
        if not ended and len(data) - at < _MARGIN:
            more = file.read(_WINDOW)
            ended = len(more) < _WINDOW
            kept = at if gap is None or base + at - gap > _MARGIN else gap - base
            data, base, at = data[kept:] + more, base + kept, at - kept
        if at >= len(data):
            break
        frame = _frame(data, at, codec, base, stamp)
        if frame is not None and (gap is None or frame.message is not None):
            if gap is not None:
                yield Gap(gap, base + at - gap, cut=False)
                gap = None
            yield frame if stamp else replace(frame, stamp_us=times.stamp_us(frame.message))
            at += stamp + len(frame.data)
        elif gap is None:
            gap, at = base + at, at + 1
        else:
            tried += 1
            if tried > _TRIED_MAX:
                raise FileFormatError(
                    f"{path} is damaged: more than {_TRIED_MAX:,} places look like the start of a frame, and are none.",
                    hint="name a flight's folder or a .tlog",
                )
            at = min(_next_candidate(data, at, stamp), len(data) if ended else max(at + 1, len(data) - _STAMP))
    if gap is not None:
        yield Gap(gap, base + len(data) - gap, gap >= base and _is_cut(data, gap - base, stamp))


def _stamp_size(data: bytes, codec: Codec) -> int:
    """The bytes between frames: most frames that follow each other tell it."""
    direct = after_stamp = at = 0
    while direct + after_stamp < _TOLD_BY and (marker := _MARKER.search(data, at)) is not None:
        at = marker.start()
        end = at + (frame_length(data, at) if at < len(data) else 0)
        if end == at or end > len(data) or codec.decode_frame(data[at:end]) is None:
            at += 1
            continue
        direct += data[end : end + 1] in (b"\xfd", b"\xfe")
        after_stamp += data[end + _STAMP : end + _STAMP + 1] in (b"\xfd", b"\xfe")
        at = end
    return 0 if direct > after_stamp else _STAMP


def load_tlog(path: Path) -> Tlog:
    """Return what is readable of a log. Raises FileFormatError for a file without frames."""
    found = list(itertools.islice(scan(path), FRAMES_MAX + 1))
    if len(found) > FRAMES_MAX:
        raise FileFormatError(
            f"{path} has more than {FRAMES_MAX:,} frames, the limit of a replay.",
            hint="`gcs report` reads logs of any number of frames",
        )
    frames = tuple(one for one in found if isinstance(one, LoggedFrame))
    understood = sum(_STAMP * frame.stamped + len(frame.data) for frame in frames if frame.message)
    if understood <= _LEAST_SHARE * sum(one.size if isinstance(one, Gap) else len(one.data) for one in found):
        raise FileFormatError(
            f"{path} has no telemetry: no MAVLink frames after time stamps.",
            hint="name a flight's folder or a .tlog; a log on board (.bin, .ulg) holds none",
        )
    notes = []
    if not frames[0].stamped:
        if not any("time_boot_ms" in frame.message.fields for frame in frames if frame.message):
            text = f"{path} has no time stamps, and no message in it has the vehicle's own time (time_boot_ms)."
            raise FileFormatError(text, hint="name the .tlog that was written beside it")
        notes.append(f"{path.name} has no time stamps: times are those of the vehicles' own clocks (time_boot_ms).")
    damaged = [gap for gap in found if isinstance(gap, Gap) and not gap.cut]
    if damaged:
        size = sum(gap.size for gap in damaged)
        notes.append(f"{path.name} is damaged {damaged[0].at} bytes from its start: {size} bytes were left out.")
    if len(damaged) < sum(isinstance(one, Gap) for one in found):
        notes.append(f"{path.name} ends within a frame: its writer was cut off.")
    unread = sum(frame.message is None for frame in frames)
    if unread:
        notes.append(f"{unread} of {len(frames)} frames have an unknown message id or a wrong checksum.")
    unix_s, left_out_s, back_s = mend_times(np.array([frame.stamp_us for frame in frames], dtype=np.float64) / 1e6)
    if left_out_s:
        notes.append(f"pauses of {_PAUSE_S / 60:g} minutes and more were left out, {left_out_s:.0f} s together.")
    if back_s:
        notes.append(
            f"times step back, {back_s:.0f} s together (a clock that was set, or a reboot): they go on from before."
        )
    return Tlog(path, frames, unix_s, tuple(notes))


def mend_times(stamps_s: Array) -> tuple[Array, float, float]:
    """Return stamps (N,) without zeros, outliers, long pauses and steps back, and how long those two are together.

    The longest part without such a step keeps its times: before the GNSS fix of a vehicle they may have been wrong.
    """
    times = stamps_s.copy()
    known = np.flatnonzero(times > 0.0)
    if not len(known):
        return np.zeros_like(times), 0.0, 0.0
    times[: known[0]] = times[known[0]]
    if len(times) > 2:  # an outlier between its neighbours is replaced
        inner = np.sort(np.stack([times[:-2], times[1:-1], times[2:]]), axis=0)[1]
        alone = np.abs(times[1:-1] - inner) > 1.0
        times[1:-1][alone] = inner[alone]
    steps = np.diff(times, prepend=times[0])
    long, back = steps > _PAUSE_S, steps < -1.0
    left_out = np.cumsum(np.where(long | back, steps, 0.0))
    _, begins, sizes = np.unique(left_out, return_index=True, return_counts=True)
    kept_s = left_out[begins[sizes == sizes.max()].min()]
    return np.maximum.accumulate(times - left_out + kept_s), float(np.sum(steps[long])), float(-np.sum(steps[back]))


def _frame(data: bytes, at: int, codec: Codec, base: int, stamp: int) -> LoggedFrame | None:
    """The frame whose stamp begins at `at`, if it is valid, or if another one follows at its end."""
    begin = at + stamp
    length = frame_length(data, begin) if begin < len(data) else 0
    if not _SHORTEST <= length <= len(data) - begin:
        return None
    end = begin + length
    frame = data[begin:end]
    message = codec.decode_frame(frame)
    if message is None and end < len(data) and (end + stamp >= len(data) or data[end + stamp] not in _MARKERS):
        return None
    stamp_us = _BIG_ENDIAN.unpack_from(data, at)[0] if stamp else 0
    return LoggedFrame(base + at, stamp_us, frame, message, bool(stamp))


def _next_candidate(data: bytes, at: int, stamp: int) -> int:
    marker = _MARKER.search(data, at + 1 + stamp)
    return len(data) if marker is None else marker.start() - stamp


def _is_cut(data: bytes, at: int, stamp: int) -> bool:
    begin = at + stamp
    return begin >= len(data) or (data[begin] in _MARKERS and frame_length(data, begin) > len(data) - begin)
