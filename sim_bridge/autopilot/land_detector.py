"""Detects take-off and landing by ground contact alone.

standing --lift--> lifting --no contact--> in the air --contact for landed_after_s--> standing
lifting --contact for _LIFT_OFF_TIMEOUT_S after the climb--> standing
"""

from __future__ import annotations

_LIFT_OFF_TIMEOUT_S = 3.0  # for a take-off that never left the ground


class LandDetector:
    """`flying` from the take-off command until the landing; `aloft` once the vehicle has left the ground."""

    def __init__(self, landed_after_s: float) -> None:
        self._landed_after_s = landed_after_s
        self._contact_s: float | None = None
        self.flying = False
        self.aloft = False

    def lift(self) -> None:
        """Start a take-off."""
        self.flying, self.aloft, self._contact_s = True, False, None

    def settle(self) -> None:
        """The vehicle stands, or lies, on the ground."""
        self.flying, self.aloft, self._contact_s = False, False, None

    def step(self, t_s: float, contact: bool, climbing_until_s: float) -> tuple[bool, bool]:
        """Return whether the vehicle left the ground in this step, and whether it landed in this step."""
        if not contact:
            left = not self.aloft
            self._contact_s, self.aloft = None, True
            return left, False
        if t_s <= climbing_until_s + _LIFT_OFF_TIMEOUT_S:
            self.aloft = False  # a bounce at the start of a climb is not a landing
        elif self._contact_s is None:
            self._contact_s = t_s
        elif t_s - self._contact_s >= self._landed_after_s:
            self.settle()
            return False, True
        return False, False
