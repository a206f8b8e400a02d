"""The record of a flight while it lasts: `telemetry.tlog`, `events.jsonl` and `flight.json` in its folder.

A thread writes them, so that a disk that stands still keeps no setpoint waiting.
"""

import json
import os
import queue
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.progress import Event, Step, notice_event, spared
from gcs.flight.recording.flight_folder import EVENTS, PLAN, TELEMETRY, finite
from gcs.flight.recording.flight_state import NAME as STATE
from gcs.flight.recording.flight_state import FlightState, write_flight_state
from gcs.flight.recording.record_gaps import RecordGaps
from gcs.link.protocols.mission.strategy import SentAs, sent_data
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.session.unknown_systems import LinkNotice
from gcs.util.atomic_write import atomic_write

WAITING_MAX_BYTES = 16_000_000
_CLOSE_S = 10.0
_PIECE_BYTES = 8192
_PIECE_S = 1.0  # no frame waits longer for others
_LATEST_US = 2**63
_SET_BACK_US = 1_000_000  # by more than that GNSS has set the vehicles' clocks
_STANDS_STILL = "the disk stands still"
FRAMES, LINES, STEPS = "frames", "lines", "steps"


class WriterThread:
    """Does one piece of work after another, in order. The work must not raise."""

    def __init__(self) -> None:
        self._work: queue.SimpleQueue[tuple[Callable[[], None], int] | None] = queue.SimpleQueue()
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="flight record", daemon=True)
        self._thread.start()

    def do(self, work: Callable[[], None], size_bytes: int = 0) -> bool:
        """Queue work that writes `size_bytes`; return False, and leave it out, where too much waits already."""
        with self._lock:
            if self._waiting_bytes + size_bytes > WAITING_MAX_BYTES:
                return False
            self._waiting_bytes += size_bytes
        self._work.put((work, size_bytes))
        return True

    def close(self) -> bool:
        """Finish what waits; return whether that was done within 10 s."""
        self._work.put(None)
        self._thread.join(_CLOSE_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (item := self._work.get()) is not None:
            work, size_bytes = item
            work()
            with self._lock:
                self._waiting_bytes -= size_bytes


class AppendedFile:
    """Appends pieces, or notes in `gaps` that they are lost; every piece tries anew.

    After a failure the file is cut back to its last whole piece, so that its readers meet no damage. A file that was
    deleted is begun again.
    """

    def __init__(self, path: Path, gaps: RecordGaps, unit: str, on_deleted: Callable[[], None]) -> None:
        self.path = path
        self._gaps = gaps
        self._unit = unit
        self._on_deleted = on_deleted
        self._handle: int | None = None
        self._count = 0  # pieces in it

    def append(self, data: bytes, count: int = 1) -> None:
        """Append a piece that holds `count` frames or lines."""
        try:
            if self._handle is not None and os.fstat(self._handle).st_nlink == 0:
                self.close()
                self._gaps.lose(self.path.name, "it was deleted", self._count, self._unit)
                self._count = 0
                self._on_deleted()
            if self._handle is None:
                self._handle = self._open()
            self._write(self._handle, data)
        except OSError as problem:
            self._gaps.lose(self.path.name, problem, count, self._unit)
        else:
            self._count += count
            self._gaps.written(self.path.name)

    def _open(self) -> int:
        how = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        try:
            return os.open(self.path, how, 0o666)
        except FileNotFoundError:
            self.path.parent.mkdir(parents=True)
            return os.open(self.path, how, 0o666)

    def close(self) -> None:
        """Close it; a disk's late complaint is dropped."""
        if self._handle is not None:
            with suppress(OSError):
                os.close(self._handle)
        self._handle = None

    @staticmethod
    def _write(handle: int, data: bytes) -> None:
        size = os.fstat(handle).st_size
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(handle, rest) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(handle, size)
            raise


class FlightRecord:
    """Writes the record. No method raises or waits for the disk. `gaps` has what could not be written.

    Time in the telemetry log is the vehicles' own, so that a flight simulated at ten times real time replays as it was
    flown. A folder that is deleted is made again, with plan and state, so that `gcs attach` finds the flight.
    """

    def __init__(
        self, folder: Path, warn: Callable[[str], None], unix_s: Callable[[], float | None], telemetry: str = TELEMETRY
    ) -> None:
        self.gaps = RecordGaps(folder, self._note)
        self._warn = warn
        self._unix_s = unix_s
        self._unsaid: deque[str] = deque()  # by the writing thread
        self._files = {
            name: AppendedFile(folder / name, self.gaps, unit, self._put_back)
            for name, unit in ((telemetry, FRAMES), (EVENTS, LINES))
        }
        self._telemetry = telemetry
        self._folder = folder
        self._plan: bytes | None = None
        with suppress(OSError):
            self._plan = (folder / PLAN).read_bytes()
        self._state: FlightState | None = None
        self._piece = bytearray()
        self._frames = 0
        self._piece_began_s = 0.0
        self._last_us = 0
        self._writer: WriterThread | None = WriterThread()
        self._append(self._telemetry, b"", 0)  # both files exist, as in a flight without a frame or event
        self._append(EVENTS, b"", 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write_frame(self, direction: FrameDirection, frame: bytes) -> None:
        """Log one frame; frames before the vehicles' time is known have the time 0.

        Small steps back are left out; after a wrong time before the GNSS fix the stamps are the right ones.
        """
        unix_s = self._unix_s()
        if unix_s is not None and 0.0 < unix_s * 1e6 < _LATEST_US:
            now_us = round(unix_s * 1e6)
            if not self._last_us - _SET_BACK_US < now_us < self._last_us:
                self._last_us = now_us
        now_s = time.monotonic()
        if not self._piece:
            self._piece_began_s = now_s
        self._piece += struct.pack(">Q", self._last_us) + frame
        self._frames += 1
        if len(self._piece) >= _PIECE_BYTES or now_s - self._piece_began_s >= _PIECE_S:
            self._flush()
        self._say_all()

    def write_event(self, event: Event) -> None:
        """Log one event; times that are not known yet are null."""
        data = asdict(event) | {"unix_s": finite(event.unix_s), "t_s": finite(event.t_s)}
        self._append(EVENTS, (json.dumps(data, default=str) + "\n").encode(), 1)
        self._say_all()

    def write_state(self, state: FlightState) -> None:
        """Replace `flight.json`; it holds the gaps too."""
        self._state = state
        self._do(lambda: self._write_state(state), STATE, 1, STEPS)
        self._say_all()

    def close(self) -> None:
        """Write what is left, and the gaps of the record once more into `flight.json`."""
        writer = self._writer
        if writer is None:
            return
        self._flush()
        if (state := self._state) is not None and self.gaps:
            self._do(lambda: self._write_state(state), STATE, 1, STEPS)
        if writer.close():
            for file in self._files.values():
                file.close()
        else:
            self.gaps.lose(self._telemetry, _STANDS_STILL, 0, FRAMES)
        self._writer = None
        self.gaps.land()
        self._say_all()
        if self.gaps:
            self._warn(self.gaps.words())

    def _flush(self) -> None:
        if self._piece:
            self._append(self._telemetry, bytes(self._piece), self._frames)
            self._piece.clear()
            self._frames = 0

    def _append(self, name: str, data: bytes, count: int) -> None:
        unit = LINES if name == EVENTS else FRAMES
        self._do(lambda: self._files[name].append(data, count), name, count, unit, len(data))

    def _do(self, work: Callable[[], None], file: str, lost: int, unit: str, size_bytes: int = 0) -> None:
        if self._writer is not None and not self._writer.do(work, size_bytes):
            self.gaps.lose(file, _STANDS_STILL, lost, unit)

    def _write_state(self, state: FlightState) -> None:
        try:
            write_flight_state(self._folder, replace(state, incomplete=self.gaps.found))
        except OSError as problem:
            self.gaps.lose(STATE, problem, 1, STEPS)
        else:
            self.gaps.written(STATE)

    def _put_back(self) -> None:
        """The folder was deleted, or files of it: `gcs attach` needs the plan and the state."""
        with suppress(OSError):
            if self._plan is not None and not (self._folder / PLAN).is_file():
                atomic_write(self._folder / PLAN, self._plan)
        if self._state is not None and not (self._folder / STATE).is_file():
            self._write_state(self._state)

    def _note(self, text: str) -> None:
        self._unsaid.append(text)
        if self._writer is None and not self.gaps.in_flight:
            self._say_all()

    def _say_all(self) -> None:
        while self._unsaid:
            self._warn(self._unsaid.popleft())


class FlightJournal:
    """The journal of one flight; close its `record` after it. A failing screen does not reach the flight.

    `state` is written to `flight.json` with the next step.
    """

    def __init__(
        self,
        folder: Path,
        state: FlightState,
        say: Callable[[str], None],
        warn: Callable[[str], None],
        telemetry: str = TELEMETRY,
        note: Callable[[Event], None] = lambda event: None,
    ) -> None:
        """`note` gets every event beside its line."""
        self.state = state
        self._note = spared(note, "the page")
        self.say = spared(say, "the screen")
        self._warn = spared(warn, "the screen")
        self.record = FlightRecord(folder, self._warn, self._now_s, telemetry)
        self.on_frame: Callable[[FrameDirection, bytes], None] = spared(self.record.write_frame, telemetry, self.say)
        self.on_notice: Callable[[LinkNotice], None] = spared(self._notice, "the report of events")
        self._time: FleetTime | None = None

    def keep_time(self, time: FleetTime) -> None:
        """Date frames and notices by this time from now on."""
        self._time = time

    def on_event(self, event: Event) -> None:
        """Record an event, and say it; an alarm is a warning."""
        self.record.write_event(event)
        (self._warn if event.alarm else self.say)(str(event))
        self._note(event)

    def on_step(self, step: Step, t0_unix_s: float | None) -> None:
        """Record that a step began; T0 stays the last known one."""
        self.state = replace(self.state, step=step.value, t0_unix_s=t0_unix_s or self.state.t0_unix_s)
        self.record.write_state(self.state)

    def on_sent(self, sent: Mapping[int, SentAs]) -> None:
        """Note how each mission was sent."""
        self.state = replace(self.state, missions=tuple(sent_data(sent)))

    def _now_s(self) -> float | None:
        return None if self._time is None else self._time.now_s()

    def _notice(self, notice: LinkNotice) -> None:
        self.on_event(notice_event(notice, self.state.systems, self._now_s(), self.state.t0_unix_s))
