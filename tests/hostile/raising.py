"""Raises an exception where the coroutines of an event loop wait: at the n-th time that one is resumed at a place."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Coroutine, Generator
from contextvars import Context
from typing import Any

Place = tuple[str, int]  # file and line of an `await`, as far in as there is code of this project besides `gcs.util`


class Raising:
    """A task factory: every task created by it counts where it waits, and one of them fails at a line or in a file.

    `places` counts the resumptions at each place, `files` those below a line of each file. Without a `place` nothing
    fails. `more` are failures at further files, each once, after the first one.
    """

    def __init__(self, place: Place | str | None = None, nth: int = 1, failure: BaseException | None = None) -> None:
        self.places: Counter[Place] = Counter()
        self.files: Counter[str] = Counter()
        self.raised = False
        self.more: dict[str, BaseException] = {}  # by file
        self._place, self._nth, self._failure = place, nth, failure

    def __call__(
        self, loop: asyncio.AbstractEventLoop, coro: Coroutine[Any, Any, Any], *, context: Context | None = None
    ) -> asyncio.Task[Any]:
        """Return the task of a coroutine, as event loops ask for it."""
        return asyncio.Task(Watched(coro, self), loop=loop, context=context)

    def resumes(self, coro: Coroutine[Any, Any, Any]) -> BaseException | None:
        """Count the place where a coroutine goes on; return the failure if this is the place and time for it."""
        waits = where(coro)
        if not waits:
            return None
        files = {file for file, _ in waits}
        self.places[waits[-1]] += 1
        self.files.update(files)
        if self.raised:
            return next((self.more.pop(file) for file in files & self.more.keys()), None)
        counted = self.files if self._place in files else self.places if self._place == waits[-1] else {}
        if counted.get(self._place) != self._nth:
            return None
        self.raised = True
        return self._failure


def where(coro: Any) -> list[Place]:
    """Return the lines of this project at which a coroutine waits, the innermost last; none before it begins."""
    found = []
    while coro is not None:
        frame = getattr(coro, "cr_frame", None) or getattr(coro, "ag_frame", None) or getattr(coro, "gi_frame", None)
        file = "" if frame is None else frame.f_code.co_filename.rpartition("/gcs/")[2]
        if file and not file.startswith(("/", "util/")) and getattr(coro, "cr_suspended", True):
            found.append((file, frame.f_lineno))
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
