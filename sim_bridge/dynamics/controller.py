"""The controller: from a reference and an estimate to U1..U4, with Eq. 1 inverted as feedforward and LQR feedback.

A reference (V, 5, 4) is north, east, down (m, common local NED) and yaw (rad) of every vehicle, with their derivatives
up to snap. A quadrotor is differentially flat in these: attitude, rates and controls follow from them by Eq. 1.

Inverting Eq. 1 leaves chains of integrators: position, velocity, tilt and tilt rate along and across the heading;
height and climb; yaw and its rate. `sim_bridge.dynamics.position_control` gives the wanted force; here it
becomes a tilt, and the tilt a torque. `sim_bridge.dynamics.controller` estimates disturbances beyond
Eq. 1, and the controller compensates them: that is the integral action. The limits apply to what acts on the body; the
lost thrust of a weak motor is added on top.
"""

import math

import numpy as np

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array
from sim_bridge.dynamics.integrator import Turn
from sim_bridge.dynamics.lqr_gains import ANGLE_SCALE_RAD, ControlLimits, lqr_gains, turn_authority_radps2
from sim_bridge.dynamics.plant import Mask
from sim_bridge.dynamics.position_control import AROUND, AROUND_S, PositionController

IDLE_SHARE = 0.2  # of the weight: thrust while standing on the ground with motors on

_MOMENTS = AROUND[:, None]
# From three values AROUND_S apart: the middle one, its first and its second derivative.
_DIFFERENCES = np.array([[0.0, 1.0, 0.0], [-0.5, 0.0, 0.5], [1.0, -2.0, 1.0]]) / AROUND_S ** np.arange(3)[:, None]
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


def tilt_along(force: Array, yaw_ned_rad: Array, yaw_rate_radps: Array) -> Array:
    """Return roll and pitch, their rates and accelerations (3, 2, V), that point the rotors along a force.

    The force (3, 3, V), at the times AROUND now, is what Eq. 1's translation requires of the rotors: north and east
    components negated, the third upwards. Central differences are used: the map from force to angles is smooth, and its
    second derivative is a page of algebra.
    """
    vehicles = force.shape[-1]
    yaw = yaw_ned_rad + _MOMENTS * yaw_rate_radps
    s, c = np.sin(yaw), np.cos(yaw)
    north, east, up = force[:, 0], force[:, 1], force[:, 2]
    ahead = c * north + s * east
    tilt = np.empty((3, 2, vehicles))
    np.arctan2(s * north - c * east, np.hypot(ahead, up), out=tilt[:, 0])
    np.arctan2(ahead, up, out=tilt[:, 1])
    return np.asarray(_DIFFERENCES.dot(tilt.reshape(3, 2 * vehicles)).reshape(3, 2, vehicles))


class Controller:
    """Tracks references with V vehicles of one type, from their estimates alone."""

    def __init__(self, q: Quadrotor, limits: ControlLimits, vehicles: int, period_s: float) -> None:
        """Raise ValueError if the thrust limit does not lift the vehicle."""
        self._law = PositionController(q, limits)
        self._highest = np.array([limits.thrust_N, *limits.torque])[:, None]
        self._lowest = self._highest * [[0.0], [-1.0], [-1.0], [-1.0]]
        ix, iy, iz = q.inertia_kgm2
        inertia = np.array([ix, iy, iz])
        self._coupling = np.array([[iy - iz], [iz - ix], [ix - iy]]) / inertia[:, None]
        self._idle = np.array([[IDLE_SHARE * q.weight_N], [0.0], [0.0], [0.0]])
        gains = lqr_gains(q, limits)
        _, _, k_angle, k_rate = (float(k) for k in gains.tilt)
        self._angle_gain = k_angle / k_rate
        self._rate_max = float(turn_authority_radps2(q, limits)[0]) / k_rate
        self._effort = inertia[:, None] / np.array([[q.arm_m], [q.arm_m], [1.0]])
        self._torque = self._effort * _turning(k_rate, gains.yaw, np.array(q.drag_moment_Nms) / inertia)
        self._disturbance = DisturbanceObserver(q, gains.push_radps, gains.push_max, period_s, vehicles)

    @property
    def push(self) -> Array:
        """The observed disturbance beyond Eq. 1: (6, V), m/s² and rad/s²."""
        return self._disturbance.push

    def slow_down(self, speed_max_mps: Array) -> None:
        """Limit the ground speed of vehicles (V,), whatever is commanded; inf for no limit."""
        self._law.slow_down(speed_max_mps if speed_max_mps.min() < math.inf else None)

    def command(self, reference: Array, state: Array, applied: Array, landed: Mask, *, any_landed: bool) -> Array:
        """Return the controls (4, V) for a reference (V, 5, 4) and estimated states (12, V).

        `applied` (4, V) is what the rotors produced in the last step. A vehicle in contact idles until its reference
        rises.
        """
        if reference.shape != (state.shape[1], 5, 4):
            raise ValueError(f"the reference must have shape {(state.shape[1], 5, 4)}, has {reference.shape}")
        attitude, rates = state[6:9], state[9:]
        turn = Turn.of(attitude)
        upright = turn.cr * turn.cp
        coupling = self._coupling * (rates.take((1, 0, 0), axis=0) * rates.take((2, 2, 1), axis=0))
        seen = np.concatenate((state[3:6], rates))
        self._disturbance.observe(seen, turn.thrust_axis() * applied[0], applied[1:], coupling)
        if any_landed:
            self._disturbance.forget(landed, seen)
        push = self._disturbance.push
        yaw_rad, yaw_rate_radps = reference[:, 0, 3], reference[:, 1, 3]
        force = self._law(reference, state, push[:3])
        tilt = tilt_along(force, attitude[2], yaw_rate_radps)

        closing = _within(self._angle_gain * (tilt[0] - attitude[:2]), self._rate_max)
        off = _within(np.remainder(yaw_rad - attitude[2] + np.pi, 2.0 * np.pi) - np.pi, ANGLE_SCALE_RAD)
        inputs = (closing, tilt[1], tilt[2], off[None], yaw_rate_radps[None], rates, coupling)
        control = np.empty((4, len(upright)))
        control[0] = force[1, 2] / np.maximum(upright, 0.5)
        self._torque.dot(np.concatenate(inputs), out=control[1:])
        control = np.minimum(np.maximum(control, self._lowest), self._highest)
        control[1:] -= self._effort * push[3:]
        if any_landed:
            rises = (reference[:, 1, 2] < 0.0) | (reference[:, 2, 2] < 0.0)
            control[:, landed & ~rises] = self._idle
        return np.asarray(control)


def _turning(k_rate: float, k_yaw: Array, damping: Array) -> Array:
    """Return the angular acceleration (3, 14) that Eq. 1 needs, per input that `Controller.command` combines.

    Inputs: closing rates, tilt rates, tilt accelerations (2 each); yaw error, yaw rate; rates, coupling (3 each).
    """
    level = np.eye(3, 2)
    yaw = np.array([[0.0, 0.0], [0.0, 0.0], k_yaw])
    follow = np.diag([k_rate, k_rate, k_yaw[1]])
    return np.hstack([k_rate * level, k_rate * level, level, yaw, np.diag(damping) - follow, -np.eye(3)])


def _within(value: Array, largest: float) -> Array:
    """Limit to ±largest; several times as fast as np.clip on a few numbers."""
    return np.asarray(np.minimum(np.maximum(value, -largest), largest))


class DisturbanceObserver:
    """External forces and torques, such as wind, a weak motor or a wrong mass.

    An observer per axis: motion' = Eq. 1 + push + l1 (seen - motion), push' = l2 (seen - motion). Its output is
    subtracted from the wanted acceleration: the integral action of the controller, in a form that cannot wind up. Eq. 1
    gets the controls that the rotors really produced, also at their limits, so a limit is not mistaken for wind. A step
    of the reference does not disturb it. All of it is linear: one matrix per step.

    `push` (6, V): accelerations beyond Eq. 1, north, east, down (m/s²) and about roll, pitch, yaw (rad/s²).
    """

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
