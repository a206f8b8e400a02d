"""States and controls of vehicles that move within the formation: Eq. 1 inverted, exactly.

A follower flies the leader's acceleration plus that of its offset. Thrust and tilt follow from acceleration, rates from
jerk, moments from snap; yaw is the leader's.

The leader's thrust has corners where its polynomials join. A follower that accelerates in another direction would have
to change its rates there at once. It tilts by a thrust with rounded corners instead: its height stays exact, and the
sideways error is below a millimetre.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Quadrotor
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.follower_equations import Jet, follower_state_and_control, jerk
from gcs.plan.formation.shape import EVERYONE, Rows, Shape
from gcs.types import Array

BEND_S = 0.5  # a corner of the thrust is spread over so much time before and after it
# A corner of slope 1 spread over [-1, 1]: the second integral of the bump 15/16 (1 - x^2)^2, highest power first.
_BEND = 15.0 / 16.0 * np.array([1.0 / 30.0, 0.0, -1.0 / 6.0, 0.0, 0.5, 8.0 / 15.0, 1.0 / 6.0])


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
    moving = shape.moves_apart(t_s, q.wind)
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


def formation_jerks(
    state: PPoly, control: PPoly, shape: Shape, q: Quadrotor, t_s: Array, rows: slice | Rows = EVERYONE
) -> Array:
    """Jerks (V, N, 3) in NED of the vehicles in `rows`: the leader's by Eq. 1, plus that of the offset."""
    x, u = state(t_s), control(t_s)
    own = jerk(tuple(x.T), tuple(u.T), control(t_s, nu=1)[:, 0], q)
    return np.asarray(np.stack(own, axis=-1) + shape.offsets(t_s, 3, rows))


def follower_states_and_controls(
    leader_state: Array, leader_control: Array, thrust: Jet, offsets: Sequence[Array], q: Quadrotor
) -> tuple[Array, Array]:
    """States (V, N, 12) and controls (V, N, 4) of vehicles at `offsets` from the leader.

    `leader_state` (N, 12), `leader_control` (N, 4), the thrust by which followers tilt with its first two derivatives
    (N,), and the offsets (V, N, 3) with their first four. Where that thrust is the leader's, Eq. 1 holds for the
    result as exactly as for the leader.
    """
    states, controls = follower_state_and_control(
        tuple(np.moveaxis(leader_state, -1, 0)),
        tuple(np.moveaxis(leader_control, -1, 0)),
        thrust,
        [tuple(np.moveaxis(part, -1, 0)) for part in offsets],
        q,
    )
    return np.stack(np.broadcast_arrays(*states), axis=-1), np.stack(np.broadcast_arrays(*controls), axis=-1)


def rounded_thrust(control: PPoly, t_s: Array) -> Jet:
    """U1 and its first two derivatives (N,), each corner at a joint replaced by a smooth bend."""
    rounded = rounded_thrust_polynomial(control)
    return tuple(rounded(t_s, nu=order)[:, 0] for order in range(3))


@lru_cache(maxsize=16)
def rounded_thrust_polynomial(control: PPoly) -> PPoly:
    """U1 with each corner at a joint replaced by a smooth bend: one component, joined at more instants."""
    joints = control.x[1:-1]
    thrust = PPoly(np.ascontiguousarray(control.c[:, :, :1]), control.x)
    if not len(joints):
        return thrust
    corner = thrust(joints, nu=1)[:, 0] - thrust(np.nextafter(joints, -np.inf), nu=1)[:, 0]
    lengths = np.diff(control.x)
    width = np.minimum(BEND_S, 0.45 * np.minimum(lengths[:-1], lengths[1:]))
    edges = np.unique(np.concatenate([control.x, joints - width, joints + width]))
    starts, middles = edges[:-1], 0.5 * (edges[:-1] + edges[1:])
    piece = np.clip(np.searchsorted(control.x, middles, side="right") - 1, 0, len(control.x) - 2)
    nearest = np.abs(middles[:, None] - joints).argmin(axis=1)
    inside = np.abs(middles - joints[nearest]) < width[nearest]
    c = np.zeros((max(len(_BEND), len(control.c)), len(starts), 1))
    for number, start_s in enumerate(starts):
        own = np.poly1d(thrust.c[:, piece[number], 0])(np.poly1d([1.0, start_s - control.x[piece[number]]]))
        if inside[number]:
            joint, w = joints[nearest[number]], width[nearest[number]]
            bend = np.poly1d(_BEND) - np.poly1d([1.0, 0.0] if middles[number] > joint else [0.0])
            own = own + corner[nearest[number]] * w * bend(np.poly1d([1.0 / w, (start_s - joint) / w]))
        c[len(c) - len(own.coeffs) :, number, 0] = own.coeffs
    return PPoly(c, edges)
