"""Where the optimiser starts from: a straight line at constant speed, lifted over the ground under it.

Knows: one simple way. Does not know: whether it can be flown.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.plan.problem import Problem
from gcs.plan.trajectory import Trajectory
from gcs.scenario.terrain import ground_envelope_m

_POINTS = 101


def straight_line(problem: Problem) -> Trajectory:
    """Constant velocity, twice the least clearance above every vehicle's ground, level, yaw turning evenly."""
    times = np.linspace(problem.start_s, problem.end_s, _POINTS)
    share = np.linspace(0.0, 1.0, _POINTS)[:, None]
    states = problem.start_state + share * (problem.end_state - problem.start_state)
    scenario = problem.scenario
    ground = np.max(
        [
            ground_envelope_m(scenario.terrain, states[:, 0] + north, states[:, 1] + east) + down
            for north, east, down in problem.offsets_ned_m
        ],
        axis=0,
    )
    lift = ground + 2.0 * scenario.limits.clearance_min_m
    states[:, 2] = np.clip(np.minimum(states[:, 2], -lift), problem.state_low[2], problem.state_high[2])
    states[:, 3:6] = np.gradient(states[:, :3], times, axis=0)
    states[:, 6:8] = 0.0
    states[:, 9:12] = 0.0
    controls = np.zeros((_POINTS, 4))
    controls[:, 0] = problem.quadrotor.weight_N
    return Trajectory(_piecewise_linear(times, states), _piecewise_linear(times, controls))


def _piecewise_linear(times: np.ndarray, values: np.ndarray) -> PPoly:
    slopes = np.diff(values, axis=0) / np.diff(times)[:, None]
    return PPoly(np.stack([slopes, values[:-1]]), times)
