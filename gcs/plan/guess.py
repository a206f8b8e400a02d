"""Where the optimiser starts from: a way through the map flown at constant speed, over what lies under it.

Knows: routes and how to turn one into states. Does not know: whether the result can be flown; it need not be.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from gcs.plan.problem import Problem
from gcs.plan.route import Route
from gcs.plan.trajectory import Trajectory
from gcs.quadrotor import Array
from gcs.scenario.terrain import ground_envelope_m

_POINTS = 201
_SMOOTHING = 4.0  # points: rounds the corners of a route and the flanks of what it climbs over


def straight_way(problem: Problem) -> Route:
    """The way that ignores the map."""
    return Route(np.array([problem.start_state[:2], problem.end_state[:2]]), ())


def along(problem: Problem, route: Route) -> Trajectory:
    """Constant speed along a route, level, twice the least clearance above every vehicle's ground."""
    times = np.linspace(problem.start_s, problem.end_s, _POINTS)
    share = np.linspace(0.0, 1.0, _POINTS)
    states = problem.start_state + share[:, None] * (problem.end_state - problem.start_state)
    states[:, :2] = _rounded(route.place(share))
    states[:, 2] = np.clip(
        np.minimum(states[:, 2], -_lift(problem, states)), problem.state_low[2], problem.state_high[2]
    )
    states[:, 3:6] = np.gradient(states[:, :3], times, axis=0)
    states[:, 6:8] = 0.0
    states[:, 9:12] = 0.0
    controls = np.zeros((_POINTS, 4))
    controls[:, 0] = problem.quadrotor.weight_N
    return Trajectory(_piecewise_linear(times, states), _piecewise_linear(times, controls))


def _rounded(points: Array) -> Array:
    """The way with its corners rounded; its ends stay."""
    line = np.linspace(points[0], points[-1], len(points))
    return np.asarray(line + gaussian_filter1d(points - line, _SMOOTHING, axis=0, mode="nearest"))


def _lift(problem: Problem, states: Array) -> Array:
    """Height (N,) of the leader at which every vehicle clears its ground, rising before a flank."""
    scenario = problem.scenario
    ground = np.max(
        [
            ground_envelope_m(scenario.terrain, states[:, 0] + north, states[:, 1] + east) + down
            for north, east, down in problem.offsets_ned_m
        ],
        axis=0,
    )
    needed = ground + 2.0 * scenario.limits.clearance_min_m
    return np.asarray(gaussian_filter1d(maximum_filter1d(needed, int(4 * _SMOOTHING)), _SMOOTHING))


def _piecewise_linear(times: Array, values: Array) -> PPoly:
    slopes = np.diff(values, axis=0) / np.diff(times)[:, None]
    return PPoly(np.stack([slopes, values[:-1]]), times)
