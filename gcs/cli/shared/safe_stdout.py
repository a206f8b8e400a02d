"""Writes to a standard output that may fail: a closed terminal or pipe, a full disk, a missing character.

What cannot be written is dropped, and the command goes on: six vehicles may be in the air.
"""

import io
import os
import queue
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

QUEUED_MAX = 1_000_000  # characters that wait for a terminal that stands still


class SafeStream(io.TextIOBase):
    """A text stream that never raises. `lost` is the first failure of the stream behind it, if there was one."""

    def __init__(self, stream: IO[str] | None) -> None:
        """`stream` None: closed before the program began."""
        super().__init__()
        self.stream = stream
        self.lost: Exception | None = None
        self._lines: queue.SimpleQueue[str | None] | None = None
        self._queued = 0

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the stream behind it."""
        return getattr(self.stream, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        """Whether it is a terminal that is still there."""
        with suppress(OSError, ValueError):
            return self.stream is not None and self.stream.isatty()
        return False

    def fileno(self) -> int:
        """Return the descriptor of the stream behind it. Raises OSError without one."""
        if self.stream is None:
            raise io.UnsupportedOperation("closed before the program began")
        return self.stream.fileno()

    def writable(self) -> bool:
        """Always: a text that cannot be written is dropped."""
        return True

    def write(self, text: str) -> int:
        """Take a text; it may be lost."""
        if self._lines is None:
            self._pass_on(text)
        elif self._queued + len(text) > QUEUED_MAX:
            self._lose(BlockingIOError("the terminal stands still"))
        else:
            self._queued += len(text)
            self._lines.put(text)
        return len(text)

    def flush(self) -> None:
        """Pass on what is buffered; nothing is said if that fails."""
        if self._lines is None:
            self._flush()

    @contextmanager
    def without_waiting(self) -> Iterator[None]:
        """Within the block, a terminal that stands still (Ctrl-S, a stalled connection) keeps no caller waiting.

        Another thread writes. What is left at the end of the block is waited for.
        """
        if self._lines is not None:
            yield
            return
        self._flush()
        lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        writer = threading.Thread(target=self._drain, args=(lines,), daemon=True)
        writer.start()
        self._lines = lines
        try:
            yield
        finally:
            lines.put(None)
            try:
                writer.join()
            finally:
                if writer.is_alive():  # stopped by a signal; it keeps the stream, two writers would mix their lines
                    self.stream = None
                self._lines = None

    def end(self) -> None:
        """Write what is left. Afterwards nothing is in a buffer whose loss Python would complain about at its exit."""
        self._flush()
        if self.lost is not None:
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())

    def _drain(self, lines: queue.SimpleQueue[str | None]) -> None:
        """Write around the stream's buffer: its lock, held by a writer that waits, would abort the program's exit."""
        try:
            number = self.fileno()
        except (OSError, ValueError):
            number = -1
        encoding = self.encoding
        while (text := lines.get()) is not None:
            data = memoryview(text.encode(encoding, "backslashreplace"))
            try:
                while data and number >= 0:
                    data = data[os.write(number, data) :]
            except OSError as problem:
                self._lose(problem)
            self._queued -= len(text)

    def _pass_on(self, text: str) -> None:
        if self.stream is None:
            return
        try:
            try:
                self.stream.write(text)
            except UnicodeEncodeError:
                self.stream.write(text.encode(self.encoding, "backslashreplace").decode(self.encoding))
        except (OSError, ValueError) as problem:
            self._lose(problem)

    def _flush(self) -> None:
        try:
            if self.stream is not None:
                self.stream.flush()
        except (OSError, ValueError) as problem:
            self._lose(problem)

    def _lose(self, problem: Exception) -> None:
        self.lost = self.lost or problem


def install() -> tuple[SafeStream, SafeStream]:
    """Replace stdout and stderr by safe streams, for the whole process; return them.

    Descriptors 0 to 2 that were closed get /dev/null: otherwise the first file or socket that is opened would have such
    a number, and libraries would print into it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    if hasattr(signal, "SIGTTOU"):  # `stty tostop` would stop a job in the background at its next line
        signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # a log, or `tee`, shows a flight as it goes
    out, err = SafeStream(sys.stdout), SafeStream(sys.stderr)
    sys.stdout, sys.stderr = out, err
    return out, err
