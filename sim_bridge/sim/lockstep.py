"""How long emulated time stands still for setpoints that a ground station owes.

Knows: who awaits how its stream goes on, and since when. Does not know: vehicles, messages, sockets; wall time is an
argument.

A vehicle whose patience ended goes on without, until anything newer comes: then it is waited for again, so a station
that was held up for a while catches up instead of being late for the rest of the flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

PATIENCE_S = 3.0
REMIND_S = 0.03


class Lockstep:
    """Of a whole fleet. All times but stamps are of the wall's clock."""

    def __init__(self) -> None:
        self._given_up: dict[int, float] = {}  # newest stamp when patience ended
        self._until_s = math.inf
        self._remind_s = math.inf

    def wait_s(self, awaiting: Mapping[int, float], now_s: float) -> float:
        """How long to wait; 0 to go on. `awaiting`: the newest stamp that each waiting vehicle has."""
        self._given_up = {row: stamp for row, stamp in self._given_up.items() if awaiting.get(row) == stamp}
        if awaiting.keys() <= self._given_up.keys():
            self._until_s = self._remind_s = math.inf
            return 0.0
        if math.isinf(self._until_s):
            self._until_s, self._remind_s = now_s + PATIENCE_S, now_s + REMIND_S
        if now_s < self._until_s:
            return min(self._until_s, max(self._remind_s, now_s + 1e-3)) - now_s
        self._given_up = dict(awaiting)
        self._until_s = self._remind_s = math.inf
        return 0.0

    def reminds(self, now_s: float) -> bool:
        """Whether to tell the ground station again what time it is: what told it may have been lost on its way."""
        if now_s < self._remind_s:
            return False
        self._remind_s = now_s + REMIND_S
        return True
