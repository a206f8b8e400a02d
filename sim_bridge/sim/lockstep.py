"""Lockstep: how long simulated time waits for what the ground station has not sent yet.

Wall time is an argument. After the timeout vehicles fly on without it. They wait again as soon as anything newer
arrives. So a ground station that paused catches up, and is not late for the rest of the flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

TIMEOUT_S = 3.0
ON_GROUND_TIMEOUT_S = 0.3  # nothing happens there; and the station may have ended, and another one begun
REMIND_S = 0.03
CATCH_UP_S = 0.1  # of wall time


class Lockstep:
    """The lockstep of a whole fleet. All times except stamps are wall time."""

    def __init__(self) -> None:
        self._given_up: dict[int, float] = {}  # newest stamp at the timeout
        self._until_s = math.inf
        self._remind_s = math.inf

    def wait_s(self, awaiting: Mapping[int, float], now_s: float, timeout_s: float | None = None) -> float:
        """Return how long to wait, `TIMEOUT_S` in all if not told; 0 to go on.

        `awaiting`: the newest stamp of each peer that waits for a newer one.
        """
        self._given_up = {row: stamp for row, stamp in self._given_up.items() if awaiting.get(row) == stamp}
        if awaiting.keys() <= self._given_up.keys():
            self._until_s = self._remind_s = math.inf
            return 0.0
        if math.isinf(self._until_s):
            self._until_s = now_s + (TIMEOUT_S if timeout_s is None else timeout_s)
            self._remind_s = now_s + REMIND_S
        if now_s < self._until_s:
            return min(self._until_s, max(self._remind_s, now_s + 1e-3)) - now_s
        self._given_up = dict(awaiting)
        self._until_s = self._remind_s = math.inf
        return 0.0

    def reminds(self, now_s: float) -> bool:
        """Whether to send the time again: the message with it may have been lost."""
        if now_s < self._remind_s:
            return False
        self._remind_s = now_s + REMIND_S
        return True


class Pace:
    """Maps simulated time to the wall time when it is due. Both are arguments.

    Pacing is absolute: a late step is made up for, so nothing drifts. After a long stall only `CATCH_UP_S` is made up
    for, because a long burst would be worse than the lost time.
    """

    def __init__(self, rate: float) -> None:
        """`rate` is simulated seconds per second; inf never waits."""
        self._rate = rate
        self._t_s = 0.0
        self._now_s = -math.inf

    @property
    def rate(self) -> float:
        """Simulated seconds per second."""
        return self._rate

    def wait_s(self, t_s: float, now_s: float, rate: float) -> float:
        """Return how long to wait until `t_s` is due at `rate`; 0 if it is due."""
        if rate != self._rate:
            self._rate, self._t_s, self._now_s = rate, t_s, now_s
        if math.isinf(rate):
            return 0.0
        due_s = self._now_s + (t_s - self._t_s) / rate
        if now_s - due_s > CATCH_UP_S:
            self._t_s, self._now_s = t_s, now_s
            return 0.0
        return max(due_s - now_s, 0.0)
