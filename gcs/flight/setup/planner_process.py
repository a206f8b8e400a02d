"""A process that keeps one object and calls its methods, so that a planner has its programs built when it is asked.

As in `own_process`, the event loop keeps its deadlines meanwhile, and emulated time stands while an answer is awaited.
"""

import asyncio
import os
import pickle
import queue
import signal
import struct
import sys
import threading
from collections.abc import Callable
from typing import Any

from gcs.flight.setup.own_process import OwnProcessEnded, killed
from gcs.util.steady_loop import time_stands

_LENGTH = struct.Struct("<Q")


class PlannerProcess:
    """A process of its own that holds `make(*args)`. Calls are answered in turn."""

    def __init__(self, make: Callable[..., object], *args: object) -> None:
        """The function must be importable, and it, its arguments and all answers picklable."""
        self.next_makes(make, *args)
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()

    def next_makes(self, make: Callable[..., object], *args: object) -> None:
        """A process that takes the place of one that ended holds `make(*args)`."""
        self._first = (list(sys.path), pickle.dumps((make, args)))

    async def call(self, method: str, *args: object) -> Any:
        """Return what the method of the kept object returns; raise what it raises, or `OwnProcessEnded`.

        A caller that is cancelled ends the process: an answer that nobody awaits would be taken for the next one.
        """
        with time_stands():
            async with self._turn:
                try:
                    answer = await self._answer((method, args))
                except asyncio.CancelledError:
                    await self.close()
                    raise
                except (asyncio.IncompleteReadError, ConnectionError):
                    await self.close()
                    raise OwnProcessEnded("the planner's process ended without an answer") from None
        fine, value = pickle.loads(answer)
        if not fine:
            raise value
        return value

    async def _answer(self, order: tuple[str, tuple[object, ...]]) -> bytes:
        if self._process is None:
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", __name__),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                start_new_session=True,
            )
            self._write(self._process, pickle.dumps(self._first))
        process = self._process
        self._write(process, pickle.dumps(order))
        assert process.stdin is not None
        assert process.stdout is not None
        await process.stdin.drain()
        (length,) = _LENGTH.unpack(await process.stdout.readexactly(_LENGTH.size))
        return await process.stdout.readexactly(length)

    @staticmethod
    def _write(process: asyncio.subprocess.Process, data: bytes) -> None:
        assert process.stdin is not None
        process.stdin.write(_LENGTH.pack(len(data)) + data)

    async def close(self) -> None:
        """End the process; a later call begins another one, with the object as it was made, or as `next_makes` says."""
        process, self._process = self._process, None
        if process is not None:
            await killed(process)


def _serve() -> None:
    """Read the object and then orders from standard input, and write the answers to standard output."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)
        os.nice(5)  # the flight goes first
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # sent to all processes of a service; the caller ends this one
        orders: queue.Queue[bytes] = queue.Queue()
        paths, first = pickle.loads(_read())
        sys.path[:] = paths
        threading.Thread(target=_read_all, args=(orders,), daemon=True).start()
        make, args = pickle.loads(first)
        kept = make(*args)
        while True:
            answer = _answer(kept, orders.get())
            out.write(_LENGTH.pack(len(answer)) + answer)
            out.flush()


def _read() -> bytes:
    """The next order; the process ends with its caller, also while it computes."""
    head = sys.stdin.buffer.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        os._exit(1)
    return sys.stdin.buffer.read(*_LENGTH.unpack(head))


def _read_all(orders: queue.Queue[bytes]) -> None:
    while True:
        orders.put(_read())


def _answer(kept: object, order: bytes) -> bytes:
    try:
        method, args = pickle.loads(order)
        return pickle.dumps((True, getattr(kept, method)(*args)))
    except Exception as error:
        try:
            pickle.loads(answer := pickle.dumps((False, error)))
        except Exception:
            return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))
        return answer


if __name__ == "__main__":
    _serve()
