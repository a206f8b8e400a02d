"""What pushes and turns vehicles beyond what their rotors should: wind, a weak motor, a mass that is not as told.

Knows: Eq. 1 in still air, and how far velocity and rates run away from it. Does not know: where that comes from.

An observer per axis: motion' = Eq. 1 + push + l1 (seen - motion), push' = l2 (seen - motion). Its output, taken off the
wanted acceleration, is the integral action of the controller, in a form that cannot wind up: Eq. 1 is fed with the
controls that the rotors really got, at their limits too, so what a limit withholds is not mistaken for wind. And a
step of the reference leaves it alone.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.quadrotor import Array, Quadrotor
from sim_bridge.plant import Mask


class Disturbance:
    """`push` (6, V): accelerations beyond Eq. 1, north, east, down (m/s²) and about roll, pitch, yaw (rad/s²)."""

    def __init__(self, q: Quadrotor, bandwidth_radps: Array, largest: Array, period_s: float, vehicles: int) -> None:
        """Bandwidths and largest pushes (6,), to be observed every `period_s`."""
        ix, iy, iz = q.inertia_kgm2
        inertia = np.array([ix, iy, iz])
        self._period_s = period_s
        self._mass_kg = q.mass_kg
        self._drag = (np.concatenate([q.drag_Nspm, q.drag_moment_Nms]) / np.repeat([q.mass_kg, 1.0], 3))[:, None]
        self._drag[3:, 0] /= inertia
        self._lever = (np.array([q.arm_m, q.arm_m, 1.0]) / inertia)[:, None]
        self._gravity_mps2 = q.gravity_mps2
        keep = np.array([math.exp(-w * period_s) for w in bandwidth_radps])[:, None]
        self._follow, self._learn = 1.0 - keep**2, (1.0 - keep) ** 2 / period_s
        self._largest = largest[:, None]
        self._motion: Array | None = None
        self.push = np.zeros((6, vehicles))

    def observe(self, seen: Array, thrust_axis: Array, control: Array, coupling_radps2: Array) -> None:
        """Velocities and rates (6, V) now; since the last look: direction of thrust (3, V), controls (4, V), and what
        the rates do to each other (3, V)."""
        if self._motion is None:
            self._motion = seen
            return
        expected = self.push - self._drag * seen
        expected[:3] -= thrust_axis * (control[0] / self._mass_kg)
        expected[2] += self._gravity_mps2
        expected[3:] += self._lever * control[1:] + coupling_radps2
        expected *= self._period_s
        expected += self._motion
        off = seen - expected
        self._motion = expected + self._follow * off
        push = self.push + self._learn * off
        self.push = np.minimum(np.maximum(push, -self._largest), self._largest)

    def forget(self, which: Mask, seen: Array) -> None:
        """Begin anew for vehicles (V,) that stand."""
        if self._motion is not None:
            self._motion[:, which] = seen[:, which]
        self.push[:, which] = 0.0
