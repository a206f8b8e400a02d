"""What long work is doing: code at any depth reports it, and the command that began the work shows it now and then.

A time limit is kept where work is reported.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from gcs.errors import OutOfTime

_FIRST_S, _GROWTH, _LONGEST_S = 1.5, 1.5, 15.0  # between two lines: short work is silent, long work fills no page


class _Listener:
    """Passes a report on when one is due."""

    def __init__(self, show: Callable[[str], None], now_s: Callable[[], float], every_s: float | None) -> None:
        self._show, self._now_s, self._every_s = show, now_s, every_s
        self._pause_s = _FIRST_S if every_s is None else every_s
        self._due_s = now_s() + self._pause_s
        self._last, self._last_s = "", -math.inf

    def hear(self, what: str | Callable[[], str]) -> None:
        """Show it if one is due."""
        if (now_s := self._now_s()) < self._due_s:
            return
        text = what if isinstance(what, str) else what()
        if text != self._last or now_s >= self._last_s + _LONGEST_S or self._every_s is not None:
            self._last, self._last_s = text, now_s
            self._show(text)
        if self._every_s is None:
            self._pause_s = min(self._pause_s * _GROWTH, _LONGEST_S)
        self._due_s = self._now_s() + self._pause_s


_LISTENER: ContextVar[_Listener | None] = ContextVar("listener", default=None)


@contextmanager
def shown(
    show: Callable[[str], None], every_s: float | None = None, now_s: Callable[[], float] = time.monotonic
) -> Iterator[None]:
    """Show reports of the work inside, every `every_s`; left out: after 1.5 s, then more and more seldom."""
    token = _LISTENER.set(_Listener(show, now_s, every_s))
    try:
        yield
    finally:
        _LISTENER.reset(token)


_END_S: ContextVar[float] = ContextVar("end", default=math.inf)  # by time.monotonic


@contextmanager
def within(limit_s: float) -> Iterator[None]:
    """Give the work inside so much time, and no more than it has already."""
    token = _END_S.set(min(_END_S.get(), time.monotonic() + limit_s))
    try:
        yield
    finally:
        _END_S.reset(token)


def left_s() -> float:
    """The time that the work has left, s; infinite without a limit."""
    return _END_S.get() - time.monotonic()


def report(what: str | Callable[[], str]) -> None:
    """Report what the work is doing now. A function is called only if the report is shown.

    Raises OutOfTime where the work has no time left.
    """
    if left_s() < 0.0:
        raise OutOfTime.because(what if isinstance(what, str) else what())
    if (listener := _LISTENER.get()) is not None:
        listener.hear(what)


_SEARCH_S: ContextVar[float] = ContextVar("search", default=math.inf)


@contextmanager
def searching_for(limit_s: float | None) -> Iterator[None]:
    """Each search inside ends after so much time with what it has found; None: when it is done."""
    token = _SEARCH_S.set(math.inf if limit_s is None else limit_s)
    try:
        yield
    finally:
        _SEARCH_S.reset(token)


def search_ends_s() -> float:
    """When a search that begins now ends, by time.monotonic."""
    return time.monotonic() + _SEARCH_S.get()
