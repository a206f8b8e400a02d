"""Steady wind that grows with height, as plans expect it.

Knows: the power law. Does not know: gusts (`sim_bridge`), vehicles. `xp` supplies sqrt, so that arrays and symbols go
through the same lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

_FLOOR_M = 1.0  # below it the law, which has no slope at the ground, is rounded


@dataclass(frozen=True)
class SteadyWind:
    """Where air moves to, level: so fast at a reference height above height 0, by a power of the height elsewhere."""

    north_mps: float = 0.0
    east_mps: float = 0.0
    reference_m: float = 10.0
    exponent: float = 0.0  # 0: the same at every height; 1/7 over open land

    @property
    def is_still(self) -> bool:
        """No wind at all."""
        return not (self.north_mps or self.east_mps)

    @property
    def has_shear(self) -> bool:
        """Differs with height."""
        return self.exponent > 0.0 and not self.is_still

    @property
    def speed_mps(self) -> float:
        """At the reference height."""
        return float(np.hypot(self.north_mps, self.east_mps))

    def share(self, height_m: Any, xp: Any = np) -> Any:
        """Speed at a height above height 0 as a share of that at the reference height."""
        if not self.has_shear:
            return 1.0
        return (_rounded(height_m, xp) / self.reference_m) ** self.exponent

    def shares(self, height_m: Any) -> tuple[Any, Any, Any]:
        """The share and its first two derivatives by height, 1/m and 1/m^2."""
        if not self.has_shear:
            return 1.0, 0.0, 0.0
        root = np.sqrt(height_m**2 + _FLOOR_M**2)
        s, slope, bend = _rounded(height_m, np), 0.5 * (1.0 + height_m / root), 0.5 * _FLOOR_M**2 / root**3
        k, value = self.exponent, (_rounded(height_m, np) / self.reference_m) ** self.exponent
        return value, k * value * slope / s, k * value * ((k - 1.0) * (slope / s) ** 2 + bend / s)

    def at(self, height_m: Any, xp: Any = np) -> tuple[Any, Any, Any]:
        """Velocity of the air north, east and down at a height above height 0, m/s."""
        share = self.share(height_m, xp)
        return share * self.north_mps, share * self.east_mps, 0.0


def _rounded(height_m: Any, xp: Any) -> Any:
    """The height, and above the ground never quite nothing."""
    return 0.5 * (height_m + xp.sqrt(height_m**2 + _FLOOR_M**2))


STILL = SteadyWind()
