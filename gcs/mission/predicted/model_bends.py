"""How far a model's flight is from straight pieces between some of its steps, and how fast it is on each of them.

Between two steps a model's flight is the cubic through its positions and velocities. The bounds hold at every instant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.navigation.predict import Prediction
from gcs.physics.quadrotor import Array

_CUBIC = 4.0 / 27.0  # the most of s (1 - s)^2 for s in [0, 1]


def bends_m(flown: Prediction, steps: NDArray[np.intp]) -> Array:
    """The largest distances (N - 1,) from the straight pieces between these steps (N,), at the same instant."""
    t_s, places = flown.t_s, flown.position_ned_m
    straight = np.stack([np.interp(t_s, t_s[steps], places[steps, axis]) for axis in range(3)], axis=-1)
    away_m = np.linalg.norm(places - straight, axis=1)
    step_s, mean_mps = _steps(flown)
    turns_mps = np.linalg.norm(flown.velocity_ned_mps[:-1] - mean_mps, axis=1)
    turns_mps += np.linalg.norm(flown.velocity_ned_mps[1:] - mean_mps, axis=1)
    between_m = np.maximum(away_m[:-1], away_m[1:]) + _CUBIC * step_s * turns_mps
    return np.asarray(np.maximum.reduceat(between_m, steps[:-1]))


def fastest_mps(flown: Prediction, steps: NDArray[np.intp]) -> Array:
    """The highest speeds (N - 1, 3) along each axis on the pieces between these steps (N,)."""
    _, mean_mps = _steps(flown)
    before, after = flown.velocity_ned_mps[:-1], flown.velocity_ned_mps[1:]
    # The velocity of a cubic lies between these three: its coefficients by Bernstein.
    most = np.max(np.abs([before, 3.0 * mean_mps - before - after, after]), axis=0)
    return np.asarray(np.maximum.reduceat(most, steps[:-1], axis=0))


def _steps(flown: Prediction) -> tuple[Array, Array]:
    step_s = np.diff(flown.t_s)
    return step_s, np.diff(flown.position_ned_m, axis=0) / step_s[:, None]
