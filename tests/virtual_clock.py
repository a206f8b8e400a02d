"""An event loop on a clock of its own: nothing comes in from outside, and a wait is over at once."""

from __future__ import annotations

import asyncio
import selectors
from typing import Any


class _NoWait(selectors.DefaultSelector):
    """A wait is over at once, and the clock has moved by as much."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 1000.0

    def select(self, timeout: float | None = None) -> list[Any]:
        assert timeout is not None, "all tasks wait for each other"
        self.now_s += timeout
        return super().select(0.0)


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs any time in no time."""

    def __init__(self) -> None:
        self._clock = _NoWait()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now_s
