"""Samples of a flight at the instants of its route points, so that every drawn point becomes a waypoint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_SAME_S = 1e-6


def with_drawn_points(t_s: Array, plan: Plan) -> tuple[Array, tuple[int, ...]]:
    """Sample times (N,) with those of route points among them, and the indices of these; both ends of a hold.

    A sample gives way to a route point less than half a step away, so that no step is too short for a speed. The first
    and the last sample stay.
    """
    instants = np.array([instant for passage in plan.passages for instant in passage.times_s])
    instants = instants[(instants > t_s[0] + _SAME_S) & (instants < t_s[-1] - _SAME_S)]
    if not len(instants):
        return t_s, ()
    near_s = 0.5 * float(t_s[1] - t_s[0])
    away_s = np.abs(t_s[:, None] - instants).min(axis=1)
    away_s[[0, -1]] = np.inf
    every = np.union1d(t_s[away_s >= near_s], instants)
    return every, tuple(np.searchsorted(every, instants).tolist())
