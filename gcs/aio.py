"""Helpers for asyncio: one action for several vehicles at once, background work, and waits that end."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from contextlib import asynccontextmanager, suppress
from typing import Any, TypeVar

from gcs.errors import GcsError, PeerTimeout

T = TypeVar("T")
LOOK_S = 0.05
_COARSE_S = 1e-3  # the event loop's timers are late by up to this


async def each(things: Iterable[T], action: Callable[[T], Awaitable[object]]) -> None:
    """Run `action` for all things at once. The first failure cancels the other actions and is raised."""
    tasks = [asyncio.ensure_future(action(thing)) for thing in things]
    try:
        await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            await ended(task)


async def ended(task: asyncio.Future[Any]) -> None:
    """Cancel a task and wait until it has ended. Its own GcsError is dropped: the caller already has a failure."""
    while not task.done():  # a library in between may swallow the cancellation
        task.cancel()
        await asyncio.wait({task}, timeout=1.0)
    with suppress(asyncio.CancelledError, GcsError):
        task.result()


async def insisted(work: Coroutine[Any, Any, None]) -> None:
    """Run `work` to its end even if the caller is cancelled, once or often. It must end by itself."""
    task = asyncio.ensure_future(work)
    while not task.done():
        with suppress(asyncio.CancelledError):
            await asyncio.shield(task)
    with suppress(asyncio.CancelledError):
        task.result()


class Stoppable:
    """Runs work that Ctrl-C cancels once. From then on Ctrl-C calls `on_again`, and the work ends by itself.

    `asyncio.run` alone would cancel every task at the second Ctrl-C, those that land vehicles too.
    """

    def __init__(self) -> None:
        self.on_again: Callable[[], None] = lambda: None
        self._stopped = self._listens = False

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run `work` in an event loop of its own. Raises KeyboardInterrupt if it was stopped.

        A program that handles SIGINT itself keeps doing so.
        """
        in_main = threading.current_thread() is threading.main_thread()
        self._listens = in_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        try:
            return asyncio.run(self._main(work))
        except asyncio.CancelledError:
            if self._stopped:
                raise KeyboardInterrupt from None
            raise

    async def _main(self, work: Coroutine[Any, Any, T]) -> T:
        task = asyncio.ensure_future(work)
        loop = asyncio.get_running_loop()
        with suppress(NotImplementedError):  # Windows
            if self._listens:
                loop.add_signal_handler(signal.SIGINT, self._stop, task)
        return await task

    def _stop(self, task: asyncio.Future[Any]) -> None:
        if self._stopped:
            self.on_again()
        else:
            self._stopped = True
            task.cancel()


@asynccontextmanager
async def alongside(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Run endless work in the background of the block. If the work fails, the block ends with that failure."""
    block = asyncio.current_task()
    task = asyncio.ensure_future(work)

    def stop_block(done: asyncio.Future[None]) -> None:
        if block is not None and not done.cancelled() and done.exception() is not None:
            block.cancel()

    task.add_done_callback(stop_block)
    try:
        yield
    except asyncio.CancelledError:
        if task.done() and not task.cancelled() and (failure := task.exception()) is not None:
            if block is not None:
                block.uncancel()
            raise failure from None
        raise
    finally:
        task.remove_done_callback(stop_block)
        await ended(task)


async def until(condition: Callable[[], bool], timeout_s: float, what: str) -> None:
    """Return once `condition` is true; it is checked every 0.05 s. Raises PeerTimeout: "`what` was not reached ..."."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + timeout_s
    while not condition():
        if loop.time() > end_s:
            raise PeerTimeout(f"{what} was not reached within {timeout_s:g} s.")
        await asyncio.sleep(LOOK_S)


async def sleep_sharply(seconds: float) -> None:
    """Sleep `seconds`, accurate to a fraction of a millisecond. The last millisecond is a busy loop that yields."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + seconds
    await asyncio.sleep(max(seconds - _COARSE_S, 0.0))  # other tasks get a turn in any case
    while loop.time() < end_s:
        await asyncio.sleep(0)
