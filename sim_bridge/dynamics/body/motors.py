"""From wanted controls to rotors and back: Eq. 2 with limits and with motors that give less than they should.

Knows: the mixer, as one matrix product where nothing is at a limit. Does not know: who wants what, and why.
"""

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
        """Wanted controls (4, V) -> squared speeds and speeds (4, V), and whether all of it can be had.

        What cannot be had is given up as `gcs.physics.quadrotor.rotors_from_control` has it: yaw first.
        """
        squared = self._unmix.dot(wanted)
        if squared.min() >= 0.0 and squared.max() <= self._top:
            return squared, np.sqrt(squared), True
        speeds = rotors_from_control(wanted.T, self._q).T
        return speeds * speeds, speeds, False

    def control(self, squared: Array) -> Array:
        """What squared speeds (4, V) give, times the share of thrust each motor has left: controls (4, V)."""
        return np.asarray(self._mix.dot(squared))
