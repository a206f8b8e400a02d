"""From a reference and an estimate to U1..U4: Eq. 1 inverted forward, LQR feedback back.

Knows: flatness, and what to give up at a limit. Does not know: truth, sensors, who makes references.
Inverting Eq. 1 leaves chains of integrators: position, velocity, tilt and tilt rate along and across the
heading; height and climb; yaw and its rate. The horizontal gains act as a cascade whose stages are limited to
what the next can follow: near the reference the same linear law, far from it a stable one. There is no
integral action.
"""

from __future__ import annotations

import numpy as np

from gcs.quadrotor import Array, Quadrotor, thrust_and_tilt
from sim_bridge.gains import ANGLE_SCALE_RAD, ControlLimits, lqr_gains
from sim_bridge.plant import Mask
from sim_bridge.reference import Reference

IDLE_SHARE = 0.2  # of the weight: thrust while standing on the ground with motors on
FALL_SHARE = 0.5  # of the weight: thrust that even the fastest descent keeps, so that tilt still steers
HEIGHT_SHARE = 0.95  # of the spare thrust: what height may take; the rest always holds some tilt
HEIGHT_ERROR_MAX_M = 1.0
_DIFFERENCE_STEP_S = 0.02


def tilt_along(
    reference: Reference,
    acceleration_ned_mps2: Array,
    velocity_ned_mps: Array,
    yaw_ned_rad: Array,
    q: Quadrotor,
) -> Array:
    """Roll and pitch, their rates and accelerations (3, V, 2) that fly an acceleration and what follows it.

    Acceleration, velocity (V, 3) and yaw (V,) are those of now; jerk, snap and yaw rate of the reference lead
    on from there. Central differences: the flat map is smooth, and its second derivative a page of algebra.
    """
    h = _DIFFERENCE_STEP_S
    step = np.array([-h, 0.0, h])[:, None, None]
    jerk, snap = reference.jerk_ned_mps3, reference.snap_ned_mps4
    acceleration = acceleration_ned_mps2 + step * (jerk + 0.5 * step * snap)
    velocity = velocity_ned_mps + step * (acceleration_ned_mps2 + 0.5 * step * jerk)
    yaw = yaw_ned_rad + step[..., 0] * reference.yaw_rate_radps
    _, roll, pitch = thrust_and_tilt(acceleration, velocity, yaw, q)
    before, now, after = np.stack([roll, pitch], axis=-1)
    return np.array([now, (after - before) / (2.0 * h), (after - 2.0 * now + before) / (h * h)])


class Controller:
    """Tracks references with V vehicles of one type, from their estimates alone."""

    def __init__(self, q: Quadrotor, limits: ControlLimits) -> None:
        """Raise ValueError if the thrust limit does not lift the vehicle."""
        if limits.thrust_N <= q.weight_N:
            raise ValueError(f"thrust limit {limits.thrust_N:g} N does not lift a weight of {q.weight_N:g} N")
        self._q = q
        self._top = np.array([limits.thrust_N, *limits.torque])
        self._bottom = self._top * [0.0, -1.0, -1.0, -1.0]
        ix, iy, iz = q.inertia_kgm2
        self._inertia = np.array([ix, iy, iz])
        self._coupling = np.array([iy - iz, iz - ix, ix - iy])
        self._damping = np.array(q.drag_moment_Nms)
        self._arm = np.array([q.arm_m, q.arm_m, 1.0])
        self._gravity = np.array([0.0, 0.0, q.gravity_mps2])
        self._drag = np.array(q.drag_Nspm)
        self._force_up_max = q.weight_N + HEIGHT_SHARE * (limits.thrust_N - q.weight_N)

        gains = lqr_gains(q, limits)
        k_distance, k_speed, k_angle, k_rate = gains.tilt.T
        self._height, self._yaw = gains.height, gains.yaw
        self._angle_gain, self._rate_gain = k_angle / k_rate, k_rate
        # The same as a cascade; along the heading pitch steers, across it roll.
        self._closing_gain = (k_distance / k_speed)[::-1]
        self._push_gain = (q.gravity_mps2 * k_speed / k_angle)[::-1]
        turn_max = self._top[1:3] * q.arm_m / self._inertia[:2]
        self._rate_max = turn_max / k_rate
        self._push_max = float(np.min(q.gravity_mps2 * turn_max / k_angle))
        self._closing_max = self._push_max / float(np.max(self._push_gain))

    def command(self, reference: Reference, estimate: Array, landed: Mask) -> Array:
        """Controls (V, 4) for estimates (V, 12). A vehicle in contact idles until its reference rises."""
        velocity, attitude, rates = estimate[:, 3:6], estimate[:, 6:9], estimate[:, 9:12]
        force = self._wanted_force(reference, estimate)
        acceleration = self._gravity - (force + self._drag * velocity) / self._q.mass_kg
        tilt, tilt_rate, turn = tilt_along(reference, acceleration, velocity, attitude[:, 2], self._q)

        closing = self._angle_gain * (tilt - attitude[:, :2])
        closing = np.minimum(np.maximum(closing, -self._rate_max), self._rate_max)
        turn = turn + self._rate_gain * (tilt_rate + closing - rates[:, :2])
        yaw_error = np.remainder(reference.yaw_ned_rad - attitude[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        yaw_error = np.minimum(np.maximum(yaw_error, -ANGLE_SCALE_RAD), ANGLE_SCALE_RAD)
        spin = self._yaw[0] * yaw_error + self._yaw[1] * (reference.yaw_rate_radps - rates[:, 2])

        control = np.empty((len(estimate), 4))
        upright = np.cos(attitude[:, 0]) * np.cos(attitude[:, 1])
        control[:, 0] = force[:, 2] / np.maximum(upright, 0.5)
        control[:, 1:3], control[:, 3] = turn, spin
        products = rates[:, (1, 0, 0)] * rates[:, (2, 2, 1)]
        control[:, 1:] = (
            self._inertia * control[:, 1:] + self._damping * rates - self._coupling * products
        ) / self._arm
        control = np.minimum(np.maximum(control, self._bottom), self._top)
        idle = landed & (reference.velocity_ned_mps[:, 2] >= 0) & (reference.acceleration_ned_mps2[:, 2] >= 0)
        if idle.any():
            control[idle] = (IDLE_SHARE * self._q.weight_N, 0.0, 0.0, 0.0)
        return control

    def _wanted_force(self, reference: Reference, estimate: Array) -> Array:
        """Rotor force (V, 3), its third component upwards, within what the thrust can hold.

        Height comes before place: the horizontal part gets what the vertical part leaves.
        """
        distance = reference.position_ned_m - estimate[:, 0:3]
        speed = reference.velocity_ned_mps - estimate[:, 3:6]
        cos, sin = np.cos(estimate[:, 8]), np.sin(estimate[:, 8])
        closing = _shorten(self._closing_gain * _turned(distance, cos, -sin), self._closing_max)
        push = _shorten(self._push_gain * (closing + _turned(speed, cos, -sin)), self._push_max)
        wanted = reference.acceleration_ned_mps2.copy()
        wanted[:, :2] += _turned(push, cos, sin)
        climb = np.minimum(np.maximum(distance[:, 2], -HEIGHT_ERROR_MAX_M), HEIGHT_ERROR_MAX_M)
        wanted[:, 2] += self._height[0] * climb + self._height[1] * speed[:, 2]

        force = self._q.mass_kg * (self._gravity - wanted) - self._drag * estimate[:, 3:6]
        least = FALL_SHARE * self._q.weight_N
        force[:, 2] = np.minimum(np.maximum(force[:, 2], least), self._force_up_max)
        force[:, :2] = _shorten(force[:, :2], np.sqrt(self._top[0] ** 2 - force[:, 2] ** 2))
        return force


def _turned(vector: Array, cos: Array, sin: Array) -> Array:
    """Horizontal part (V, 2) of vectors (V, 2 or 3), turned by angles given as cos and sin (V,)."""
    north, east = vector[:, 0], vector[:, 1]
    return np.stack([cos * north - sin * east, sin * north + cos * east], axis=-1)


def _shorten(vector: Array, longest: Array | float) -> Array:
    """Vectors (V, 2), none longer than (V,) or one limit."""
    length = np.hypot(vector[:, 0], vector[:, 1])
    return np.asarray(vector * np.minimum(1.0, longest / np.maximum(length, 1e-12))[:, None])
