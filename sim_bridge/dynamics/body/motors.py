"""Converts controls to rotor speeds and back: Eq. 2 with limits and weak motors."""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array, Quadrotor, control_from_rotors, rotors_from_control


class Motors:
    """The rotors of V vehicles of one type, without inertia; components first, (4, V)."""

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
