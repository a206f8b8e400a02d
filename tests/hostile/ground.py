"""The ground station under attack: `gcs` as a process of its own, its lines as they come, signals, stops."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from tests.kept import GCS_ALONE, SHARING

PATIENCE_S = 120.0  # of a busy machine


@dataclass(frozen=True)
class Ended:
    """How the process ended. `output` has the lines of stdout and stderr in the order they came."""

    code: int
    output: str


class Ground:
    """One `gcs` command. Leaving the block kills what still runs."""

    def __init__(self, *arguments: object, **options: Any) -> None:
        """`options` go to the process: `env` adds to this one's environment, `by` is a command that starts it."""
        by = options.pop("by", ())
        env = {**os.environ, **SHARING, "PYTHONUNBUFFERED": "1", **options.pop("env", {})}
        options = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT} | options
        self.process = subprocess.Popen([*by, *GCS_ALONE, *map(str, arguments)], env=env, **options)
        self.lines: list[str] = []
        self._coming: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._over = False  # all its output was read
        if self.process.stdout is None:
            self._over = True
        else:
            threading.Thread(target=self._read, args=(self.process.stdout,), daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.kill()
        self.process.wait()

    @property
    def running(self) -> bool:
        """Whether the process has not ended yet."""
        return self.process.poll() is None

    @property
    def output(self) -> str:
        """What it has printed until now, as far as it was read."""
        return "\n".join(self.lines)

    def until(self, text: str, patience_s: float = PATIENCE_S) -> str:
        """Return the next line that contains `text`. Fails if the process ends before."""
        end_s = time.monotonic() + patience_s
        while (line := self._next(end_s)) is not None:
            if text in line:
                return line
        raise AssertionError(f"it ended before it said {text!r}:\n{self.output}")

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def freeze(self, seconds: float) -> None:
        """Stop the process for so long, as a suspended machine does."""
        self.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self.process.send_signal(signal.SIGCONT)

    def ended(self, patience_s: float = PATIENCE_S) -> Ended:
        """Return its exit code and all that it printed, once it has ended."""
        end_s = time.monotonic() + patience_s
        while self._next(end_s) is not None:
            pass
        return Ended(self.process.wait(max(end_s - time.monotonic(), 1.0)), self.output)

    def _next(self, end_s: float) -> str | None:
        if self._over:
            return None
        try:
            line = self._coming.get(timeout=max(end_s - time.monotonic(), 0.0))
        except queue.Empty:
            raise AssertionError(f"it said nothing more in time:\n{self.output}") from None
        if line is None:
            self._over = True
        else:
            self.lines.append(line)
        return line

    def _read(self, stdout: IO[bytes]) -> None:
        for line in stdout:
            self._coming.put(line.decode(errors="replace").rstrip("\n"))
        self._coming.put(None)


def fly_arguments(plan: Path, port: int, flights: Path, *more: object) -> list[object]:
    """The command line of a flight of vehicles that call `port` of this machine, without confirmation."""
    return ["fly", plan, "--link", f"udpin:127.0.0.1:{port}", "--yes-arm", "--to", flights, *more]
