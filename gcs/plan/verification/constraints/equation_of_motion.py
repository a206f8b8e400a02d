"""Eq. 1 over every window of 5 s: the leader's whole flight, and vehicles of their own where they move apart."""

from dataclasses import dataclass

import numpy as np

from gcs.plan.formation.follower_equations import follower_state_and_control
from gcs.plan.formation.followers import rounded_thrust_polynomial
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.reintegration import WINDOW_S, IntegrationSteps, step_edges, window_errors
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.subdivision import Rows
from gcs.plan.verification.proof.taylor import FUNCTIONS, Taylor, stacked
from gcs.types import Array
from gcs.util.long_work import report

# Order of the Taylor polynomials, and the longest step: the next ones where the first leaves too much of Eq. 1.
LOOKS = ((6, 0.1), (9, 0.1), (9, 0.03))
ENOUGH_M = 5e-3  # errors below this need no second look
FEW = 24  # larger fleets: the outermost vehicles are re-integrated, where they move apart


@dataclass(frozen=True)
class Reintegration:
    """The largest position error of a window, of which vehicle it is, and whether every vehicle was integrated."""

    error_m: float
    row: int
    start_s: float
    complete: bool


def reintegrated(plan: Plan) -> Reintegration:
    """The largest position error of all windows."""
    leader, q = plan.leader_trajectory, plan.quadrotor
    apart_s = plan.shape.apart_s(q.wind)
    whole = (plan.t_start_s, plan.t_end_s, plan.t_end_s)
    worst = _worst(plan, np.array([plan.leader]), whole, apart=False)
    rows = _outermost(plan)
    for start_s, end_s in apart_s:
        low, high = max(start_s - WINDOW_S, leader.start_s), min(end_s + WINDOW_S, leader.end_s)
        worst = max(worst, _worst(plan, rows, (low, high, end_s), apart=True))
    return Reintegration(*worst, complete=not apart_s or len(rows) == len(plan.sysids))


def _worst(plan: Plan, rows: Rows, span_s: tuple[float, float, float], *, apart: bool) -> tuple[float, int, float]:
    """The largest error between two instants, of which row it is, and when its window starts: none after the third."""
    start_s, end_s, last_s = span_s
    joints = begins = plan.joints_s
    if apart:
        joints = np.union1d(joints, rounded_thrust_polynomial(plan.leader_trajectory.control).x)
    starts_s = np.union1d(np.arange(start_s, last_s, 1.0), begins[(begins >= start_s) & (begins < last_s)])
    errors = np.full((len(rows), len(starts_s)), np.inf)
    for order, step_s in LOOKS:
        again, windows = (errors > ENOUGH_M).any(axis=1), (errors > ENOUGH_M).any(axis=0)
        if not again.any():
            break
        report(f"integrating Eq. 1 again: from t = {start_s:.0f} s to {end_s:.0f} s")
        edges = step_edges(joints, start_s, end_s, step_s)
        low, high, count = edges[:-1], edges[1:], len(edges) - 1
        first = np.clip(np.searchsorted(low, starts_s[windows] - 1e-9), 0, count - 1)
        last = np.searchsorted(low, low[first] + WINDOW_S - 1e-9)
        after = (count * np.arange(int(again.sum())))[:, None]
        steps = _steps(plan, rows[again], low, high, order, apart=apart)
        found = window_errors(steps, (after + first).ravel(), (after + last).ravel(), plan.quadrotor)
        part = np.ix_(again, windows)
        errors[part] = np.minimum(errors[part], np.nan_to_num(found, nan=np.inf).reshape(errors[part].shape))
    row, window = np.unravel_index(int(errors.argmax()), errors.shape)
    return float(errors[row, window]), int(rows[row]), float(starts_s[window])


def _steps(plan: Plan, rows: Rows, start_s: Array, end_s: Array, order: int, *, apart: bool) -> IntegrationSteps:
    leader, count = plan.leader_trajectory, len(rows)
    x, u = (enclosed(part, start_s, end_s, order) for part in (leader.state, leader.control))
    if not apart:
        return IntegrationSteps(start_s, end_s, leader.state(start_s), x[:3], u)
    rounded = rounded_thrust_polynomial(leader.control)
    thrust = tuple(_tiled(enclosed(rounded, start_s, end_s, order, n)[0], count) for n in range(3))
    offsets = [_offsets(plan, rows, (start_s, end_s), order, n) for n in range(5)]
    x, u = _tiled(x, count), _tiled(u, count)
    _, control = follower_state_and_control(
        [x[i] for i in range(12)],
        [u[i] for i in range(4)],
        thrust,  # type: ignore[arg-type]
        [[part[axis] for axis in range(3)] for part in offsets],
        plan.quadrotor,
        FUNCTIONS,
    )
    own = stacked(control)
    # Where the leader stands for all, a vehicle has the leader's control, corners and all.
    moving = np.tile(plan.shape.moves_apart(0.5 * (start_s + end_s), plan.quadrotor.wind), count)
    return IntegrationSteps(
        np.tile(start_s, count),
        np.tile(end_s, count),
        plan.motion(start_s, rows)[0].reshape(-1, 12),
        x[:3] + offsets[0],
        Taylor(np.where(moving, own.c, u.c), np.where(moving, own.remainder, u.remainder)),
    )


def _tiled(value: Taylor, count: int) -> Taylor:
    """The same quantities (..., S) for `count` vehicles: (..., count * S)."""
    shape = value.remainder.shape
    return Taylor(
        np.tile(value.c, (*[1] * len(shape), count)), np.tile(value.remainder, (*[1] * (len(shape) - 1), count))
    )


def _offsets(plan: Plan, rows: Rows, span_s: tuple[Array, Array], order: int, derivative: int) -> Taylor:
    """Offsets (3, count * S) of the rows, vehicle after vehicle."""
    functions = enclosed(plan.shape.functions, *span_s, order, derivative)  # (K, S)
    table = plan.shape.basis_ned_m[:, rows]  # (K, V, 3)
    c = np.einsum("oks,kva->oavs", functions.c, table)
    remainder = np.einsum("ks,kva->avs", functions.remainder, np.abs(table))
    return Taylor(c.reshape(len(c), 3, -1), remainder.reshape(3, -1))


def _outermost(plan: Plan) -> Rows:
    """All rows of a small fleet; of a large one those with the largest tables in some direction."""
    tables = plan.shape.basis_ned_m
    if tables.shape[1] <= FEW:
        return np.arange(tables.shape[1])
    size = np.linalg.norm(tables, axis=2)  # (K, V)
    order = np.argsort(-size.max(axis=0), kind="stable")
    ends = [tables[..., axis].argmax(axis=1) for axis in range(3)] + [
        tables[..., axis].argmin(axis=1) for axis in range(3)
    ]
    chosen = dict.fromkeys([plan.leader, *order[: FEW // 3].tolist(), *np.concatenate(ends).tolist()])
    return np.array(list(chosen)[:FEW])
