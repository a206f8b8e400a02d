"""Detects the loss of a setpoint stream."""

from __future__ import annotations

import math


class OffboardTimeout:
    """A stream counts as alive until `timeout_s` without a setpoint, and as proven after `proof_s` without a gap."""

    def __init__(self, proof_s: float) -> None:
        self._proof_s = proof_s
        self._since_s = math.inf
        self._last_s = -math.inf
        self.timeout_s = 1.0
        self.ever = False

    def heard(self, t_s: float, counts_at_s: float) -> None:
        """Record a setpoint that arrived at `t_s` and takes effect at `counts_at_s`, then or later."""
        if not self.alive(t_s):
            self._since_s = t_s
        self._last_s = max(t_s, counts_at_s, self._last_s)
        self.ever = True

    def alive(self, t_s: float) -> bool:
        """Whether the last setpoint is no older than the timeout."""
        return t_s - self._last_s <= self.timeout_s

    def proven(self, t_s: float) -> bool:
        """Whether the stream has run long enough to enter or arm in a guided mode."""
        return not self._proof_s or (self.alive(t_s) and t_s - self._since_s >= self._proof_s)
