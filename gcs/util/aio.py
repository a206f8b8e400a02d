"""Helpers for asyncio: one action for several vehicles at once, background work, bounded waits."""

import asyncio
import signal
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from contextlib import asynccontextmanager, suppress
from types import FrameType
from typing import Any, TypeVar

from gcs.errors import PeerTimeout, ProtocolMisuse
from gcs.util.steady_loop import SteadyLoop

T = TypeVar("T")
Work = Coroutine[Any, Any, T]  # what a call of an `async def` is

LOOK_S = 0.05
_STOPS = tuple(n for name in ("SIGINT", "SIGTERM", "SIGHUP") if (n := getattr(signal, name, None)) is not None)
_COARSE_S = 1e-3  # the event loop's timers are late by up to this


async def each(things: Iterable[T], action: Callable[[T], Awaitable[object]]) -> None:
    """Run `action` for all things at once. The first failure cancels the other actions and is raised."""
    tasks = [asyncio.ensure_future(action(thing)) for thing in things]
    try:
        await asyncio.gather(*tasks)
    finally:
        await ended(*tasks)


async def ended(*tasks: asyncio.Future[Any]) -> None:
    """Cancel tasks and wait until they have ended. Their own failures are dropped: the caller already has one.

    All are cancelled before the first wait: none goes on if the wait itself fails.
    """
    while alive := [task for task in tasks if not task.done()]:  # a library in between may swallow the cancellation
        for task in alive:
            task.cancel()
        await asyncio.wait(alive, timeout=1.0)
    for task in tasks:
        if not task.cancelled():
            task.exception()


async def insisted(work: Work[None]) -> None:
    """Run `work` to its end even if the caller is cancelled or fails, once or often. It must end by itself."""
    task = asyncio.ensure_future(work)
    while not task.done():
        with suppress(BaseException):
            await asyncio.wait({task})
    with suppress(asyncio.CancelledError):
        task.result()


class Stopped(KeyboardInterrupt):
    """A signal stopped this program: SIGINT (Ctrl-C), SIGTERM, or SIGHUP (its terminal was closed)."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)


class StopSignals:
    """Makes SIGINT, SIGTERM and SIGHUP raise `Stopped`, once it listens. For programs, not for libraries.

    It remembers the last one: some libraries make a plain KeyboardInterrupt of `Stopped`.
    """

    def __init__(self) -> None:
        self._latest: int = signal.SIGINT

    @property
    def exit_code(self) -> int:
        """The exit code of a program that was stopped: 128 and the number of the signal, as shells count."""
        return 128 + self._latest

    def listen(self) -> None:
        """Handle the signals from now on.

        A shell's background job has SIGINT ignored, so its handler is set in any case. Only SIGHUP stays ignored where
        it is: `nohup` means that the program outlives its terminal.
        """
        for number in _STOPS:
            if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self)

    def ignore(self) -> None:
        """Ignore further signals: the program is ending."""
        for number in _STOPS:
            if signal.getsignal(number) is self:
                signal.signal(number, signal.SIG_IGN)

    def __call__(self, number: int, frame: FrameType | None = None) -> None:
        """Handle one signal: raise `Stopped`."""
        self._latest = number
        if number != signal.SIGINT:  # closing a terminal sends two: the second must not interrupt the clean-up
            signal.signal(number, signal.SIG_IGN)
        raise Stopped(number)


class Stoppable:
    """Runs work that SIGINT (Ctrl-C), SIGTERM or SIGHUP cancels once. Each further one calls what `again_calls` has.

    The work then ends by itself. `asyncio.run` alone would cancel every task at the second Ctrl-C, those that land
    vehicles too, and would die at SIGTERM and SIGHUP.
    """

    def __init__(self) -> None:
        self._on_again: Callable[[], None] = lambda: None
        self._stopped: int | None = None  # the signal
        self._work: asyncio.Future[Any] | None = None

    def again_calls(self, call: Callable[[], None]) -> None:
        """Have every further signal call this."""
        self._on_again = call

    def run(self, work: Work[T]) -> T:
        """Run `work` in an event loop of its own. Raises `Stopped` if it was stopped.

        A program that handles or ignores one of the signals itself keeps doing so.
        """
        in_main = threading.current_thread() is threading.main_thread()
        before = {n: h for n in _STOPS if in_main and _is_default(n, h := signal.getsignal(n))}
        try:
            with asyncio.Runner(loop_factory=SteadyLoop) as runner:
                return self._to_its_end(runner.get_loop(), self._main(work, tuple(before)))
        except asyncio.CancelledError:
            if self._stopped is None:
                raise
            handler = before.get(self._stopped)
            if isinstance(handler, StopSignals):
                handler(self._stopped)
            raise Stopped(self._stopped) from None
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _to_its_end(self, loop: asyncio.AbstractEventLoop, main: Work[T]) -> T:
        """Run the loop on after a task ended it by KeyboardInterrupt or SystemExit, which stops the work only."""
        task: asyncio.Task[T] = loop.create_task(main)
        while True:
            try:
                return loop.run_until_complete(task)
            except (KeyboardInterrupt, SystemExit):
                if task.done() or self._work is None:
                    raise
                self._stop(self._work, signal.SIGINT)

    async def _main(self, work: Work[T], numbers: Iterable[int]) -> T:
        task = asyncio.ensure_future(work)
        self._work = task
        loop = asyncio.get_running_loop()

        def receive(number: int, frame: FrameType | None) -> None:
            with suppress(RuntimeError):  # the loop is closed: the work has ended
                loop.call_soon_threadsafe(self._stop, task, number)

        for number in numbers:  # not the loop's own handlers, which leave SIGTERM and SIGHUP deadly when it closes
            signal.signal(number, receive)
        return await task

    def _stop(self, task: asyncio.Future[Any], number: int) -> None:
        if self._stopped is not None:
            self._on_again()
        else:
            self._stopped = number
            task.cancel()


def _is_default(number: int, handler: object) -> bool:
    default = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    return handler is default or isinstance(handler, StopSignals)


@asynccontextmanager
async def alongside(work: Work[None]) -> AsyncIterator[None]:
    """Run endless work in the background of the block. If the work ends by itself, the block ends with its failure."""
    block = asyncio.current_task()
    task = asyncio.ensure_future(work)
    stopped = False

    def stop_block(_: asyncio.Future[None]) -> None:
        nonlocal stopped
        if block is not None:
            stopped = block.cancel()

    task.add_done_callback(stop_block)
    try:
        try:
            yield
        finally:
            task.remove_done_callback(stop_block)
            await ended(task)
    except asyncio.CancelledError:
        if block is None or not stopped or block.uncancel():  # it was cancelled by others too
            raise
        failure = None if task.cancelled() else task.exception()
        raise failure or ProtocolMisuse("a part of the work ended by itself.") from None


async def set_within(event: asyncio.Event, seconds: float) -> None:
    """Wait until an event is set; after this time it is set in any case."""
    timer = asyncio.get_running_loop().call_later(seconds, event.set)
    try:
        await event.wait()
    finally:
        timer.cancel()


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
