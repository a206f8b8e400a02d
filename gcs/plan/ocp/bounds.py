"""Limits of all vehicles at an instant, as bounds of the leader's state and control (Eqs. 22-25, Eq. 51).

A scheduled shape is a function of time. Then the followers' limits are bounds of the leader that change with time, and
add no constraint. Limits that depend on coordinates of the shape, and the turning limit (Eq. 18, Eq. 25), are
constraints (`stage_functions`).
"""

import numpy as np

from gcs.errors import Infeasible
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import ANGLES, COLUMNS, CONTROLS, STATES, Kind
from gcs.types import Array

_TILT = slice(6, 8)
_TILT_RATES = slice(9, 11)
# Tilt and its rates follow from acceleration and jerk over g where thrust equals weight. Thrust may be a little less.
_LIGHT = 1.2


def leader_state_bounds(problem: Problem, times_s: Array) -> tuple[Array, Array]:
    """Bounds (T, nx), (T, nx) of the leader's state (Eq. 51, with Eq. 22 for followers) and the shape's coordinates.

    Raises Infeasible where offsets differ by more than a limit allows, as in altitude lanes under a low ceiling.
    """
    low = np.tile(problem.state_low, (len(times_s), 1))
    high = np.tile(problem.state_high, (len(times_s), 1))
    least, most = _offset_range(problem, times_s, 0)
    low[:, POSITION] -= least
    high[:, POSITION] -= most
    least, most = _offset_range(problem, times_s, 1)
    low[:, VELOCITY] -= least
    high[:, VELOCITY] -= most
    gravity = problem.quadrotor.gravity_mps2
    for part, order in ((_TILT, 2), (_TILT_RATES, 3)):
        taken = _LIGHT / gravity * _push(problem, times_s, order)[:, None]
        low[:, part] += taken
        high[:, part] -= taken
    _tighten(problem, times_s, low, high, STATES)
    for c in problem.coordinates:
        low = np.hstack([low, np.tile([c.low, *np.negative(c.most[:3])], (len(times_s), 1))])
        high = np.hstack([high, np.tile([c.high, *c.most[:3]], (len(times_s), 1))])
    return low, high


def leader_control_bounds(problem: Problem, times_s: Array) -> tuple[Array, Array]:
    """Bounds (T, nu), (T, nu) of the leader's control (Eq. 51) and of the coordinates' snaps.

    The control that the shape's own motion needs is subtracted from the full limits; the control margin stays where it
    is larger. Raises Infeasible where nothing is left.
    """
    low = np.tile(problem.control_low, (len(times_s), 1))
    high = np.tile(problem.control_high, (len(times_s), 1))
    snaps = np.array([c.most[3] for c in problem.coordinates])
    if problem.coordinates or problem.shape.moving_s:
        _leave_room(problem, times_s, low, high)
    _tighten(problem, times_s, low, high, CONTROLS)
    return (np.hstack([low, np.tile(-snaps, (len(times_s), 1))]), np.hstack([high, np.tile(snaps, (len(times_s), 1))]))


def _tighten(problem: Problem, times_s: Array, low: Array, high: Array, kinds: tuple[Kind, ...]) -> None:
    """Tighten bounds (T, n) of these kinds as earlier rounds require; raises Infeasible where they cross."""
    for tighter in problem.tightenings:
        column = tighter.column - COLUMNS[kinds[0]]
        if 0 <= column < low.shape[1]:
            during = (times_s >= tighter.start_s) & (times_s <= tighter.end_s)
            low[during, column] += tighter.by
            high[during, column] -= tighter.by
    crossed = np.argwhere(low > high)
    if not len(crossed):
        return
    t, number = crossed[0]
    kind, apart, by, excess = kinds[number], kinds[number] in STATES[POSITION], low[t, number] - high[t, number], ""
    if kind in STATES:
        unit = ("m", "m/s", "deg", "deg/s")[STATES.index(kind) // 3]
        excess = f", by {np.degrees(by) if kind in ANGLES else by:.3g} {unit}"
    raise Infeasible.because(
        f"at t = {times_s[t]:.1f} s the formation {'is larger' if apart else 'changes faster'} than the limit "
        f"of {kind.value} allows{excess}",
        hint="widen [limits] height_m, north_m or east_m, or give the shapes less spacing"
        if apart
        else "make [formation] change_speed_mps or change_accel_mps2 smaller, or widen [limits]",
    )


def _leave_room(problem: Problem, times_s: Array, low: Array, high: Array) -> None:
    """Reduce control bounds (T, 4) by the control that the shape's motion needs."""
    q = problem.quadrotor
    least, most = _offset_range(problem, times_s, 2)
    rate_least, rate_most = _offset_range(problem, times_s, 1)
    # Eq. 1, third row: a vehicle that accelerates downwards needs less thrust.
    lift_least = -q.mass_kg * most[:, 2] - q.drag_Nspm[2] * rate_most[:, 2]
    lift_most = -q.mass_kg * least[:, 2] - q.drag_Nspm[2] * rate_least[:, 2]
    full_low, full_high = problem.control_limits
    low[:, 0] = np.maximum(low[:, 0], full_low[0] - lift_least)
    high[:, 0] = np.minimum(high[:, 0], full_high[0] - lift_most)
    snap = _LIGHT / q.gravity_mps2 * _push(problem, times_s, 4)
    for axis in (1, 2):
        taken = q.inertia_kgm2[axis - 1] / q.arm_m * snap
        low[:, axis] = np.maximum(low[:, axis], full_low[axis] + taken)
        high[:, axis] = np.minimum(high[:, axis], full_high[axis] - taken)


def boundary_values(problem: Problem) -> tuple[Array, Array, Array]:
    """States (nx,) at the start (Eq. 15) and, low and high (nx,), at the end (Eq. 16), with the shape at rest."""
    start = [problem.start_state]
    low, high = [problem.end_state], [problem.end_state]
    for number, c in enumerate(problem.coordinates):
        rest = np.array([c.rest, 0.0, 0.0, 0.0])
        if c.free_end and problem.heading is not None:
            start.append(problem.heading.start)
            for end in (low, high):
                end.append(np.array([problem.heading.end_rad, 0.0, 0.0, 0.0]))
            continue
        start.append(problem.begins[number] if problem.begins else rest)
        low.append(np.array([c.low, 0.0, 0.0, 0.0]) if c.free_end else rest)
        high.append(np.array([c.high, 0.0, 0.0, 0.0]) if c.free_end else rest)
    return np.concatenate(start), np.concatenate(low), np.concatenate(high)


def _offset_range(problem: Problem, times_s: Array, order: int) -> tuple[Array, Array]:
    """Least and largest offset (T, 3), or derivative, of any vehicle; zero (the leader) where coordinates decide it."""
    if problem.coordinates or (order > 0 and not problem.shape.moving_s):
        return np.zeros((len(times_s), 3)), np.zeros((len(times_s), 3))
    offsets = problem.shape.offsets(times_s, order)
    return offsets.min(axis=0), offsets.max(axis=0)


def _push(problem: Problem, times_s: Array, order: int) -> Array:
    """Largest horizontal derivative (T,) of the specific thrust that the shape needs, for acceleration and drag."""
    if not problem.coordinates and not problem.shape.moving_s:
        return np.zeros(len(times_s))
    q = problem.quadrotor
    drag_per_s = max(q.drag_Nspm[:2]) / q.mass_kg
    return _sideways(problem, times_s, order) + drag_per_s * _sideways(problem, times_s, order - 1)


def _sideways(problem: Problem, times_s: Array, order: int) -> Array:
    """Largest horizontal derivative (T,) of any vehicle's offset."""
    if problem.coordinates:
        limit = problem.change_budget
        return np.full(len(times_s), (limit.speed_mps, limit.accel_mps2, limit.jerk_mps3, limit.snap_mps4)[order - 1])
    moving = problem.shape.offsets(times_s, order)
    return np.asarray(np.hypot(moving[..., 0], moving[..., 1]).max(axis=0))
