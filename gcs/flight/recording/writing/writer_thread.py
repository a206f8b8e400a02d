"""A thread that writes files, so that a disk that stands still keeps no setpoint waiting."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

WAITING_MAX_BYTES = 16_000_000
_CLOSE_S = 10.0


class WriterThread:
    """Does one piece of work after another, in order. The work must not raise."""

    def __init__(self) -> None:
        self._work: queue.SimpleQueue[tuple[Callable[[], None], int] | None] = queue.SimpleQueue()
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="flight record", daemon=True)
        self._thread.start()

    def do(self, work: Callable[[], None], size_bytes: int = 0) -> bool:
        """Queue work that writes so many bytes; return False, without it, where too much waits already."""
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
