"""The fastest flight along a given path: one speed along it, limited by Eq. 51 and by acceleration; both ends met.

The horizontal limit is that of the slower axis, whatever the direction: each axis keeps its limit of Eq. 51. With a
limit of its own for every axis, the time of a path depends on its slowest axis alone, and all paths that never turn
back in that axis take the same time. Acceleration is that of Eq. 18, shared by turning and by changes of speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Array
from gcs.scenario.schema.scenario import Scenario

_LEAST_M = 1e-9
_LEAST_MPS = 1e-3  # a path of one point, or a start at rest


@dataclass(frozen=True)
class PathLimits:
    """Limits of the speed along a path, and its speeds at both ends."""

    level_mps: float
    vertical_mps: float
    turning_mps2: float
    changing_mps2: float
    start_mps: float
    end_mps: float


def path_limits(scenario: Scenario) -> PathLimits:
    """The limits of a scenario, which are those of the plan that PSO is compared with."""
    north, east, down = scenario.limits.speed_ned_mps
    most = scenario.limits.load_factor_max * scenario.vehicle.gravity_mps2
    if scenario.limits.accel_max_mps2 is not None:
        most = min(most, scenario.limits.accel_max_mps2)
    each = most / np.sqrt(2.0)
    ends = (float(np.linalg.norm(end.velocity_mps)) for end in (scenario.start, scenario.end))
    return PathLimits(min(north, east), down, each, each, *ends)


def fastest(places_m: Array, first: Array, second: Array, limits: PathLimits) -> tuple[Array, Array]:
    """Times (P, S) and speeds (P, S) at the samples of P paths (P, S, 3) with two derivatives by any parameter."""
    rate = np.maximum(np.linalg.norm(first, axis=2), _LEAST_M)
    tangent = first / rate[..., None]
    level, climb = np.hypot(tangent[..., 0], tangent[..., 1]), np.abs(tangent[..., 2])
    bend = np.linalg.norm(np.cross(first, second), axis=2) / rate**3
    most = np.minimum(limits.level_mps / np.maximum(level, _LEAST_M), limits.vertical_mps / np.maximum(climb, _LEAST_M))
    squared = np.minimum(most**2, limits.turning_mps2 / np.maximum(bend, _LEAST_M))
    squared[:, 0] = np.minimum(squared[:, 0], limits.start_mps**2)
    squared[:, -1] = np.minimum(squared[:, -1], limits.end_mps**2)
    steps_m = np.linalg.norm(np.diff(places_m, axis=1), axis=2)
    along_m = np.concatenate([np.zeros((len(steps_m), 1)), np.cumsum(steps_m, axis=1)], axis=1)
    # v^2 grows by at most 2 a for each metre, forwards from every sample and backwards from every sample.
    gain = 2.0 * limits.changing_mps2 * along_m
    squared = gain + np.minimum.accumulate(squared - gain, axis=1)
    squared = np.minimum.accumulate((squared + gain)[:, ::-1], axis=1)[:, ::-1] - gain
    speed = np.sqrt(np.maximum(squared, 0.0))
    took = 2.0 * steps_m / np.maximum(speed[:, 1:] + speed[:, :-1], _LEAST_MPS)
    return np.concatenate([np.zeros((len(took), 1)), np.cumsum(took, axis=1)], axis=1), speed
