"""An event loop whose clock skips the pauses of its own process.

A process that was stopped (SIGSTOP), swapped out, suspended with its computer, or busy for seconds resumes with all its
timers due and all messages unread. The clock of this loop counts such a pause as `COUNTED_S`, so every timeout and age
in the program measures its peers and never the program. The vehicles' own clocks, which run on during a pause, are
compared with `host_s`, which counts everything.

A loop may also follow the time of emulated vehicles. It then never waits in real time, except for work of this machine
(threads, processes), for which emulated time stands.
"""

import asyncio
import math
import selectors
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from typing import Protocol, TypeVar, TypeVarTuple

Ready = tuple[selectors.SelectorKey, int]  # and its events
T = TypeVar("T")
Ts = TypeVarTuple("Ts")

PULSE_S = 0.1  # the loop looks at its clock so often at least
LATE_S = 1.0  # a look that is later by more than this is a standstill; so is a turn of the loop that takes longer
COUNTED_S = 0.1  # so much of a standstill counts


class SteadyClock:
    """Detects pauses of this process. Time is an argument: the host's clock, s.

    `stood_s` is the sum of uncounted time, `count` the number of pauses, `last_s` the length of the last.
    """

    def __init__(self, host_s: float) -> None:
        self.stood_s = 0.0
        self.count = 0
        self.last_s = 0.0
        self._host_s = host_s
        self._turn_began_s = host_s
        self._turn_counted_s = 0.0

    def look(self, host_s: float) -> float:
        """Return the time at `host_s` without pauses. It never runs back."""
        step_s = max(host_s - self._host_s, 0.0)
        room_s = max(LATE_S - self._turn_counted_s, 0.0)
        counted_s = min(step_s if step_s <= LATE_S else COUNTED_S, room_s)
        self._turn_counted_s += counted_s
        self.stood_s += step_s - counted_s
        self._host_s += step_s
        return self._host_s - self.stood_s

    def turn(self, host_s: float) -> float:
        """Do as `look`, at the beginning and end of every wait: a turn of the loop has ended."""
        now_s = self.look(host_s)
        took_s = self._host_s - self._turn_began_s
        if took_s > self._turn_counted_s + 1e-6:
            self.count += 1
            self.last_s = took_s
        self._turn_began_s = self._host_s
        self._turn_counted_s = 0.0
        return now_s

    def begin_anew(self, host_s: float) -> None:
        """Count no pause up to now."""
        self._host_s = self._turn_began_s = host_s
        self.stood_s = self._turn_counted_s = 0.0


class Leader(Protocol):
    """Whose time a loop follows."""

    @property
    def now_s(self) -> float:
        """Its time. It never runs back."""
        ...

    def comes_to(self, t_s: float) -> bool:
        """Return whether it is `t_s` now, because nothing happens before; else a file becomes readable."""
        ...


def _host_clock_s() -> float:
    """The host's steady clock. Where the system has one, it goes on while the computer is suspended."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


class _Selector(selectors.DefaultSelector):
    """Waits at most `PULSE_S` at a time, so that a long wait is not taken for a pause."""

    def __init__(self) -> None:
        super().__init__()
        self.stalls = SteadyClock(_host_clock_s())
        self.leader: Leader | None = None
        self.works = 0  # of this machine, for which the leader's time stands

    def select(self, timeout: float | None = None) -> list[Ready]:
        if self.leader is not None:
            return self._follow(self.leader, timeout)
        self.stalls.turn(_host_clock_s())
        found = super().select(PULSE_S if timeout is None else min(timeout, PULSE_S))
        self.stalls.turn(_host_clock_s())
        return found

    def _follow(self, leader: Leader, timeout: float | None) -> list[Ready]:
        found = super().select(0.0)
        if found or (timeout is not None and timeout <= 0.0):
            return found
        if not self.works and leader.comes_to(math.inf if timeout is None else leader.now_s + timeout):
            return []
        return super().select(PULSE_S)


class SteadyLoop(asyncio.SelectorEventLoop):
    """The event loop of a program that talks to vehicles."""

    def __init__(self) -> None:
        self._watched = _Selector()
        self._ahead_s = 0.0  # of the host's time without pauses
        super().__init__(self._watched)

    @property
    def stalls(self) -> SteadyClock:
        """The pauses of this process since the loop was made."""
        return self._watched.stalls

    @property
    def follows(self) -> bool:
        """Whether the time is that of emulated vehicles."""
        return self._watched.leader is not None

    def time(self) -> float:
        """Return the host's time without pauses, or that of the leader."""
        leader = self._watched.leader
        return self.stalls.look(_host_clock_s()) + self._ahead_s if leader is None else leader.now_s

    def follow(self, leader: Leader | None) -> None:
        """Have the leader's time from now on; None: go on from it at the host's rate.

        Timers that are set keep their times, which mean nothing to the leader: set none before.
        """
        now_s = self.time()
        self._watched.leader = leader
        self.stalls.begin_anew(_host_clock_s())
        if leader is None:
            self._ahead_s = now_s - self.stalls.look(_host_clock_s())

    @contextmanager
    def standing(self) -> Iterator[None]:
        """The leader's time stands in this block, which waits for work of this machine."""
        self._watched.works += 1
        try:
            yield
        finally:
            self._watched.works -= 1

    def run_in_executor(self, executor: Executor | None, func: Callable[[*Ts], T], *args: *Ts) -> asyncio.Future[T]:
        """Do as any loop; the leader's time stands until the thread has ended."""
        future = super().run_in_executor(executor, func, *args)
        self._watched.works += 1
        future.add_done_callback(self._worked)
        return future

    def _worked(self, _: object) -> None:
        self._watched.works -= 1


@contextmanager
def time_stands() -> Iterator[None]:
    """Emulated time stands in this block, however long this machine works; real time goes on."""
    with getattr(asyncio.get_running_loop(), "standing", nullcontext)():
        yield


def stalls_of(loop: asyncio.AbstractEventLoop) -> SteadyClock:
    """Return the pauses that a loop counted; none for another kind of loop."""
    return loop.stalls if isinstance(loop, SteadyLoop) else SteadyClock(0.0)


def follows(loop: asyncio.AbstractEventLoop) -> bool:
    """Return whether a loop has the time of emulated vehicles."""
    return isinstance(loop, SteadyLoop) and loop.follows


def host_s(loop: asyncio.AbstractEventLoop) -> float:
    """Return the loop's time including pauses: the clocks of vehicles run at this rate."""
    return loop.time() + stalls_of(loop).stood_s
