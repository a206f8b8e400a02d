"""From a reference and an estimate to U1..U4: Eq. 1 inverted forward, LQR feedback back.

Knows: flatness, and what to give up at a limit. Does not know: truth, sensors, who makes references.
Inverting Eq. 1 leaves chains of integrators: position, velocity, tilt and tilt rate along and across the heading;
height and climb; yaw and its rate. The horizontal gains act as a cascade whose stages are limited to what the next can
follow: near the reference the same linear law, far from it a stable one. What pushes and turns the vehicle beyond
Eq. 1 is observed and taken off (`sim_bridge.disturbance`): that is the integral action.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.quadrotor import Array, Quadrotor
from sim_bridge.disturbance import Disturbance
from sim_bridge.gains import ANGLE_SCALE_RAD, ControlLimits, lqr_gains, turn_authority_radps2
from sim_bridge.motion import Turn
from sim_bridge.plant import Mask
from sim_bridge.reference import Reference

IDLE_SHARE = 0.2  # of the weight: thrust while standing on the ground with motors on
FALL_SHARE = 0.5  # of the weight: thrust that even the fastest descent keeps, so that tilt still steers
HEIGHT_SHARE = 0.95  # of the spare thrust: what height may take; the rest always holds some tilt
HEIGHT_ERROR_MAX_M = 1.0
_H = 0.02  # s: step of the central differences below
_NODES = np.array([[1.0, -_H, 0.5 * _H**2], [1.0, 0.0, 0.0], [1.0, _H, 0.5 * _H**2]])
_DIFFERENCES = np.array([[0.0, 1.0, 0.0], [-0.5 / _H, 0.0, 0.5 / _H], [_H**-2, -2.0 * _H**-2, _H**-2]])
_TIMES = np.array([[-_H], [0.0], [_H]])


def tilt_along(force: Array, yaw_ned_rad: Array, yaw_rate_radps: Array) -> Array:
    """Roll and pitch, their rates and accelerations (3, 2, V), that point the rotors along a force.

    The force (3, 3, V), with its first and second derivative, is what Eq. 1's translation leaves to the rotors: north
    and east components turned round, the third upwards. Central differences: the map from force to angles is smooth,
    and its second derivative a page of algebra.
    """
    vehicles = force.shape[-1]
    along = _NODES.dot(force.reshape(3, 3 * vehicles)).reshape(3, 3, vehicles)
    yaw = yaw_ned_rad + _TIMES * yaw_rate_radps
    s, c = np.sin(yaw), np.cos(yaw)
    north, east, up = along[:, 0], along[:, 1], along[:, 2]
    ahead = c * north + s * east
    tilt = np.empty((3, 2, vehicles))
    np.arctan2(s * north - c * east, np.hypot(ahead, up), out=tilt[:, 0])
    np.arctan2(ahead, up, out=tilt[:, 1])
    return np.asarray(_DIFFERENCES.dot(tilt.reshape(3, 2 * vehicles)).reshape(3, 2, vehicles))


class Controller:
    """Tracks references with V vehicles of one type, from their estimates alone.

    `speed_max_mps` (V,): what a slow vehicle makes of any reference; inf for the others.
    """

    def __init__(self, q: Quadrotor, limits: ControlLimits, vehicles: int, period_s: float) -> None:
        """Raise ValueError if the thrust limit does not lift the vehicle."""
        if limits.thrust_N <= q.weight_N:
            raise ValueError(f"thrust limit {limits.thrust_N:g} N does not lift a weight of {q.weight_N:g} N")
        self._q = q
        self._highest = np.array([limits.thrust_N, *limits.torque])[:, None]
        self._lowest = self._highest * [[0.0], [-1.0], [-1.0], [-1.0]]
        ix, iy, iz = q.inertia_kgm2
        inertia = np.array([[ix], [iy], [iz]])
        arm = np.array([[q.arm_m], [q.arm_m], [1.0]])
        self._coupling = np.array([[iy - iz], [iz - ix], [ix - iy]]) / inertia
        self._damping = np.array(q.drag_moment_Nms)[:, None] / inertia
        self._effort = inertia / arm
        self._gravity = np.array([[0.0], [0.0], [q.gravity_mps2]])
        self._drag = np.array(q.drag_Nspm)[:, None]
        self._lift_min = FALL_SHARE * q.weight_N
        self._lift_max = q.weight_N + HEIGHT_SHARE * (limits.thrust_N - q.weight_N)
        self._idle = np.array([[IDLE_SHARE * q.weight_N], [0.0], [0.0], [0.0]])

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

        self._disturbance = Disturbance(q, gains.push_radps, gains.push_max, period_s, vehicles)
        self.speed_max_mps = np.full(vehicles, math.inf)

    @property
    def push(self) -> Array:
        """What pushes and turns the vehicles beyond Eq. 1, as observed: (6, V), m/s² and rad/s²."""
        return self._disturbance.push

    def command(self, reference: Reference, state: Array, applied: Array, landed: Mask, *, any_landed: bool) -> Array:
        """Controls (4, V) for estimated states (12, V); `applied` (4, V) is what the rotors gave in the last step.

        A vehicle in contact idles until its reference rises.
        """
        attitude, rates = state[6:9], state[9:]
        turn = Turn.of(attitude)
        upright = turn.cr * turn.cp
        coupling = self._coupling * (rates.take((1, 0, 0), axis=0) * rates.take((2, 2, 1), axis=0))
        seen = np.concatenate((state[3:6], rates))
        self._disturbance.observe(seen, turn.thrust_axis(), applied, coupling)
        if any_landed:
            self._disturbance.forget(landed, seen)
        force = self._wanted_force(reference, state)
        lift = force[0, 2]
        tilt, tilt_rate, tilt_turn = tilt_along(force, attitude[2], reference.yaw_rate_radps)

        closing = _within(self._angle_gain * (tilt - attitude[:2]), self._rate_max)
        spin = np.empty(rates.shape)
        spin[:2] = tilt_turn + self._rate_gain * (tilt_rate + closing - rates[:2])
        off = _within(np.remainder(reference.yaw_ned_rad - attitude[2] + np.pi, 2.0 * np.pi) - np.pi, ANGLE_SCALE_RAD)
        spin[2] = self._yaw[0] * off + self._yaw[1] * (reference.yaw_rate_radps - rates[2])
        spin -= self._disturbance.push[3:]

        control = np.empty((4, len(upright)))
        control[0] = lift / np.maximum(upright, 0.5)
        control[1:] = self._effort * (spin + self._damping * rates - coupling)
        control = np.minimum(np.maximum(control, self._lowest), self._highest)
        if any_landed:
            rises = (reference.velocity_ned_mps[:, 2] < 0.0) | (reference.acceleration_ned_mps2[:, 2] < 0.0)
            control[:, landed & ~rises] = self._idle
        return np.asarray(control)

    def _wanted_force(self, reference: Reference, state: Array) -> Array:
        """Rotor force (3, 3, V) with its derivatives, as `tilt_along` takes it, within what the thrust can hold.

        Height comes before place: the horizontal part gets what the vertical part leaves.
        """
        velocity, push = state[3:6], self._disturbance.push
        distance = reference.position_ned_m.T - state[:3]
        acceleration = reference.acceleration_ned_mps2.T
        speed = reference.velocity_ned_mps.T - velocity
        asked = speed[:2] + _shorten(self._closing_gain * distance[:2], self._closing_max)
        if self.speed_max_mps.min() < math.inf:
            asked = _shorten(asked + velocity[:2], self.speed_max_mps) - velocity[:2]
        wanted = acceleration - push[:3]
        wanted[:2] += _shorten(self._push_gain * asked, self._push_max)
        wanted[2] += self._height[0] * _within(distance[2], HEIGHT_ERROR_MAX_M) + self._height[1] * speed[2]

        mass = self._q.mass_kg
        force = np.empty((3, *velocity.shape))
        force[0] = mass * (self._gravity - wanted) - self._drag * velocity
        lift = np.minimum(np.maximum(force[0, 2], self._lift_min), self._lift_max)
        force[0, 2] = lift
        force[0, :2] = _shorten(force[0, :2], np.sqrt(self._highest[0] ** 2 - lift * lift))
        force[1] = -mass * reference.jerk_ned_mps3.T - self._drag * acceleration
        force[2] = -mass * reference.snap_ned_mps4.T - self._drag * reference.jerk_ned_mps3.T
        return force


def _within(value: Array, largest: float) -> Array:
    """np.clip to ±largest, several times as fast on a handful of numbers."""
    return np.asarray(np.minimum(np.maximum(value, -largest), largest))


def _shorten(vector: Array, longest: Array | float) -> Array:
    """Vectors (2, V), none longer than (V,) or one limit."""
    length = np.hypot(vector[0], vector[1])
    return np.asarray(vector * np.minimum(1.0, longest / np.maximum(length, 1e-12)))
