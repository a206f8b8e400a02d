"""Eq. 1, integrated again under the planned control over short windows that start on the plan, with an error bound.

Open-loop integration over a whole flight says nothing, because Eq. 1 integrates four times. Windows of 5 s do.

Every step is a Taylor polynomial of the solution. What it leaves of Eq. 1 (its defect) is bounded over the whole step.
The distance to the exact solution then grows no faster than the solution of e' = M e + defect, where M bounds the
derivatives of Eq. 1. The reported error contains both: the distance to the plan, and this bound.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from gcs.physics.quadrotor import Quadrotor, equations_of_motion
from gcs.plan.verification.proof.polynomials import shifted
from gcs.plan.verification.proof.power_series import motion_series
from gcs.plan.verification.proof.subdivision import Rows
from gcs.plan.verification.proof.taylor import FUNCTIONS, Taylor
from gcs.types import Array

WINDOW_S = 5.0
_FASTER_RADPS = 0.1  # rates of the exact solution differ by less from those of the Taylor polynomials
_BLOCK = 8192


@dataclass(frozen=True)
class IntegrationSteps:
    """S steps, those of one vehicle in order and then those of the next."""

    start_s: Array  # (S,)
    end_s: Array  # (S,)
    state: Array  # (S, 12) planned at the start
    place: Taylor  # (3, S) planned
    control: Taylor  # (4, S)


def step_edges(joints_s: Array, start_s: float, end_s: float, step_s: float) -> Array:
    """The edges of steps: every joint, every second, and no step longer than that."""
    marks = np.union1d(np.arange(start_s, end_s, 1.0), joints_s[(joints_s > start_s) & (joints_s < end_s)])
    marks = np.union1d(marks, [start_s, end_s])
    marks = marks[np.concatenate([[True], np.diff(marks) > 1e-9])]
    marks[-1] = end_s
    parts = [np.linspace(a, b, int(np.ceil((b - a) / step_s - 1e-9)), endpoint=False) for a, b in pairwise(marks)]
    return np.concatenate([*parts, [end_s]])


def window_errors(steps: IntegrationSteps, first: Rows, last: Rows, q: Quadrotor) -> Array:
    """Bounds (W,) on the error of windows from their first steps (W,) to the steps (W,) before which they end."""
    radius = 0.5 * (steps.end_s - steps.start_s)
    # From powers of s in [-1, 1] to those of s + 1 in [0, 2], as the series have them.
    control, place = shifted(steps.control.c, -1.0), shifted(steps.place.c, -1.0)
    powers = 2.0 ** np.arange(len(control))[:, None, None]
    state = steps.state[first].T.copy()  # (12, W)
    flown: list[tuple[Rows, Rows]] = []
    distances: list[Array] = []
    series: list[Array] = []
    for advance in range(int(np.max(last - first))):
        active = np.flatnonzero(first + advance < last)
        step = first[active] + advance
        found = motion_series(state[:, active], control[:, :, step], radius[step], q)  # (K+1, 12, N)
        state[:, active] = (found * powers).sum(axis=0)
        off = np.abs(found[:, :3] - place[:, :, step]) * powers
        distances.append(np.linalg.norm(off.sum(axis=0) + steps.place.remainder[:, step], axis=0))
        flown.append((active, step))
        series.append(found)
    every = np.concatenate([step for _, step in flown])
    flown_series = np.concatenate(series, axis=2)
    defect = _defect(flown_series, steps.control.c, steps.control.remainder, every, radius, q)
    fastest = float((np.abs(flown_series[:, 9:]) * powers).sum(axis=0).max()) + _FASTER_RADPS
    # Of the longest step, which bounds the shorter ones
    growth = expm(_growth(steps, fastest, q) * float(2.0 * radius.max()))
    error, worst, done = np.zeros((12, len(first))), np.zeros(len(first)), 0
    for (active, step), distance in zip(flown, distances, strict=True):
        error[:, active] = growth @ (error[:, active] + 2.0 * radius[step] * defect[:, done : done + len(step)])
        worst[active] = np.maximum(worst[active], distance + np.linalg.norm(error[:3, active], axis=0))
        done += len(step)
    worst[np.any(error[9:] > _FASTER_RADPS, axis=0)] = np.inf
    return worst


def _defect(series: Array, control: Array, left_out: Array, step: Rows, radius: Array, q: Quadrotor) -> Array:
    """How far (12, N) the Taylor polynomials are from Eq. 1, at most, at any instant of their steps (N,)."""
    found = []
    for first in range(0, len(step), _BLOCK):
        part = slice(first, first + _BLOCK)
        c, chosen = shifted(series[:, :, part], 1.0), step[part]
        none = np.zeros(len(chosen))
        state = [Taylor(c[:, i], none) for i in range(12)]
        forces = [Taylor(control[:, i, chosen], left_out[i, chosen]) for i in range(4)]
        powers = np.arange(1.0, len(c))[:, None, None]
        slope = np.concatenate([c[1:] * powers, np.zeros_like(c[:1])]) / radius[chosen]
        moved = equations_of_motion(state, forces, q, xp=FUNCTIONS)
        found.append(np.stack([(m - Taylor(slope[:, i], none)).size() for i, m in enumerate(moved)]))
    return np.concatenate(found, axis=1)


def _growth(steps: IntegrationSteps, fastest_radps: float, q: Quadrotor) -> Array:
    """M (12, 12): no derivative of Eq. 1 is larger while no rate is above `fastest_radps`."""
    growth = np.zeros((12, 12))
    growth[0:3, 3:6] = np.eye(3)
    thrust = float(np.max(steps.control[0].size()))
    growth[3:6, 6:9] = thrust / q.mass_kg
    growth[range(3, 6), range(3, 6)] = np.array(q.drag_Nspm) / q.mass_kg
    if q.wind.has_shear:
        steepest = q.wind.exponent * 0.5 ** (q.wind.exponent - 1.0) / q.wind.reference_m**q.wind.exponent
        for axis, toward in enumerate((q.wind.north_mps, q.wind.east_mps)):
            growth[3 + axis, 2] = q.drag_Nspm[axis] / q.mass_kg * abs(toward) * steepest
    growth[6:9, 9:12] = np.eye(3)
    ix, iy, iz = q.inertia_kgm2
    for axis, (couple, inertia) in enumerate(((iy - iz, ix), (iz - ix, iy), (ix - iy, iz))):
        growth[9 + axis, 9:12] = abs(couple) / inertia * fastest_radps
        growth[9 + axis, 9 + axis] = q.drag_moment_Nms[axis] / inertia
    return growth
