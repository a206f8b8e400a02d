"""Take-off and landing phases: vertical climb, hover, vertical descent.

Their polynomials solve Eq. 1: exactly for a level vehicle, to a nanoradian for one that leans against the wind.
"""

from itertools import pairwise

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor, thrust_and_tilt
from gcs.physics.wind import STILL, SteadyWind
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.own_landing import own_landing
from gcs.scenario.values.si import leader_index, steady_wind
from gcs.types import Array

# From rest to rest, highest power first: s(r) = 10 r^3 - 15 r^4 + 6 r^5 has no acceleration at its ends, and
# 35 r^4 - 84 r^5 + 70 r^6 - 20 r^7 no jerk either, which is what attitude rates follow.
_QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
_SEPTIC = np.array([-20.0, 70.0, -84.0, 35.0, 0.0, 0.0, 0.0, 0.0])
# Of the attitude in wind: pieces of the whole, and at least of each polynomial in z
_PIECES, _PIECES_LEAST, _DEGREE = 8, 3, 9


def vertical(
    start_s: float, end_s: float, position_ned_m: Array, end_down_m: float, yaw_ned_rad: float, quadrotor: Quadrotor
) -> Trajectory:
    """A vertical trajectory from rest at `position_ned_m` (3,) to rest at `end_down_m`, level unless there is wind."""
    down = smooth_step(start_s, end_s, float(position_ned_m[2]), end_down_m, quadrotor.wind)
    return straight_down(down, position_ned_m, yaw_ned_rad, quadrotor)


def straight_down(down_m: PPoly, position_ned_m: Array, yaw_ned_rad: float, quadrotor: Quadrotor) -> Trajectory:
    """The vertical trajectory with these heights, from and to rest; north and east are those of `position_ned_m` (3,).

    A polynomial in z makes thrust one too, m (g - z'') - K_3 z', so Eq. 1 holds exactly in still air.
    """
    if not quadrotor.wind.is_still:
        return _leaning(down_m, position_ned_m, yaw_ned_rad, quadrotor)
    joints, (terms, pieces) = down_m.x, down_m.c.shape
    state = np.zeros((terms, pieces, 12))
    state[-1, :, :2] = position_ned_m[:2]
    state[-1, :, 8] = yaw_ned_rad
    state[:, :, 2] = down_m.c
    state[1:, :, 5] = down_m.derivative().c
    control = np.zeros((terms, pieces, 4))
    control[2:, :, 0] -= quadrotor.mass_kg * down_m.derivative(2).c
    control[1:, :, 0] -= quadrotor.drag_Nspm[2] * down_m.derivative().c
    control[-1, :, 0] += quadrotor.weight_N
    return Trajectory(PPoly(state, joints), PPoly(control, joints))


def landing_step(start_s: float, end_s: float, start: float, end: float, scenario: Scenario) -> PPoly:
    """The step from rest to rest of a scenario's landing: with the speeds of its autopilot, or a smooth one.

    Its speed is a septic wherever it changes, so controls have no jumps, in wind neither.
    """
    ramps = own_landing(scenario)
    if not ramps:
        return smooth_step(start_s, end_s, start, end, steady_wind(scenario))
    stretch = (end_s - start_s) / sum(ramp.duration_s for ramp in ramps)
    per_m = (end - start) / sum(ramp.drop_m for ramp in ramps)
    joints = start_s + stretch * np.cumsum([0.0, *(ramp.duration_s for ramp in ramps)])
    joints[-1] = end_s
    coefficients = np.zeros((len(_SEPTIC) + 1, len(ramps)))
    value = start
    for n, ramp in enumerate(ramps):
        span_s = joints[n + 1] - joints[n]
        speed = (ramp.to_mps - ramp.from_mps) * _SEPTIC
        speed[-1] += ramp.from_mps
        unit = np.polyint(speed) * per_m * span_s / stretch  # over 0 to 1
        coefficients[:, n] = unit / span_s ** np.arange(len(unit) - 1.0, -1.0, -1.0)
        coefficients[-1, n] = value
        value += float(unit.sum())
    return PPoly(coefficients, joints)


def smooth_step(start_s: float, end_s: float, start: float, end: float, wind: SteadyWind = STILL) -> PPoly:
    """The step from rest to rest: a C² quintic (peak speed 15/8 of the mean) in still air, a septic (35/16) in wind.

    `gcs.scenario.validation.boundaries` checks both against the limits.
    """
    shape = _QUINTIC if wind.is_still else _SEPTIC
    coefficients = shape * (end - start) / (end_s - start_s) ** np.arange(len(shape) - 1, -1, -1)
    coefficients[-1] += start
    return PPoly(coefficients[:, None], [start_s, end_s])


def shape_from_ground(ground_s: float, air_s: float, ground_ned_m: Array, offsets: Array, scenario: Scenario) -> Shape:
    """Offsets between uneven ground and the air: each vehicle's height over the leader's changes in between.

    `ground_ned_m` and `offsets` are (V, 3). It lands where the time on the ground is the later one.
    """
    leader = leader_index(scenario)
    difference = np.zeros_like(offsets)
    difference[:, 2] = ground_ned_m[:, 2] - ground_ned_m[leader, 2] - offsets[:, 2]
    if not difference.any():
        return rigid(offsets, min(ground_s, air_s), max(ground_s, air_s))
    if ground_s < air_s:
        step = smooth_step(ground_s, air_s, 1.0, 0.0, steady_wind(scenario))
    else:
        step = landing_step(air_s, ground_s, 0.0, 1.0, scenario)
    functions = np.zeros((*step.c.shape, 2))
    functions[-1, :, 0] = 1.0
    functions[..., 1] = step.c
    return Shape(PPoly(functions, step.x), np.stack([offsets, difference]))


def _leaning(down: PPoly, position_ned_m: Array, yaw_ned_rad: float, q: Quadrotor) -> Trajectory:
    """The vertical trajectory in wind: tilt and thrust from Eq. 1, rates and moments from the tilt's polynomials."""
    longest_s = (down.x[-1] - down.x[0]) / _PIECES
    parts = [
        np.linspace(begin, end, 1 + max(_PIECES_LEAST, int(np.ceil((end - begin) / longest_s))))[1:]
        for begin, end in pairwise(down.x.tolist())
    ]
    joints = np.concatenate([down.x[:1], *parts])
    length = np.diff(joints)[:, None]
    lobatto = 0.5 * (1.0 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE))  # both ends, so that pieces meet
    t_s = joints[:-1, None] + length * lobatto
    t_s[:, -1] = np.nextafter(joints[1:], -np.inf)  # of this piece: controls have corners at joints
    speed, acceleration = down.derivative()(t_s), down.derivative(2)(t_s)
    air = -np.stack([np.broadcast_to(part, t_s.shape) for part in q.wind.at(-down(t_s))], axis=-1)
    air[..., 2] += speed
    push = np.stack([0.0 * t_s, 0.0 * t_s, acceleration], axis=-1)
    thrust, roll, pitch = thrust_and_tilt(push, air, np.full_like(t_s, yaw_ned_rad), q)
    # From values at the nodes to the coefficients of their polynomial, highest power first.
    # (terms, pieces, nodes)
    powers = length.T ** np.arange(_DEGREE, -1.0, -1.0)[:, None]
    basis = np.linalg.inv(np.vander(lobatto))[:, None] / powers[..., None]
    tilt = PPoly(np.einsum("kpn,cpn->kpc", basis, np.stack([roll, pitch])), joints)
    state = np.zeros((_DEGREE + 1, len(length), 12))
    state[-1, :, :2] = position_ned_m[:2]
    state[-1, :, 8] = yaw_ned_rad
    state[-len(down.c) :, :, 2] = _moved(down, joints)
    state[-len(down.c) + 1 :, :, 5] = _moved(down.derivative(), joints)
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
    control = np.einsum("kpn,pnc->kpc", basis, values)
    return Trajectory(PPoly(state, joints), PPoly(control, joints))


def _moved(polynomial: PPoly, joints: Array) -> Array:
    """Coefficients (K+1, M) of one polynomial on the pieces between joints."""
    order = polynomial.c.shape[0] - 1
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1.0, order + 1.0)]))
    return np.stack([polynomial(joints[:-1], nu=k) / factorials[k] for k in range(order, -1, -1)])
