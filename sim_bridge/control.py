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
from sim_bridge.gains import ANGLE_SCALE_RAD, ControlLimits, lqr_gains, turn_authority_radps2
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
    tilt = np.empty((*yaw.shape, 2))
    _, tilt[..., 0], tilt[..., 1] = thrust_and_tilt(acceleration, velocity, yaw, q)
    before, now, after = tilt
    return np.array([now, (after - before) / (2.0 * h), (after - 2.0 * now + before) / (h * h)])


class Controller:
    """Tracks references with V vehicles of one type, from their estimates alone."""

    def __init__(self, q: Quadrotor, limits: ControlLimits) -> None:
        """Raise ValueError if the thrust limit does not lift the vehicle."""
        if limits.thrust_N <= q.weight_N:
            raise ValueError(f"thrust limit {limits.thrust_N:g} N does not lift a weight of {q.weight_N:g} N")
        self._q = q
        self._highest = np.array([limits.thrust_N, *limits.torque])
        self._lowest = self._highest * [0.0, -1.0, -1.0, -1.0]
        ix, iy, iz = q.inertia_kgm2
        self._inertia = np.array([ix, iy, iz])
        self._coupling = np.array([iy - iz, iz - ix, ix - iy])
        self._damping = np.array(q.drag_moment_Nms)
        self._arm = np.array([q.arm_m, q.arm_m, 1.0])
        self._gravity = np.array([0.0, 0.0, q.gravity_mps2])
        self._drag = np.array(q.drag_Nspm)
        self._lift_max = q.weight_N + HEIGHT_SHARE * (limits.thrust_N - q.weight_N)

        gains = lqr_gains(q, limits)
        turn_max = float(turn_authority_radps2(q, limits)[0])
        k_distance, k_speed, k_angle, k_rate = (float(k) for k in gains.tilt)
        # The chain as a cascade. Each stage alone may ask for all the turning there is, and no more.
        self._closing_gain, self._push_gain = k_distance / k_speed, q.gravity_mps2 * k_speed / k_angle
        self._angle_gain, self._rate_gain = k_angle / k_rate, k_rate
        self._rate_max = turn_max / k_rate
        self._push_max = q.gravity_mps2 * turn_max / k_angle
        self._closing_max = turn_max / k_speed
        self._height, self._yaw = gains.height, gains.yaw

    def command(self, reference: Reference, estimate: Array, landed: Mask) -> Array:
        """Controls (V, 4) for estimates (V, 12). A vehicle in contact idles until its reference rises."""
        velocity, attitude, rates = estimate[:, 3:6], estimate[:, 6:9], estimate[:, 9:12]
        yaw = attitude[:, 2]
        force = self._wanted_force(reference, estimate)
        acceleration = self._gravity - (force + self._drag * velocity) / self._q.mass_kg
        tilt, tilt_rate, tilt_turn = tilt_along(reference, acceleration, velocity, yaw, self._q)

        turn = np.empty_like(rates)
        closing = _within(self._angle_gain * (tilt - attitude[:, :2]), self._rate_max)
        turn[:, :2] = tilt_turn + self._rate_gain * (tilt_rate + closing - rates[:, :2])
        off = _within(np.remainder(reference.yaw_ned_rad - yaw + np.pi, 2.0 * np.pi) - np.pi, ANGLE_SCALE_RAD)
        turn[:, 2] = self._yaw[0] * off + self._yaw[1] * (reference.yaw_rate_radps - rates[:, 2])

        control = np.empty((len(estimate), 4))
        upright = np.cos(attitude[:, 0]) * np.cos(attitude[:, 1])
        control[:, 0] = force[:, 2] / np.maximum(upright, 0.5)
        products = rates.take((1, 0, 0), axis=1) * rates.take((2, 2, 1), axis=1)
        control[:, 1:] = (self._inertia * turn + self._damping * rates - self._coupling * products) / self._arm
        control = np.minimum(np.maximum(control, self._lowest), self._highest)
        if landed.any():
            rises = (reference.velocity_ned_mps[:, 2] < 0.0) | (reference.acceleration_ned_mps2[:, 2] < 0.0)
            control[landed & ~rises] = (IDLE_SHARE * self._q.weight_N, 0.0, 0.0, 0.0)
        return np.asarray(control)

    def _wanted_force(self, reference: Reference, estimate: Array) -> Array:
        """Rotor force (V, 3), its third component upwards, within what the thrust can hold.

        Height comes before place: the horizontal part gets what the vertical part leaves.
        """
        velocity = estimate[:, 3:6]
        distance = reference.position_ned_m - estimate[:, 0:3]
        speed = reference.velocity_ned_mps - velocity
        closing = _shorten(self._closing_gain * distance[:, :2], self._closing_max)
        wanted = reference.acceleration_ned_mps2.copy()
        wanted[:, :2] += _shorten(self._push_gain * (closing + speed[:, :2]), self._push_max)
        climb = _within(distance[:, 2], HEIGHT_ERROR_MAX_M)
        wanted[:, 2] += self._height[0] * climb + self._height[1] * speed[:, 2]

        force = self._q.mass_kg * (self._gravity - wanted) - self._drag * velocity
        lift = np.minimum(np.maximum(force[:, 2], FALL_SHARE * self._q.weight_N), self._lift_max)
        force[:, 2] = lift
        force[:, :2] = _shorten(force[:, :2], np.sqrt(self._highest[0] ** 2 - lift * lift))
        return np.asarray(force)


def _within(value: Array, largest: float) -> Array:
    """np.clip to ±largest, several times as fast on a handful of numbers."""
    return np.asarray(np.minimum(np.maximum(value, -largest), largest))


def _shorten(vector: Array, longest: Array | float) -> Array:
    """Vectors (V, 2), none longer than (V,) or one limit."""
    length = np.hypot(vector[:, 0], vector[:, 1])
    return np.asarray(vector * np.minimum(1.0, longest / np.maximum(length, 1e-12))[:, None])
