"""The curves of a plan for other planners and shows: polynomials that keep within half a millimetre of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcs.mission.formats.vehicle_curve import VehicleCurve, cubic, quintic
from gcs.physics.quadrotor import derivative
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

_WITHIN_M = 0.0005
_LONGEST_S, _SHORTEST_S = 4.0, 1.0 / 64.0
_INSIDE = np.arange(1, 8) / 8.0  # where a piece is compared with the plan
_YAW, _YAW_RATE = 8, 11
_BATCH = 20  # vehicles sampled at once


def plan_curves(plan: Plan, *, quintics: bool) -> Iterator[VehicleCurve]:
    """The curves of all vehicles on common instants, for quintics through accelerations, or else for cubics."""
    t_s = _instants(plan, quintics=quintics)
    for first in range(0, len(plan.sysids), _BATCH):
        rows = slice(first, first + _BATCH)
        states, controls = plan.motion(t_s, rows)
        acceleration = derivative(states, controls, plan.quadrotor)[..., VELOCITY]
        for row, sysid in enumerate(plan.sysids[rows]):
            yield VehicleCurve(
                sysid,
                t_s - t_s[0],
                states[row][:, POSITION],
                states[row][:, VELOCITY],
                acceleration[row],
                np.unwrap(states[row][:, _YAW]),
                states[row][:, _YAW_RATE],
            )


def _instants(plan: Plan, *, quintics: bool) -> Array:
    """The ends of the pieces (N,): those of the phases, and halves of each piece that leaves the plan."""
    ends_s = np.unique([plan.t_start_s, plan.t_end_s, *(phase.start_s for phase in plan.phases)])
    counts = np.ceil(np.diff(ends_s) / _LONGEST_S).astype(int)
    spans = zip(ends_s[:-1].tolist(), ends_s[1:].tolist(), counts.tolist(), strict=True)
    parts = [np.linspace(start_s, end_s, count + 1)[:-1] for start_s, end_s, count in spans]
    t_s = np.append(np.concatenate(parts), ends_s[-1])
    for first in range(0, len(plan.sysids), _BATCH):
        rows = slice(first, first + _BATCH)
        open_s = np.stack([t_s[:-1], t_s[1:]], axis=1)
        while len(open_s):
            off = _off_m(plan, rows, open_s, quintics=quintics)
            open_s = open_s[(off > _WITHIN_M) & (np.diff(open_s, axis=1)[:, 0] > _SHORTEST_S)]
            middle_s = open_s.mean(axis=1)
            t_s = np.union1d(t_s, middle_s)
            open_s = np.concatenate([np.stack([open_s[:, 0], middle_s], 1), np.stack([middle_s, open_s[:, 1]], 1)])
    return t_s


def _off_m(plan: Plan, rows: slice, spans_s: Array, *, quintics: bool) -> Array:
    """How far polynomials over spans (M, 2) are from the plan (M,), the worst vehicle's."""
    count, length_s = len(spans_s), np.diff(spans_s, axis=1)[:, 0]
    inner_s = spans_s[:, :1] + length_s[:, None] * _INSIDE
    at_s = plan.clamped(np.concatenate([spans_s[:, 0], spans_s[:, 1], inner_s.ravel()]))
    states, controls = plan.motion(at_s, rows)
    acceleration = derivative(states, controls, plan.quadrotor)[..., VELOCITY]
    worst = np.zeros(count)
    for row in range(len(states)):
        motion = [states[row][:, POSITION], states[row][:, VELOCITY], acceleration[row]]
        ends = [np.stack([part[:count], part[count : 2 * count]]) for part in motion]
        scaled = [part * (length_s**order)[:, None] for order, part in enumerate(ends)]
        c = (quintic(np.ones(1), *scaled) if quintics else cubic(np.ones(1), *scaled[:2]))[:, 0]
        powers = _INSIDE[:, None] ** np.arange(len(c))
        place = np.einsum("kp,pmi->mki", powers, c)
        true = motion[0][2 * count :].reshape(count, len(_INSIDE), 3)
        worst = np.maximum(worst, np.linalg.norm(place - true, axis=2).max(axis=1))
    return worst
