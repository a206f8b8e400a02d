"""Raises an exception where the coroutines of an event loop wait: at the n-th time that one is resumed at a place."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Coroutine, Generator
from contextvars import Context
from typing import Any

Place = tuple[str, int]  # file and line of an `await`, as far in as there is code of this project


class Raising:
    """A task factory: every task created by it counts where it waits, and one of them fails at a line or in a file.

    `places` counts the resumptions at each place. Without a `place` nothing fails. `more` are failures at further
    files, each once, after the first one.
    """

    def __init__(self, place: Place | str | None = None, nth: int = 1, failure: BaseException | None = None) -> None:
        self.places: Counter[Place] = Counter()
        self.raised = False
        self.more: dict[str, BaseException] = {}  # by file
        self._place, self._nth, self._failure = place, nth, failure

    def __call__(
        self, loop: asyncio.AbstractEventLoop, coro: Coroutine[Any, Any, Any], *, context: Context | None = None
    ) -> asyncio.Task[Any]:
        """Return the task of a coroutine, as event loops ask for it."""
        return asyncio.Task(Watched(coro, self), loop=loop, context=context)

    def _count(self) -> int:
        """How often a coroutine went on at the place of the failure, or anywhere in its file."""
        return sum(n for place, n in self.places.items() if self._place in (place, place[0]))

    def resumes(self, coro: Coroutine[Any, Any, Any]) -> BaseException | None:
        """Count the place where a coroutine goes on; return the failure if this is the place and time for it."""
        place = where(coro)
        if place is None:
            return None
        self.places[place] += 1
        if self.raised:
            return self.more.pop(place[0], None)
        if self._place not in (place, place[0]) or self._count() != self._nth:
            return None
        self.raised = True
        return self._failure


def where(coro: Any) -> Place | None:
    """Return the innermost line of this project at which a coroutine waits; None before it begins."""
    found = None
    while coro is not None:
        frame = getattr(coro, "cr_frame", None) or getattr(coro, "ag_frame", None) or getattr(coro, "gi_frame", None)
        if frame is not None and "/gcs/" in frame.f_code.co_filename and getattr(coro, "cr_suspended", True):
            found = frame.f_code.co_filename.rpartition("/gcs/")[2], frame.f_lineno
        coro = getattr(coro, "cr_await", None) or getattr(coro, "ag_await", None) or getattr(coro, "gi_yieldfrom", None)
    return found


class Watched(Coroutine[Any, Any, Any]):
    """A coroutine that asks before it goes on."""

    def __init__(self, coro: Coroutine[Any, Any, Any], watch: Raising) -> None:
        self._coro, self._watch = coro, watch

    def send(self, value: Any) -> Any:
        failure = self._watch.resumes(self._coro)
        return self._coro.send(value) if failure is None else self._coro.throw(failure)

    def throw(self, *error: Any) -> Any:
        return self._coro.throw(*error)

    def close(self) -> None:
        self._coro.close()

    def __await__(self) -> Generator[Any, None, Any]:
        raise AssertionError("only tasks resume it")
