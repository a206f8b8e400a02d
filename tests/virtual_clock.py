"""Time that passes only when nobody has anything left to do: an event loop on it waits for nothing.

Emulated vehicles may move with it (`VirtualClock.moving`): then a flight over real sockets runs in one thread, the same
on any machine, however busy it is.
"""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any, Protocol, Self

_PATIENCE_S = 60.0  # wall time in which a thread has come to its end
_WORKING_S = 0.01  # wall time between two looks at a thread that works for the loop


class Moving(Protocol):
    """Something that moves with the clock."""

    @property
    def due_s(self) -> float:
        """When it moves next."""

    def hear(self) -> None:
        """Take notice of what was sent to it."""

    def move(self) -> None:
        """Move once."""


class VirtualClock:
    """A time in seconds, and what moves with it."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.moving: list[Moving] = []

    def __call__(self) -> float:
        return self.now_s

    def move(self) -> None:
        """Move what is due."""
        for one in self.moving:
            if one.due_s <= self.now_s:
                one.move()

    def to_next(self, until_s: float) -> bool:
        """Go on to whatever moves next, and move it; return False at `until_s`, when nothing moves before."""
        due_s = min((one.due_s for one in self.moving), default=until_s)
        self.now_s = max(self.now_s, min(due_s, until_s))
        self.move()
        return due_s < until_s

    def wait_until(self, condition: Callable[[], bool], patience_s: float = 120.0) -> None:
        """Let time pass until `condition` is true; fails after `patience_s`."""
        end_s = self.now_s + patience_s
        while not condition():
            assert self.to_next(end_s), "it did not happen"


class Every:
    """Does something again and again while the block lasts."""

    def __init__(self, clock: VirtualClock, period_s: float, act: Callable[[], object]) -> None:
        self.due_s = clock.now_s
        self._clock, self._period_s, self._act = clock, period_s, act

    def __enter__(self) -> Self:
        self._clock.moving.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        self._clock.moving.remove(self)

    def hear(self) -> None:
        """It listens to nobody."""

    def move(self) -> None:
        self._act()
        self.due_s += self._period_s


class _NoWait(selectors.DefaultSelector):
    """Time passes when there is nothing to read; by `turn_s` in any case."""

    def __init__(self, clock: VirtualClock, turn_s: float) -> None:
        super().__init__()
        self.clock = clock
        self.working = 0  # threads that work for the loop
        self._turn_s = turn_s

    def select(self, timeout: float | None = None) -> list[Any]:
        clock = self.clock
        if self.working:
            return super().select(_WORKING_S if timeout is None or timeout > 0.0 else 0.0)
        if timeout is None and not clock.moving:
            found = super().select(_PATIENCE_S)
            assert found, "all tasks wait for each other"
            return found
        for one in clock.moving:
            one.hear()
        until_s = clock.now_s + (math.inf if timeout is None else max(timeout, self._turn_s))
        if found := super().select(0.0):
            clock.now_s += self._turn_s
            clock.move()
            return found
        while clock.to_next(until_s) and not (found := super().select(0.0)):
            pass
        return found


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs any time in no time. With `turn_s` a busy loop takes time too."""

    def __init__(self, turn_s: float = 0.0, clock: VirtualClock | None = None) -> None:
        self._no_wait = _NoWait(clock or VirtualClock(), turn_s)
        super().__init__(self._no_wait)

    def time(self) -> float:
        return self._no_wait.clock.now_s

    @contextmanager
    def standing(self) -> Iterator[None]:
        """Time stands in this block, which waits for another process."""
        self._no_wait.working += 1
        try:
            yield
        finally:
            self._no_wait.working -= 1

    def run_in_executor(self, executor: Executor | None, func: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:
        """As of any loop; time stands still meanwhile."""
        self._no_wait.working += 1
        future: asyncio.Future[Any] = super().run_in_executor(executor, func, *args)
        future.add_done_callback(self._worked)
        return future

    def _worked(self, _: asyncio.Future[Any]) -> None:
        self._no_wait.working -= 1
