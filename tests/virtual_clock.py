"""An event loop on a clock of its own: nothing comes in from outside, and a wait is over at once."""

from __future__ import annotations

import asyncio
import selectors
from typing import Any


class _NoWait(selectors.DefaultSelector):
    """A wait is over at once, and the clock has moved by as much; by `turn_s` if nothing waits."""

    def __init__(self, turn_s: float) -> None:
        super().__init__()
        self.now_s = 1000.0
        self._turn_s = turn_s

    def select(self, timeout: float | None = None) -> list[Any]:
        assert timeout is not None, "all tasks wait for each other"
        self.now_s += max(timeout, self._turn_s)
        return super().select(0.0)


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs any time in no time. With `turn_s` a busy loop takes time too."""

    def __init__(self, turn_s: float = 0.0) -> None:
        self._clock = _NoWait(turn_s)
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now_s
