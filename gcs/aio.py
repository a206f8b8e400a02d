"""The same with all vehicles at once, and waiting that ends.

Knows: tasks. Does not know: vehicles.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from contextlib import asynccontextmanager, suppress
from typing import Any, TypeVar

from gcs.errors import GcsError, PeerTimeout

T = TypeVar("T")
LOOK_S = 0.05
_COARSE_S = 1e-3  # the event loop's timers come up to so much late


async def each(things: Iterable[T], action: Callable[[T], Awaitable[object]]) -> None:
    """Do it with all at once; the first failure ends the others' waiting and is raised."""
    tasks = [asyncio.ensure_future(action(thing)) for thing in things]
    try:
        await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            await ended(task)


async def ended(task: asyncio.Future[Any]) -> None:
    """Cancel a task and wait until it has ended; what it failed with is somebody else's to say."""
    while not task.done():  # a library on the way may swallow being cancelled
        task.cancel()
        await asyncio.wait({task}, timeout=1.0)
    with suppress(asyncio.CancelledError, GcsError):
        task.result()


async def insisted(work: Coroutine[Any, Any, None]) -> None:
    """Have it done although somebody cancels us, again and again; it has to end by itself."""
    task = asyncio.ensure_future(work)
    while not task.done():
        with suppress(asyncio.CancelledError):
            await asyncio.shield(task)
    with suppress(asyncio.CancelledError):
        task.result()


@asynccontextmanager
async def alongside(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Endless work that goes on as long as the block; if it fails, the block is ended with its failure."""
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
    """Look again and again. Raises PeerTimeout: "`what` was not reached within ..."."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + timeout_s
    while not condition():
        if loop.time() > end_s:
            raise PeerTimeout(f"{what} was not reached within {timeout_s:g} s.")
        await asyncio.sleep(LOOK_S)


async def sleep_sharply(seconds: float) -> None:
    """Sleep to a fraction of a millisecond; the last one is spent looking at the links again and again."""
    loop = asyncio.get_running_loop()
    end_s = loop.time() + seconds
    await asyncio.sleep(max(seconds - _COARSE_S, 0.0))  # others get a turn in any case
    while loop.time() < end_s:
        await asyncio.sleep(0)
