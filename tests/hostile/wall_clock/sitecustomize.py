"""Loaded by a Python process at its start: SIGUSR1 sets its wall clock a day forward, SIGUSR2 three days back."""

from __future__ import annotations

import datetime
import signal
import time

_DAY_S = 86_400.0
_real_time = time.time
_real_time_ns = time.time_ns
_off_s = 0.0


def _set(number: int, _: object) -> None:
    global _off_s  # noqa: PLW0603 (the clock of a whole process)
    _off_s += _DAY_S if number == signal.SIGUSR1 else -3.0 * _DAY_S


class _SetDatetime(datetime.datetime):
    @classmethod
    def now(cls, tz: datetime.tzinfo | None = None) -> _SetDatetime:
        return cls.fromtimestamp(time.time(), tz)


time.time = lambda: _real_time() + _off_s
time.time_ns = lambda: _real_time_ns() + round(_off_s * 1e9)
datetime.datetime = _SetDatetime  # type: ignore[misc]
signal.signal(signal.SIGUSR1, _set)
signal.signal(signal.SIGUSR2, _set)
