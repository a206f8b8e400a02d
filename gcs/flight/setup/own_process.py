"""Runs one function in a process of its own, so that heartbeats and setpoints keep their deadlines meanwhile.

A thread would not do: Python runs one thread at a time, and a long computation keeps the event loop waiting. The
process is `python -m gcs.own_process`, not a worker of `multiprocessing`: that would execute the caller's script again.
"""

import asyncio
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import ParamSpec, TypeVar

from gcs.util.steady_loop import time_stands

P = ParamSpec("P")
R = TypeVar("R")


class OwnProcessEnded(RuntimeError):
    """The process ended without a result: it was killed, or memory ran out."""


async def in_own_process(work: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Return `work(*args, **kwargs)`, computed in a new process; raise what it raises.

    The function must be importable, and it, its arguments and its result picklable. The process is killed when the
    caller is cancelled, and ends when this one does. Ctrl-C and SIGTERM do not end it. Raises `OwnProcessEnded`.
    """
    order = pickle.dumps((list(sys.path), pickle.dumps((work, args, kwargs))))
    with time_stands():
        answer = await _answer_of(order)
    if not answer:
        raise OwnProcessEnded(f"{work.__module__}.{work.__qualname__}: the process ended without a result")
    fine, value = pickle.loads(answer)
    if not fine:
        raise value
    result: R = value
    return result


async def _answer_of(order: bytes) -> bytes:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", __name__),
        stdin=asyncio.subprocess.PIPE,  # stays open: it closes when the caller ends, and the process ends with it
        stdout=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        with suppress(ConnectionError):  # it has ended already; the answer is then empty
            process.stdin.write(order)
            await process.stdin.drain()
        return await process.stdout.read()
    finally:
        await killed(process)  # it has no more to say


async def killed(process: asyncio.subprocess.Process) -> None:
    """End a process that was started with a pipe to its standard input, at once."""
    with suppress(ProcessLookupError):
        process.kill()
    assert process.stdin is not None
    process.stdin.close()
    await process.wait()


def _serve() -> None:
    """Read one order from standard input, and write its result to standard output. Nothing else is printed there."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)
        os.nice(5)  # the flight goes first
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # sent to all processes of a service; the caller ends this one
        paths, order = pickle.load(sys.stdin.buffer)
        threading.Thread(target=_end_with_the_caller, daemon=True).start()
        sys.path[:] = paths
        out.write(_answer(order))


def _end_with_the_caller() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


def _answer(order: bytes) -> bytes:
    try:
        work, args, kwargs = pickle.loads(order)
        return pickle.dumps((True, work(*args, **kwargs)))
    except Exception as error:
        try:
            return pickle.dumps((False, error))
        except Exception:
            return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))


if __name__ == "__main__":
    _serve()
