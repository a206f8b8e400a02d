"""Take-off and landing phases: vertical climb, hover, vertical descent.

Their polynomials solve Eq. 1: exactly for a level vehicle, to a nanoradian for one that leans against the wind.
"""

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor, thrust_and_tilt
from gcs.physics.wind import STILL, SteadyWind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array

# From rest to rest, highest power first: s(r) = 10 r^3 - 15 r^4 + 6 r^5 has no acceleration at its ends, and
# 35 r^4 - 84 r^5 + 70 r^6 - 20 r^7 no jerk either, which is what attitude rates follow.
_QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
_SEPTIC = np.array([-20.0, 70.0, -84.0, 35.0, 0.0, 0.0, 0.0, 0.0])
_PIECES, _DEGREE = 8, 9  # of the attitude in wind


def vertical(
    start_s: float, end_s: float, position_ned_m: Array, end_down_m: float, yaw_ned_rad: float, quadrotor: Quadrotor
) -> Trajectory:
    """A vertical trajectory from rest at `position_ned_m` (3,) to rest at `end_down_m`, level unless there is wind.

    The quintic in z makes thrust a quintic too, m (g - z'') - K_3 z', so Eq. 1 holds exactly.
    """
    if not quadrotor.wind.is_still:
        return _leaning(start_s, end_s, position_ned_m, end_down_m, yaw_ned_rad, quadrotor)
    down = smooth_step(start_s, end_s, float(position_ned_m[2]), end_down_m, quadrotor.wind)
    joints = down.x
    state = np.zeros((6, 1, 12))
    state[-1, 0, :3] = position_ned_m
    state[-1, 0, 8] = yaw_ned_rad
    state[:, 0, 2] = down.c[:, 0]
    state[1:, 0, 5] = down.derivative().c[:, 0]
    control = np.zeros((6, 1, 4))
    control[2:, 0, 0] -= quadrotor.mass_kg * down.derivative(2).c[:, 0]
    control[1:, 0, 0] -= quadrotor.drag_Nspm[2] * down.derivative().c[:, 0]
    control[-1, 0, 0] += quadrotor.weight_N
    return Trajectory(PPoly(state, joints), PPoly(control, joints))


def smooth_step(start_s: float, end_s: float, start: float, end: float, wind: SteadyWind = STILL) -> PPoly:
    """The step from rest to rest: a C² quintic (peak speed 15/8 of the mean) in still air, a septic (35/16) in wind.

    `gcs.scenario.validation.boundaries` checks both against the limits.
    """
    shape = _QUINTIC if wind.is_still else _SEPTIC
    coefficients = shape * (end - start) / (end_s - start_s) ** np.arange(len(shape) - 1, -1, -1)
    coefficients[-1] += start
    return PPoly(coefficients[:, None], [start_s, end_s])


def _leaning(
    start_s: float, end_s: float, position_ned_m: Array, end_down_m: float, yaw_ned_rad: float, q: Quadrotor
) -> Trajectory:
    """The vertical trajectory in wind: tilt and thrust from Eq. 1, rates and moments from the tilt's polynomials."""
    down = smooth_step(start_s, end_s, float(position_ned_m[2]), end_down_m, q.wind)
    joints = np.linspace(start_s, end_s, _PIECES + 1)
    length = (end_s - start_s) / _PIECES
    lobatto = 0.5 * (1.0 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE))  # both ends, so that pieces meet
    t_s = joints[:-1, None] + length * lobatto
    speed, acceleration = down.derivative()(t_s), down.derivative(2)(t_s)
    air = -np.stack([np.broadcast_to(part, t_s.shape) for part in q.wind.at(-down(t_s))], axis=-1)
    air[..., 2] += speed
    push = np.stack([0.0 * t_s, 0.0 * t_s, acceleration], axis=-1)
    thrust, roll, pitch = thrust_and_tilt(push, air, np.full_like(t_s, yaw_ned_rad), q)
    # From values at the nodes to the coefficients of their polynomial, highest power first.
    basis = np.linalg.inv(np.vander(lobatto)) / length ** np.arange(_DEGREE, -1.0, -1.0)[:, None]
    tilt = PPoly(np.stack([basis @ roll.T, basis @ pitch.T], axis=-1), joints)
    state = np.zeros((_DEGREE + 1, _PIECES, 12))
    state[-1, :, :2] = position_ned_m[:2]
    state[-1, :, 8] = yaw_ned_rad
    state[-8:, :, 2] = _moved(down, joints)
    state[-7:, :, 5] = _moved(down.derivative(), joints)
    state[:, :, 6:8] = tilt.c
    state[1:, :, 9:11] = tilt.derivative().c
    rates, angular = tilt.derivative()(t_s), tilt.derivative(2)(t_s)
    ix, iy, _ = q.inertia_kgm2
    moments = np.stack(
        [
            (ix * angular[..., 0] + q.drag_moment_Nms[0] * rates[..., 0]) / q.arm_m,
            (iy * angular[..., 1] + q.drag_moment_Nms[1] * rates[..., 1]) / q.arm_m,
            -rates[..., 0] * rates[..., 1] * (ix - iy),
        ],
        axis=-1,
    )
    values = np.concatenate([thrust[..., None], moments], axis=-1)
    control = np.einsum("kn,pnc->kpc", basis, values)
    return Trajectory(PPoly(state, joints), PPoly(control, joints))


def _moved(polynomial: PPoly, joints: Array) -> Array:
    """Coefficients (K+1, M) of one polynomial on the pieces between joints."""
    order = polynomial.c.shape[0] - 1
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1.0, order + 1.0)]))
    return np.stack([polynomial(joints[:-1], nu=k) / factorials[k] for k in range(order, -1, -1)])
