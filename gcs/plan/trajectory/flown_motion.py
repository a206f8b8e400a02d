"""The states and controls of Eq. 1 that fly a given motion, as polynomials."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor
from gcs.plan.formation.follower_equations import Jet, under_force, wind_jets
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array

_DEGREE = 9
_LOBATTO = 0.5 * (1.0 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE))  # both ends, so that pieces meet
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_LOBATTO))


@dataclass(frozen=True)
class MotionJets:
    """A motion at instants (...): SI and NED."""

    jets: tuple[
        Array, Array, Array, Array, Array
    ]  # (3, ...) place, velocity, acceleration, jerk, snap: without corners
    fall_mps2: Array  # (...) vertical acceleration, exact
    yaw: Jet  # rad, with two derivatives


def nodes(joints_s: Array) -> Array:
    """The instants (P, n) at which the polynomials between joints (P+1,) take their values."""
    return np.asarray(joints_s[:-1, None] + np.diff(joints_s)[:, None] * _LOBATTO)


def fitted(joints_s: Array, values: Array) -> Array:
    """The coefficients (n, P, C), highest power first, of polynomials with the values (P, n, C) at the nodes."""
    powers = np.diff(joints_s) ** np.arange(_DEGREE, -1.0, -1.0)[:, None]  # (n, P)
    return np.asarray(np.einsum("kn,pnc->kpc", _TO_COEFFICIENTS, values) / powers[..., None])


def flown(joints_s: Array, motion: Callable[[Array], MotionJets], q: Quadrotor) -> Trajectory:
    """The trajectory of a motion between joints (P+1,), where it may have corners; `motion` takes instants (P, n)."""
    t_s = nodes(joints_s)
    wanted = motion(t_s)
    place, velocity, acceleration, jerk, snap = wanted.jets
    wind = wind_jets(-place[2], -velocity[2], -acceleration[2], q)
    force = []
    for axis in range(3):
        m, k = q.mass_kg, q.drag_Nspm[axis]
        w0, w1, w2 = wind[axis]
        pull = q.gravity_mps2 if axis == 2 else 0.0
        force.append(
            (
                m * (pull - acceleration[axis]) - k * (velocity[axis] - w0),
                -m * jerk[axis] - k * (acceleration[axis] - w1),
                -m * snap[axis] - k * (jerk[axis] - w2),
            )
        )
    lift = q.mass_kg * (q.gravity_mps2 - wanted.fall_mps2) - q.drag_Nspm[2] * (velocity[2] - wind[2][0])
    state, control = under_force((*place, *velocity), (force[0], force[1], force[2]), lift, wanted.yaw, q)
    parts = (np.stack(np.broadcast_arrays(*part), axis=-1) for part in (state, control))
    return Trajectory(*(PPoly(fitted(joints_s, part), joints_s) for part in parts))


def values_at(coefficients: Array, left_s: Array) -> Array:
    """Values (P, n, C) of polynomials (K, P, C), each at times (P, n) from its begin."""
    value = np.zeros((*left_s.shape, coefficients.shape[2]))
    for row in coefficients:
        value = value * left_s[..., None] + row[:, None]
    return value
