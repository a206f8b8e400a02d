"""Steady horizontal wind that grows with height by a power law. Plans assume it; gusts exist in `sim_bridge` only.

`xp` supplies sqrt, so that arrays and CasADi symbols use the same lines.
"""

from dataclasses import dataclass

import numpy as np

from gcs.types import Maths, Scalar

GUSTS_MPS = {"none": 0.0, "light": 0.5, "moderate": 1.0, "severe": 2.0}  # horizontal standard deviation, by name
_FLOOR_M = 1.0  # below it the power law is smoothed: its slope at the ground is infinite


@dataclass(frozen=True)
class SteadyWind:
    """The air velocity at `reference_m` above height 0. Elsewhere it scales with a power of the height."""

    north_mps: float = 0.0
    east_mps: float = 0.0
    reference_m: float = 10.0
    exponent: float = 0.0  # 0: the same at every height; 1/7 over open land

    @property
    def is_still(self) -> bool:
        """Whether there is no wind at all."""
        return not (self.north_mps or self.east_mps)

    @property
    def has_shear(self) -> bool:
        """Whether the wind differs with height."""
        return self.exponent > 0.0 and not self.is_still

    @property
    def speed_mps(self) -> float:
        """The speed at the reference height."""
        return float(np.hypot(self.north_mps, self.east_mps))

    def share(self, height_m: Scalar, xp: Maths = np) -> Scalar:
        """The speed at a height above height 0, as a share of the speed at the reference height."""
        if not self.has_shear:
            return 1.0
        return (_rounded(height_m, xp) / self.reference_m) ** self.exponent

    def shares(self, height_m: Scalar, xp: Maths = np) -> tuple[Scalar, Scalar, Scalar]:
        """The share and its first two derivatives with respect to height, 1/m and 1/m^2."""
        if not self.has_shear:
            return 1.0, 0.0, 0.0
        root = xp.sqrt(height_m * height_m + _FLOOR_M**2)
        s, slope, bend = 0.5 * (height_m + root), 0.5 * (1.0 + height_m / root), 0.5 * _FLOOR_M**2 / root**3
        k, value = self.exponent, (s / self.reference_m) ** self.exponent
        steep = slope / s
        return value, k * value * steep, k * value * ((k - 1.0) * (steep * steep) + bend / s)

    def at(self, height_m: Scalar, xp: Maths = np) -> tuple[Scalar, Scalar, Scalar]:
        """The air velocity (north, east, down) at a height above height 0, m/s."""
        share = self.share(height_m, xp)
        return share * self.north_mps, share * self.east_mps, 0.0


def _rounded(height_m: Scalar, xp: Maths) -> Scalar:
    """The height, smoothed so that it stays above 0 at the ground."""
    return 0.5 * (height_m + xp.sqrt(height_m * height_m + _FLOOR_M**2))


STILL = SteadyWind()
