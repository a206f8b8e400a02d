"""The integrator of Eq. 1, for a whole fleet at once.

Arrays have components first, (12, V). Each component is one contiguous row, so a step of six vehicles costs hardly
more than a step of one. Eq. 1 takes Euler rates for body rates, so it falls into three parts that need no general
integrator: rates, which depend on nothing else (Taylor); angles, which are integrals of the rates; and velocity,
a first-order lag on a direction of thrust that the angles give (exponential decay and two-point Gauss quadrature,
fourth order).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array

_NEXT, _AFTER = (1, 0, 0), (2, 2, 1)  # rows whose product couples into each rate
_GAUSS = (0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0))


class Turn(NamedTuple):
    """Sines and cosines of roll, pitch and yaw, each (..., V)."""

    sr: Array
    sp: Array
    sy: Array
    cr: Array
    cp: Array
    cy: Array

    @classmethod
    def of(cls, attitude_rad: Array) -> Turn:
        """Return the sines and cosines of roll, pitch and yaw (3, V)."""
        s, c = np.sin(attitude_rad), np.cos(attitude_rad)
        return cls(s[0], s[1], s[2], c[0], c[1], c[2])

    def thrust_axis(self) -> Array:
        """Return the body's down axis, along which the rotors blow, as a unit vector (3, V) in NED."""
        lean = self.sp * self.cr
        out = np.empty((3, *lean.shape))
        out[0] = self.cy * lean + self.sy * self.sr
        out[1] = self.sy * lean - self.cy * self.sr
        out[2] = self.cp * self.cr
        return out

    def to_ned(self, body: Array) -> Array:
        """Rotate vectors (3, V) from body axes (forward, right, down) to north, east, down."""
        x, y, z = body
        right, down = self.cr * y - self.sr * z, self.sr * y + self.cr * z
        ahead = self.cp * x + self.sp * down
        out = np.empty(body.shape)
        out[0] = self.cy * ahead - self.sy * right
        out[1] = self.sy * ahead + self.cy * right
        out[2] = self.cp * down - self.sp * x
        return out

    def to_body(self, ned: Array) -> Array:
        """The inverse of `to_ned`."""
        n, e, d = ned
        ahead, right = self.cy * n + self.sy * e, self.cy * e - self.sy * n
        down = self.sp * ahead + self.cp * d
        out = np.empty(ned.shape)
        out[0] = self.cp * ahead - self.sp * d
        out[1] = self.cr * right + self.sr * down
        out[2] = self.cr * down - self.sr * right
        return out


class Stepper:
    """Advances states by a fixed step under constant controls and wind.

    A wind array must not be changed after it was passed: the next wind is another array.
    """

    def __init__(self, q: Quadrotor, step_s: float) -> None:
        h = step_s
        ix, iy, iz = q.inertia_kgm2
        inertia = np.array([ix, iy, iz])
        self._mass_kg = q.mass_kg
        self._lever = (np.array([q.arm_m, q.arm_m, 1.0]) / inertia)[:, None]
        self._coupling = (np.array([iy - iz, iz - ix, ix - iy]) / inertia)[:, None]
        self._damping = (np.array(q.drag_moment_Nms) / inertia)[:, None]
        self._damping_out = -self._damping
        self._gravity = np.array([[0.0], [0.0], [q.gravity_mps2]])
        self._drag = (np.array(q.drag_Nspm) / q.mass_kg)[:, None]
        self._wind_ned_mps = self._steady = self._gravity  # of the last step; before the first one no valid wind
        self._push: Array | None = None
        # Rows: angles at the two Gauss points and at the end, rates at the end; columns: angles, rates and their
        # first three derivatives at the start.
        tau = np.array([_GAUSS[0] * h, _GAUSS[1] * h, h])
        powers = [tau**k / math.factorial(k) for k in range(5)]
        self._taylor = np.vstack([np.stack(powers, axis=1), [0.0, 1.0, h, h**2 / 2.0, h**3 / 6.0]])
        left = h - tau[:2, None, None]  # (2, 1, 1) until the end of the step
        self._decay, self._lag = _decay(self._drag, h), _lag(self._drag, h)
        # Share of an acceleration at each Gauss point in the velocity and in the position at the end.
        self._weights = 0.5 * h * np.stack([_decay(self._drag, left), _lag(self._drag, left)])  # (2, 2, 3, 1)

    def push(self, push_ned_mps2: Array | None) -> None:
        """Set the external accelerations (3, V) from now on; None for none."""
        self._push = push_ned_mps2
        self._wind_ned_mps = self._gravity

    def __call__(self, state: Array, control: Array, wind_ned_mps: Array) -> tuple[Array, Turn]:
        """State (12, V), control (4, V), wind (3, V) -> state at the end, and the rotation just before it."""
        vehicles = state.shape[1]
        stack = np.empty((5, 3, vehicles))
        stack[:2] = state[6:].reshape(2, 3, vehicles)
        rates = stack[1]
        near, far = rates.take(_NEXT, axis=0), rates.take(_AFTER, axis=0)
        first, second = stack[2], stack[3]
        first[:] = self._lever * control[1:] + self._coupling * (near * far) - self._damping * rates
        near_1, far_1 = first.take(_NEXT, axis=0), first.take(_AFTER, axis=0)
        second[:] = self._coupling * (near_1 * far + near * far_1) - self._damping * first
        np.multiply(self._damping_out, second, out=stack[4])  # the coupling's share is negligible here
        turned = self._taylor.dot(stack.reshape(5, 3 * vehicles)).reshape(4, 3, vehicles)

        s, c = np.sin(turned[:2]), np.cos(turned[:2])
        sr, sp, sy, cr, cp, cy = s[:, 0], s[:, 1], s[:, 2], c[:, 0], c[:, 1], c[:, 2]
        thrust = control[0] / -self._mass_kg
        lean = sp * cr
        pull = np.empty((2, 3, vehicles))
        pull[:, 0] = cy * lean + sy * sr
        pull[:, 1] = sy * lean - cy * sr
        pull[:, 2] = cp * cr
        pull *= thrust
        if wind_ned_mps is not self._wind_ned_mps:
            self._wind_ned_mps, self._steady = wind_ned_mps, self._gravity + self._drag * wind_ned_mps
            if self._push is not None:
                self._steady = self._steady + self._push
        pull += self._steady
        moved = np.add.reduce(self._weights * pull, axis=1)

        velocity = state[3:6]
        out = np.empty(state.shape)
        np.add(state[:3] + self._lag * velocity, moved[1], out=out[:3])
        np.add(self._decay * velocity, moved[0], out=out[3:6])
        out[6:] = turned[2:].reshape(6, vehicles)
        return out, Turn(sr[1], sp[1], sy[1], cr[1], cp[1], cy[1])

    def specific_force(self, state: Array, control: Array, wind_ned_mps: Array, turn: Turn) -> Array:
        """Return the specific force (3, V) in body axes, as an accelerometer senses it: thrust, drag and pushes."""
        pushed = self._drag * (wind_ned_mps - state[3:6])
        if self._push is not None:
            pushed += self._push
        force = turn.to_body(pushed)
        force[2] -= control[0] / self._mass_kg
        return force


def _decay(rate: Array, time_s: NDArray[np.float64] | float) -> Array:
    """Return the remaining share of a velocity."""
    return np.asarray(np.exp(-rate * time_s))


def _lag(rate: Array, time_s: NDArray[np.float64] | float) -> Array:
    """Return the distance that a decaying velocity covers: (1 - exp(-rate time)) / rate."""
    decay = rate * time_s
    safe = np.where(decay > 0.0, decay, 1.0)
    return np.asarray(time_s * np.where(decay > 0.0, -np.expm1(-safe) / safe, 1.0))
