"""From lift-off to landing, by contact with the ground alone.

Knows: contact, and how long it has to last. Does not know: heights, motors, why the vehicle climbs or sinks.

    standing --lift--> lifting --no contact--> in the air --contact for landed_after_s--> standing
    lifting --contact, and the climb is long over--> standing
"""

from __future__ import annotations

_LIFT_OFF_PATIENCE_S = 3.0  # after a take-off that never left the ground


class LandDetector:
    """`flying` from the order to lift until the landing; `aloft` once the ground was left."""

    def __init__(self, landed_after_s: float) -> None:
        self._landed_after_s = landed_after_s
        self._contact_s: float | None = None
        self.flying = False
        self.aloft = False

    def lift(self) -> None:
        """Motors lift from now on."""
        self.flying, self.aloft, self._contact_s = True, False, None

    def settle(self) -> None:
        """The vehicle stands, or lies."""
        self.flying, self.aloft, self._contact_s = False, False, None

    def step(self, t_s: float, contact: bool, climbing_until_s: float) -> tuple[bool, bool]:
        """Whether it left the ground just now, and whether it has just landed."""
        if not contact:
            left = not self.aloft
            self._contact_s, self.aloft = None, True
            return left, False
        if t_s <= climbing_until_s + _LIFT_OFF_PATIENCE_S:
            self.aloft = False  # a hop at the start of a climb is no landing
        elif self._contact_s is None:
            self._contact_s = t_s
        elif t_s - self._contact_s >= self._landed_after_s:
            self.settle()
            return False, True
        return False, False
