"""States and controls of Eq. 1: their number, columns and names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.types import Array

NX, NU = 12, 4  # components of state and control of one vehicle
POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


@dataclass(frozen=True)
class NamedStates:
    """States (..., 12) of Eq. 1 by the names of their columns; `values` is the array itself."""

    values: Array  # (..., 12), SI and NED

    def __post_init__(self) -> None:
        if self.values.shape[-1:] != (NX,):
            raise ValueError(f"states must be (..., {NX}), not {self.values.shape}")

    @property
    def position_ned_m(self) -> Array:
        """Columns 0 to 2: positions (..., 3) north, east and down from the origin."""
        return self.values[..., POSITION]

    @property
    def velocity_ned_mps(self) -> Array:
        """Columns 3 to 5: velocities (..., 3) north, east and down."""
        return self.values[..., VELOCITY]

    @property
    def attitude_rad(self) -> Array:
        """Columns 6 to 8: roll, pitch and yaw (..., 3)."""
        return self.values[..., ATTITUDE]

    @property
    def rates_radps(self) -> Array:
        """Columns 9 to 11: the rates of roll, pitch and yaw (..., 3)."""
        return self.values[..., RATES]

    @property
    def north_m(self) -> Array:
        """Column 0 (...)."""
        return self.values[..., 0]

    @property
    def east_m(self) -> Array:
        """Column 1 (...)."""
        return self.values[..., 1]

    @property
    def height_m(self) -> Array:
        """Heights (...) above the origin: column 2 with the other sign."""
        return -self.values[..., 2]

    @property
    def speed_mps(self) -> Array:
        """Lengths (...) of the velocities."""
        return np.asarray(np.linalg.norm(self.velocity_ned_mps, axis=-1))
