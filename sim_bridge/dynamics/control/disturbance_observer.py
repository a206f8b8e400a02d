"""Disturbance observer: external forces and torques, such as wind, a weak motor or a wrong mass.

An observer per axis: motion' = Eq. 1 + push + l1 (seen - motion), push' = l2 (seen - motion). Its output is subtracted
from the wanted acceleration: the integral action of the controller, in a form that cannot wind up. Eq. 1 gets the
controls that the rotors really produced, also at their limits, so a limit is not mistaken for wind. A step of the
reference does not disturb it. All of it is linear: one matrix per step.
"""

from __future__ import annotations

import numpy as np

from gcs.physics.quadrotor import Array, Quadrotor
from sim_bridge.dynamics.body.plant import Mask

_AXES = 6
_SEEN, _PUSH, _MOTION, _THRUST, _TORQUE, _COUPLING, _ONE = (
    slice(0, 6),
    slice(6, 12),
    slice(12, 18),
    slice(18, 21),
    slice(21, 24),
    slice(24, 27),
    slice(27, 28),
)
_INPUTS = 28


class DisturbanceObserver:
    """`push` (6, V): accelerations beyond Eq. 1, north, east, down (m/s²) and about roll, pitch, yaw (rad/s²)."""

    def __init__(self, q: Quadrotor, bandwidth_radps: Array, largest: Array, period_s: float, vehicles: int) -> None:
        """`bandwidth_radps` and `largest` push are (6,); `observe` is called every `period_s`."""
        inertia = np.array(q.inertia_kgm2)
        drag = np.concatenate([np.array(q.drag_Nspm) / q.mass_kg, np.array(q.drag_moment_Nms) / inertia])
        expected = np.zeros((_AXES, _INPUTS))
        expected[:, _SEEN] = -np.diag(drag)
        expected[:, _PUSH] = np.eye(_AXES)
        expected[:3, _THRUST] = -np.eye(3) / q.mass_kg
        expected[3:, _TORQUE] = np.diag(np.array([q.arm_m, q.arm_m, 1.0]) / inertia)
        expected[3:, _COUPLING] = np.eye(3)
        expected[2, _ONE] = q.gravity_mps2
        expected *= period_s
        expected[:, _MOTION] = np.eye(_AXES)
        off = -expected
        off[:, _SEEN] += np.eye(_AXES)
        keep = np.exp(-bandwidth_radps * period_s)[:, None]
        learnt = (1.0 - keep) ** 2 / period_s * off
        learnt[:, _PUSH] += np.eye(_AXES)
        self._law = np.vstack([learnt, expected + (1.0 - keep**2) * off])  # to push and motion
        self._largest = largest[:, None]
        self._lowest = -self._largest
        self._ones = np.ones((1, vehicles))
        self._motion: Array | None = None
        self.push = np.zeros((_AXES, vehicles))

    def observe(self, seen: Array, thrust_N: Array, torque: Array, coupling_radps2: Array) -> None:
        """Update `push` from velocities and rates (6, V) now.

        The other inputs are since the last call: thrust (3, V) along the rotor axis in NED, the other controls (3, V),
        and the coupling of the rates (3, V).
        """
        if self._motion is None:
            self._motion = seen
            return
        inputs = np.concatenate((seen, self.push, self._motion, thrust_N, torque, coupling_radps2, self._ones))
        push, self._motion = self._law.dot(inputs).reshape(2, *seen.shape)
        self.push = np.minimum(np.maximum(push, self._lowest), self._largest)

    def forget(self, which: Mask, seen: Array) -> None:
        """Restart the observer for vehicles (V,) that stand."""
        if self._motion is not None:
            self._motion[:, which] = seen[:, which]
        self.push[:, which] = 0.0
