"""What really happens to the vehicles: Eq. 1 integrated with fixed-step RK4, and the ground under it.

Knows: true states, forces, contact. Does not know: sensors, estimates, references, who commands the rotors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gcs.quadrotor import ATTITUDE, RATES, VELOCITY, Array, Quadrotor
from sim_bridge.motion import rk4

Ground = Callable[[Array, Array], Array]  # north_m (V,), east_m (V,) -> height_m (V,)
Mask = NDArray[np.bool_]

# Between two looks at the ground a vehicle is trusted to come no closer to it than this allows. At 5 m/s over
# ground that is a slope of 84 degrees; looking at every step would cost as much as integrating.
CLOSING_MAX_MPS = 50.0


class Plant:
    """V true vehicles. A vehicle in contact stands level and still until its thrust exceeds its weight."""

    def __init__(self, q: Quadrotor, ground: Ground, pads_ned_m: Array, yaw_ned_rad: Array) -> None:
        """Stand the vehicles on the ground at the north and east of pads (V, 3), with yaw (V,)."""
        self._q = q
        self._ground = ground
        self._state = np.zeros((12, len(pads_ned_m)))
        self._state[:2] = pads_ned_m[:, :2].T
        self._state[2] = -ground(self._state[0], self._state[1])
        self._state[8] = yaw_ned_rad
        self._look_in_s = 0.0
        self.landed: Mask = np.ones(len(pads_ned_m), dtype=bool)

    @property
    def state(self) -> Array:
        """True states (V, 12), in the order of `gcs.quadrotor`."""
        return self._state.T

    def step(self, control: Array, wind_ned_mps: Array, step_s: float) -> None:
        """Advance by step_s under controls (V, 4) and wind (V, 3), both held."""
        stays = self.landed & (control[:, 0] <= self._q.weight_N)
        if stays.all():
            return
        moved = rk4(self._state, control.T, self._q, wind_ned_mps.T, step_s)
        if self.landed.any():
            moved[:, stays] = self._state[:, stays]
            self.landed = stays
            self._look_in_s = 0.0
        self._state = moved
        self._look_in_s -= step_s
        if self._look_in_s <= 0.0:
            self._touch_ground()

    def _touch_ground(self) -> None:
        ground_m = self._ground(self._state[0], self._state[1])
        clearance_m = -self._state[2] - ground_m
        touching = clearance_m <= 0.0
        if touching.any():
            self._state[2, touching] = -ground_m[touching]
            for part in (VELOCITY, slice(ATTITUDE.start, ATTITUDE.start + 2), RATES):
                self._state[part, touching] = 0.0
            self.landed = self.landed | touching
        airborne = clearance_m[~self.landed]
        self._look_in_s = float(airborne.min()) / CLOSING_MAX_MPS if airborne.size else 0.0
