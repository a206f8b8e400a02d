"""The reference of a fleet at one time: the flat outputs of every vehicle and their derivatives."""

from dataclasses import dataclass

import numpy as np

from gcs.types import Array


@dataclass(frozen=True, slots=True)
class Reference:
    """Flat outputs of V vehicles at one time, in the common local NED frame.

    A quadrotor is differentially flat in position and yaw: with position known up to snap, attitude, rates and controls
    follow from Eq. 1 (`sim_bridge.dynamics.controller`).
    """

    position_ned_m: Array  # (V, 3)
    velocity_ned_mps: Array  # (V, 3)
    acceleration_ned_mps2: Array  # (V, 3)
    jerk_ned_mps3: Array  # (V, 3)
    snap_ned_mps4: Array  # (V, 3)
    yaw_ned_rad: Array  # (V,)
    yaw_rate_radps: Array  # (V,)

    def __post_init__(self) -> None:
        vehicles = len(self.yaw_ned_rad)
        vectors = (self.position_ned_m, self.velocity_ned_mps, self.acceleration_ned_mps2)
        for name, array in zip(self.__slots__, (*vectors, self.jerk_ned_mps3, self.snap_ned_mps4), strict=False):
            if array.shape != (vehicles, 3):
                raise ValueError(f"{name} must have shape {(vehicles, 3)}, has {array.shape}")
        if self.yaw_rate_radps.shape != (vehicles,):
            raise ValueError(f"yaw_rate_radps must have shape {(vehicles,)}, has {self.yaw_rate_radps.shape}")


def hold(position_ned_m: Array, yaw_ned_rad: Array) -> Reference:
    """Return the reference of hover at positions (V, 3) with yaw (V,)."""
    still = np.zeros_like(position_ned_m)
    return Reference(position_ned_m, still, still, still, still, yaw_ned_rad, np.zeros_like(yaw_ned_rad))
