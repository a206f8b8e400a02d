"""Paces simulated time against wall time. Both are arguments.

Pacing is absolute: a late step is made up for, so nothing drifts. After a long stall only `CATCH_UP_S` is made up for,
because a long burst would be worse than the lost time.
"""

from __future__ import annotations

import math

CATCH_UP_S = 0.1  # of wall time


class Pace:
    """Maps simulated time to the wall time when it is due."""

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
