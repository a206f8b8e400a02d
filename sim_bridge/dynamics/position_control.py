"""The position controller: the wanted rotor force from the position error, by cascaded LQR gains.

The LQR gains act as a cascade. Each stage is limited to what the next can follow: near the reference this is the same
linear law, far from it a stable one. Where no stage is at a limit, nearly always, the law is one matrix, obtained by
probing the limited law.
"""

import math

import numpy as np

from gcs.physics.quadrotor import Quadrotor
from gcs.types import Array
from sim_bridge.dynamics.lqr_gains import ControlLimits, lqr_gains, turn_authority_radps2

FALL_SHARE = 0.5  # of the weight: minimum thrust in a descent, so that tilt still has authority
HEIGHT_SHARE = 0.95  # of the spare thrust: the share available to height; the remainder is for tilt
HEIGHT_ERROR_MAX_M = 1.0
AROUND_S = 0.02  # time step of the differences
AROUND = np.array([-AROUND_S, 0.0, AROUND_S])

_CARRY = np.stack([np.ones(3), AROUND, 0.5 * AROUND**2], axis=1)  # a value and two derivatives to three times
_INPUTS = 24
_CHECKED = np.array([9, 10, 11, 12, 13, 3, 4, 5])  # rows of the law with limits: the stages, and the force now
_PROBE = 1e-3


class PositionController:
    """For vehicles of one type."""

    def __init__(self, q: Quadrotor, limits: ControlLimits) -> None:
        """Raise ValueError if the thrust limit does not lift the vehicle."""
        if limits.thrust_N <= q.weight_N:
            raise ValueError(f"thrust limit {limits.thrust_N:g} N does not lift a weight of {q.weight_N:g} N")
        gains = lqr_gains(q, limits)
        turn_max = float(turn_authority_radps2(q, limits)[0])
        k_distance, k_speed, k_angle, _ = (float(k) for k in gains.tilt)
        self._mass_kg = q.mass_kg
        self._weight = np.array([[0.0], [0.0], [q.weight_N]])
        self._drag = np.array(q.drag_Nspm)[:, None]
        self._closing_gain, self._push_gain = k_distance / k_speed, q.gravity_mps2 * k_speed / k_angle
        # Each stage alone may demand the whole turn authority, and no more.
        self._closing_max, self._push_max = turn_max / k_speed, q.gravity_mps2 * turn_max / k_angle
        self._height_gain, self._climb_gain = (float(k) for k in gains.height)
        self._thrust_max = limits.thrust_N
        self._lift_min = FALL_SHARE * q.weight_N
        self._lift_max = q.weight_N + HEIGHT_SHARE * (limits.thrust_N - q.weight_N)
        self._speed_max_mps: Array | None = None

        probes = np.concatenate((np.zeros((_INPUTS, 1)), _PROBE * np.eye(_INPUTS)), axis=1)
        force, checks = self._limited(probes)
        at_rest, slopes = np.split(np.concatenate((force.reshape(9, -1), checks)), [1], axis=1)
        law = np.concatenate(((slopes - at_rest) / _PROBE, at_rest), axis=1)
        law[:9] = np.kron(_CARRY, np.eye(3)) @ law[:9]
        self._law = law
        # Inside the box without limits: less lift, more horizontal force.
        lift_max = 0.5 * (q.weight_N + self._lift_max)
        level_max = math.sqrt((limits.thrust_N**2 - lift_max**2) / 2.0)
        longest = math.sqrt(0.5) * np.array([self._closing_max] * 2 + [self._push_max] * 2)
        high = np.array([*longest, HEIGHT_ERROR_MAX_M, level_max, level_max, lift_max])
        low = -high
        low[-1] = self._lift_min
        self._free_low, self._free_high = low[:, None], high[:, None]

    def slow_down(self, speed_max_mps: Array | None) -> None:
        """Limit the ground speed of vehicles (V,); None for no limit."""
        self._speed_max_mps = speed_max_mps

    def __call__(self, reference: Array, state: Array, push_mps2: Array) -> Array:
        """Return the force (3, 3, V) at the times AROUND now, north and east negated, the third component upwards.

        `reference` (V, 5, 4); `state` (12, V); `push_mps2` (3, V) are the disturbances beyond Eq. 1, compensated here.
        """
        vehicles = state.shape[1]
        wanted = reference[:, :, :3].transpose(1, 2, 0).reshape(15, vehicles)
        inputs = np.concatenate((wanted, state[:6], push_mps2, np.ones((1, vehicles))))
        if self._speed_max_mps is None:
            out = self._law.dot(inputs)
            checked = out.take(_CHECKED, axis=0)
            if ((checked >= self._free_low) & (checked <= self._free_high)).all():
                return np.asarray(out[:9].reshape(3, 3, -1))
        force, _ = self._limited(inputs)
        return np.asarray(_CARRY.dot(force.reshape(3, -1)).reshape(force.shape))

    def _limited(self, inputs: Array) -> tuple[Array, Array]:
        """Return the force with two derivatives (3, 3, V), and what the stages demand before limits (5, V).

        Height has priority: the horizontal part gets what the vertical part leaves.
        """
        place, velocity, acceleration, jerk, snap, here, moving, push = inputs[:_INPUTS].reshape(8, 3, -1)
        distance, speed = place - here, velocity - moving
        closing = self._closing_gain * distance[:2]
        demand = speed[:2] + _shorten(closing, self._closing_max)
        wanted = acceleration - push
        if self._speed_max_mps is not None:
            aim = demand + moving[:2]
            slow = _shorten(aim, self._speed_max_mps)
            demand = slow - moving[:2]
            wanted[:2] = np.where((slow == aim).all(axis=0), wanted[:2], -push[:2])
        demand *= self._push_gain
        wanted[:2] += _shorten(demand, self._push_max)
        wanted[2] += self._height_gain * np.clip(distance[2], -HEIGHT_ERROR_MAX_M, HEIGHT_ERROR_MAX_M)
        wanted[2] += self._climb_gain * speed[2]

        force = np.empty((3, *place.shape))
        force[0] = self._weight - self._mass_kg * wanted - self._drag * moving
        force[0, 2] = lift = np.clip(force[0, 2], self._lift_min, self._lift_max)
        force[0, :2] = _shorten(force[0, :2], np.sqrt(self._thrust_max**2 - lift * lift))
        force[1] = -self._mass_kg * jerk - self._drag * acceleration
        force[2] = -self._mass_kg * snap - self._drag * jerk
        return force, np.concatenate((closing, demand, distance[2:]))


def _shorten(vector: Array, longest: Array | float) -> Array:
    """Return the vectors (2, V), shortened to at most one limit or (V,) limits."""
    length = np.hypot(vector[0], vector[1])
    return np.asarray(vector * np.minimum(1.0, longest / np.maximum(length, 1e-12)))
