"""How late a vehicle flies its plan, by what it tells of itself, and how far apart vehicles are in that.

Knows: places, the plan's places and velocities at the same instants of the vehicle's own clock. Does not know: where
they come from, what lateness is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from gcs.physics.quadrotor import Array

SLOW_MPS = 0.3  # who hardly moves is neither late nor early


class Lateness:
    """The shift in time that brings places nearest to those planned: least squares along the velocity, so far."""

    def __init__(self) -> None:
        self._behind_m2ps = 0.0
        self._squared_m2ps2 = 0.0

    def add(self, flown_m: Array, planned_m: Array, rate_mps: Array) -> None:
        """One more instant; all (3,)."""
        squared = float(rate_mps @ rate_mps)
        if squared > SLOW_MPS**2:
            self._behind_m2ps += float((planned_m - flown_m) @ rate_mps)
            self._squared_m2ps2 += squared

    @property
    def late_s(self) -> float:
        """Positive: behind the plan. NaN for who never moved."""
        return self._behind_m2ps / self._squared_m2ps2 if self._squared_m2ps2 else math.nan


def skew_s(late_s: Iterable[float]) -> float:
    """The latest one's lateness less the earliest one's; NaN where nobody has any."""
    known = [late for late in late_s if math.isfinite(late)]
    return max(known) - min(known) if known else math.nan
