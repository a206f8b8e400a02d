"""Whether setpoints keep coming.

Knows: when the last one counted, and for how long they have come without a gap. Does not know: what they say.
"""

from __future__ import annotations

import math


class OffboardTimeout:
    """A stream of setpoints is believed once it has run for `proof_s` without a gap, and lost after one."""

    def __init__(self, proof_s: float) -> None:
        self._proof_s = proof_s
        self._since_s = math.inf
        self._last_s = -math.inf
        self.timeout_s = 1.0
        self.ever = False

    def heard(self, t_s: float, counts_at_s: float) -> None:
        """A setpoint came at `t_s` that counts at `counts_at_s`, then or later."""
        if not self.alive(t_s):
            self._since_s = t_s
        self._last_s = max(t_s, counts_at_s, self._last_s)
        self.ever = True

    def alive(self, t_s: float) -> bool:
        """Whether the last one is recent."""
        return t_s - self._last_s <= self.timeout_s

    def proven(self, t_s: float) -> bool:
        """Whether setpoints may be relied on, where any proof is asked for."""
        return not self._proof_s or (self.alive(t_s) and t_s - self._since_s >= self._proof_s)
