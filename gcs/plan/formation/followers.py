"""States and controls of vehicles that move within the formation: Eq. 1 inverted, exactly.

A follower flies the leader's acceleration plus that of its offset. Thrust and tilt follow from acceleration, rates from
jerk, moments from snap; yaw is the leader's.

The leader's thrust has corners where its polynomials join. A follower that accelerates in another direction would have
to change its rates there at once. It tilts by a thrust with rounded corners instead: its height stays exact, and the
sideways error is below a millimetre.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import POSITION, RATES, VELOCITY, Array, Quadrotor, derivative
from gcs.plan.formation.shape import EVERYONE, Rows, Shape

Jet = tuple[Array, Array, Array]  # a value and its first two derivatives
BEND_S = 0.5  # a corner of the thrust is spread over so much time before and after it


def formation_motion(
    state: PPoly, control: PPoly, shape: Shape, q: Quadrotor, t_s: Array, rows: slice | Rows = EVERYONE
) -> tuple[Array, Array]:
    """States (V, N, 12) and controls (V, N, 4) of the vehicles in `rows`, from the leader's motion and the shape."""
    x, u = state(t_s), control(t_s)
    place, speed = shape.offsets(t_s, 0, rows), shape.offsets(t_s, 1, rows)
    states = np.repeat(x[None], len(place), axis=0)
    states[..., POSITION] += place
    states[..., VELOCITY] += speed
    controls = np.repeat(u[None], len(place), axis=0)
    moving = shape.is_moving(t_s)
    if q.wind.has_shear and np.any(place[..., 2]):
        moving = np.ones_like(moving)  # higher vehicles meet more wind and lean more
    if moving.any():
        t = t_s[moving]
        states[:, moving], controls[:, moving] = follower_states_and_controls(
            x[moving],
            u[moving],
            rounded_thrust(control, t),
            [place[:, moving], speed[:, moving], *(shape.offsets(t, order, rows) for order in (2, 3, 4))],
            q,
        )
    return states, controls


def follower_states_and_controls(
    leader_state: Array,
    leader_control: Array,
    thrust: Jet,
    offsets: Sequence[Array],
    q: Quadrotor,
) -> tuple[Array, Array]:
    """States (V, N, 12) and controls (V, N, 4) of vehicles at `offsets` from the leader.

    `leader_state` (N, 12), `leader_control` (N, 4), the thrust by which followers tilt with its first two derivatives
    (N,), and the offsets (V, N, 3) with their first four. Where that thrust is the leader's, Eq. 1 holds for the
    result as exactly as for the leader.
    """
    place, speed, acceleration, jerk, snap = offsets
    drag, m = np.array(q.drag_Nspm), q.mass_kg
    # What thrust does, in NED and turned over: f = U1 * e(attitude) with e = (0, 0, 1) when level.
    f0, f1, f2 = _thrust_vector(leader_state, leader_control, thrust, q)
    level = np.cos(leader_state[..., 6]) * np.cos(leader_state[..., 7])
    lift = leader_control[..., 0] * level - m * acceleration[..., 2] - drag[2] * speed[..., 2]
    f0 = f0 - m * acceleration - drag * speed
    f1 = f1 - m * jerk - drag * acceleration
    f2 = f2 - m * snap - drag * jerk
    if q.wind.has_shear:
        more = _more_wind(leader_state, leader_control, offsets, q)
        f0, f1, f2 = (f + drag * w for f, w in zip((f0, f1, f2), more, strict=True))
    yaw, yaw_rate = leader_state[..., 8], leader_state[..., 11]
    yaw_acceleration = derivative(leader_state, leader_control, q)[..., 11]
    # Seen along the heading: ahead a, to the left b, down c. As a complex number a - ib = (f_n + i f_e) exp(-i yaw).
    turn = np.exp(-1j * yaw)
    p0, p1, p2 = (f[..., 0] + 1j * f[..., 1] for f in (f0, f1, f2))
    w0 = p0 * turn
    w1 = (p1 - 1j * yaw_rate * p0) * turn
    w2 = (p2 - 2j * yaw_rate * p1 - (1j * yaw_acceleration + yaw_rate**2) * p0) * turn
    a, b, c = (w0.real, w1.real, w2.real), (-w0.imag, -w1.imag, -w2.imag), (f0[..., 2], f1[..., 2], f2[..., 2])
    pitch = _angle(a, c)
    roll = _angle(b, _length(a, c))
    states = np.broadcast_to(leader_state, (*place.shape[:2], 12)).copy()
    states[..., 0:3] += place
    states[..., 3:6] += speed
    states[..., 6], states[..., 7] = roll[0], pitch[0]
    states[..., 9], states[..., 10] = roll[1], pitch[1]
    # What Eq. 1 gives without moments is what they have to make up for.
    idle = np.zeros((*place.shape[:2], 4))
    missing = np.stack(np.broadcast_arrays(roll[2], pitch[2], yaw_acceleration), axis=-1)
    missing = missing - derivative(states, idle, q)[..., RATES]
    controls = np.empty((*place.shape[:2], 4))
    controls[..., 0] = lift / (np.cos(roll[0]) * np.cos(pitch[0]))
    controls[..., 1:] = missing * np.array(q.inertia_kgm2) / np.array([q.arm_m, q.arm_m, 1.0])
    return states, controls


def _more_wind(leader_state: Array, leader_control: Array, offsets: Sequence[Array], q: Quadrotor) -> Jet:
    """Wind at the vehicles minus wind at the leader, with two derivatives, (V, N, 3) each."""
    down = leader_state[..., 2], leader_state[..., 5], derivative(leader_state, leader_control, q)[..., 5]

    def jet(height: tuple[Array, ...]) -> tuple[Array, ...]:
        share, slope, bend = q.wind.shares(height[0])
        return share, slope * height[1], bend * height[1] ** 2 + slope * height[2]

    here = jet(tuple(-part for part in down))
    there = jet(tuple(-(part + offset[..., 2]) for part, offset in zip(down, offsets, strict=False)))
    toward = np.array([q.wind.north_mps, q.wind.east_mps, 0.0])
    return tuple((b - a)[..., None] * toward for a, b in zip(here, there, strict=True))


def rounded_thrust(control: PPoly, t_s: Array) -> Jet:
    """U1 and its first two derivatives (N,), each corner at a joint replaced by a smooth bend."""
    joints = control.x[1:-1]
    u0, u1, u2 = (control(t_s, nu=order)[:, 0] for order in range(3))
    if not len(joints):
        return u0, u1, u2
    corner = control(joints, nu=1)[:, 0] - control(np.nextafter(joints, -np.inf), nu=1)[:, 0]
    lengths = np.diff(control.x)
    width = np.minimum(BEND_S, 0.45 * np.minimum(lengths[:-1], lengths[1:]))
    near = np.clip(np.searchsorted(0.5 * (joints[1:] + joints[:-1]), t_s), 0, len(joints) - 1)
    w, after = width[near], t_s >= joints[near]
    x = np.clip((t_s - joints[near]) / w, -1.0, 1.0)
    # Integrals of the bump 15/16 (1 - x^2)^2, whose own integral is one: the corner's step, spread over the bend.
    bump = 15.0 / 16.0 * (1.0 - x**2) ** 2
    step = 0.5 + 15.0 / 16.0 * (x - 2.0 / 3.0 * x**3 + x**5 / 5.0)
    ramp = 15.0 / 16.0 * (x**2 / 2.0 - x**4 / 6.0 + x**6 / 30.0) + 0.5 * x + 5.0 / 32.0
    size = corner[near]
    return (
        u0 + size * w * (ramp - np.maximum(x, 0.0)),
        u1 + size * (step - after),
        u2 + np.where(np.abs(x) < 1.0, size / w * bump, 0.0),
    )


def _thrust_vector(state: Array, control: Array, thrust: Jet, q: Quadrotor) -> tuple[Array, ...]:
    """U1 * e and its first two derivatives, (N, 3) each."""
    roll, pitch, yaw = state[..., 6], state[..., 7], state[..., 8]
    angular = derivative(state, control, q)[..., RATES]
    direction = [_tilt(roll, pitch, yaw, *state[..., RATES].T, *angular.T)]
    e0, e1, e2 = direction[0]
    u0, u1, u2 = (x[..., None] for x in thrust)
    return u0 * e0, u1 * e0 + u0 * e1, u2 * e0 + 2.0 * u1 * e1 + u0 * e2


def _tilt(
    roll: Array, pitch: Array, yaw: Array, p: Array, q: Array, r: Array, pp: Array, qq: Array, rr: Array
) -> tuple[Array, Array, Array]:
    """e = Rz(yaw) (sin pitch cos roll, -sin roll, cos pitch cos roll) and its first two derivatives, (N, 3) each."""
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    a0, c0, b0 = sp * cr, cp * cr, -sr
    a1 = q * cp * cr - p * sp * sr
    c1 = -q * sp * cr - p * cp * sr
    b1 = -p * cr
    a2 = qq * cp * cr - q * q * sp * cr - 2.0 * p * q * cp * sr - pp * sp * sr - p * p * sp * cr
    c2 = -qq * sp * cr - q * q * cp * cr + 2.0 * p * q * sp * sr - pp * cp * sr - p * p * cp * cr
    b2 = -pp * cr + p * p * sr
    turn = np.exp(1j * yaw)
    w0, w1, w2 = a0 + 1j * b0, a1 + 1j * b1, a2 + 1j * b2
    h0 = w0 * turn
    h1 = (w1 + 1j * r * w0) * turn
    h2 = (w2 + 2j * r * w1 + (1j * rr - r * r) * w0) * turn
    return tuple(np.stack([h.real, h.imag, c], axis=-1) for h, c in ((h0, c0), (h1, c1), (h2, c2)))  # type: ignore[return-value]


def _length(a: Jet, c: Jet) -> Jet:
    """sqrt(a^2 + c^2)."""
    h0 = np.hypot(a[0], c[0])
    h1 = (a[0] * a[1] + c[0] * c[1]) / h0
    h2 = (a[1] ** 2 + a[0] * a[2] + c[1] ** 2 + c[0] * c[2] - h1**2) / h0
    return h0, h1, h2


def _angle(y: Jet, x: Jet) -> Jet:
    """atan2(y, x)."""
    square = y[0] ** 2 + x[0] ** 2
    cross = y[1] * x[0] - y[0] * x[1]
    cross_rate = y[2] * x[0] - y[0] * x[2]
    square_rate = 2.0 * (y[0] * y[1] + x[0] * x[1])
    return np.arctan2(y[0], x[0]), cross / square, (cross_rate - cross * square_rate / square) / square
