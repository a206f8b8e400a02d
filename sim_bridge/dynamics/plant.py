"""The true motion of the vehicles: the rotors, Eq. 1, the ground, and the specific force an inertial unit senses."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import Quadrotor, control_from_rotors, rotors_from_control
from gcs.physics.states import ATTITUDE, RATES, VELOCITY
from gcs.types import Array
from sim_bridge.dynamics.integrator import Stepper

Ground = Callable[[Array, Array], Array]  # north_m (V,), east_m (V,) -> height_m (V,)
Mask = NDArray[np.bool_]

# A ground check costs as much as a step, so the next one is scheduled. Until then a vehicle is assumed to approach the
# ground no faster than in a straight line towards a slope of 70 degrees, accelerating at _GAIN_MPS2.
_STEEPEST = 3.0
_GAIN_MPS2 = 10.0


class Plant:
    """V true vehicles. A vehicle in contact stands level and still until its thrust exceeds its weight.

    `state` (12, V) in the order of `gcs.physics.quadrotor`; `landed` (V,) in contact; `specific_force_mps2` (3, V), in
    body axes.
    """

    def __init__(self, q: Quadrotor, ground: Ground, pads_ned_m: Array, yaw_ned_rad: Array, step_s: float) -> None:
        """Stand the vehicles on the ground at the north and east of pads (V, 3), with yaw (V,)."""
        self._weight_N = q.weight_N
        self._ground = ground
        self._stepper = Stepper(q, step_s)
        self._step_s = step_s
        self._look_in_s = 0.0
        self._at_rest = np.array([[0.0], [0.0], [-q.gravity_mps2]])
        self.state = np.zeros((12, len(pads_ned_m)))
        self.state[:2] = pads_ned_m[:, :2].T
        self.state[2] = -ground(self.state[0], self.state[1])
        self.state[8] = yaw_ned_rad
        self.landed: Mask = np.ones(len(pads_ned_m), dtype=bool)
        self.any_landed = True
        self.specific_force_mps2 = np.tile(self._at_rest, len(pads_ned_m))

    def push(self, push_ned_mps2: Array | None) -> None:
        """Set the external accelerations (3, V) from now on; None for none."""
        self._stepper.push(push_ned_mps2)

    def step(self, control: Array, wind_ned_mps: Array) -> None:
        """Advance by one step under controls (4, V) and wind (3, V), both constant."""
        if self.any_landed:
            stays = self.landed & (control[0] <= self._weight_N)
            if stays.all():
                return
            moved, turn = self._stepper(self.state, control, wind_ned_mps)
            moved[:, stays] = self.state[:, stays]
            self.landed = stays
            self._look_in_s = 0.0
        else:
            moved, turn = self._stepper(self.state, control, wind_ned_mps)
        self.state = moved
        self.specific_force_mps2 = self._stepper.specific_force(moved, control, wind_ned_mps, turn)
        self._look_in_s -= self._step_s
        if self._look_in_s <= 0.0:
            self._touch_ground()
        if self.any_landed:
            self.specific_force_mps2[:, self.landed] = self._at_rest

    def _touch_ground(self) -> None:
        state = self.state
        ground_m = self._ground(state[0], state[1])
        clearance_m = -state[2] - ground_m
        touching = clearance_m <= 0.0
        if touching.any():
            state[2, touching] = -ground_m[touching]
            for part in (VELOCITY, slice(ATTITUDE.start, ATTITUDE.start + 2), RATES):
                state[part, touching] = 0.0
            self.landed = self.landed | touching
        self.any_landed = bool(self.landed.any())
        if self.any_landed:
            self._look_in_s = 0.0
        else:
            squared = np.add.reduce(state[3:6] ** 2)
            reached = np.sqrt(squared + (2.0 * _GAIN_MPS2 / _STEEPEST) * clearance_m)
            self._look_in_s = float((reached - np.sqrt(squared)).min()) / _GAIN_MPS2


class Motors:
    """The rotors of V vehicles of one type, without inertia: Eq. 2 with limits and weak motors; arrays are (4, V)."""

    def __init__(self, q: Quadrotor) -> None:
        self._q = q
        self._top = q.rotor_max_radps**2
        self._mix = control_from_rotors(np.eye(4), q).T  # squared speeds -> controls
        self._unmix = np.linalg.inv(self._mix)

    def speeds(self, wanted: Array) -> tuple[Array, Array, bool]:
        """Wanted controls (4, V) -> squared speeds and speeds (4, V), and whether they give the wanted controls.

        At a limit `gcs.physics.quadrotor.rotors_from_control` decides what is given up: yaw first.
        """
        squared = self._unmix.dot(wanted)
        if squared.min() >= 0.0 and squared.max() <= self._top:
            return squared, np.sqrt(squared), True
        speeds = rotors_from_control(wanted.T, self._q).T
        return speeds * speeds, speeds, False

    def control(self, squared: Array) -> Array:
        """Return the controls (4, V) of squared speeds (4, V), each times the remaining share of its motor's thrust."""
        return np.asarray(self._mix.dot(squared))
