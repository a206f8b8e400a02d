"""A file that only grows, by whole pieces: frames of a telemetry log, lines of an event log."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from gcs.flight.recording.writing.record_gaps import RecordGaps


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
