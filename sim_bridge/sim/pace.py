"""How fast simulated time may run against the wall's clock.

Knows: a rate and an anchor. Does not know: clocks (both times are arguments), why the rate changes.
Pacing is absolute: a step that comes late is made up for, so that nothing drifts; but only so much, because after a
long stall a burst of catching up would be worse than having lost the time.
"""

from __future__ import annotations

import math

CATCH_UP_S = 0.1  # of wall time


class Pace:
    """Maps simulated time to the instant on the wall's clock when it is due."""

    def __init__(self, rate: float) -> None:
        """`rate` is simulated seconds per second; inf does not wait at all."""
        self._rate = rate
        self._t_s = 0.0
        self._now_s = -math.inf

    @property
    def rate(self) -> float:
        """Simulated seconds per second."""
        return self._rate

    def wait_s(self, t_s: float, now_s: float, rate: float) -> float:
        """How long to wait until `t_s` is due at `rate`; 0 if it is."""
        if rate != self._rate:
            self._rate, self._t_s, self._now_s = rate, t_s, now_s
        if math.isinf(rate):
            return 0.0
        due_s = self._now_s + (t_s - self._t_s) / rate
        if now_s - due_s > CATCH_UP_S:
            self._t_s, self._now_s = t_s, now_s
            return 0.0
        return max(due_s - now_s, 0.0)
