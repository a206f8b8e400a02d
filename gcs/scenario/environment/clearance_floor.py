"""Least heights that keep a distance to the smooth ground in any direction.

A vehicle keeps the distance `c` where it is above `ground(place + foot) + sqrt(c^2 - |foot|^2)` for every foot within
`c` of its place: above the ground with a ball of radius `c` rolled over it.
"""

import numpy as np

from gcs.scenario.environment.ground_distance import trial_places
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.schema.scenario import Terrain
from gcs.types import Array

FEET = 2  # beside a cliff on each side, two
_RINGS = 3
_OUTERMOST = 0.98  # of the distance
_HALVINGS = 9
_FIRST_STEP = 0.25  # of the distance
_COARSE = 0.7 * np.array([[0.0, 0.0], [1.0, 0.0], [0.7, 0.7], [0.0, 1.0], [-0.7, 0.7], [-1.0, 0.0], [-0.7, -0.7]])
_COARSE = np.concatenate([_COARSE, 0.7 * np.array([[0.0, -1.0], [0.7, -0.7]])])


def clearance_floor_m(terrain: Terrain, north_m: Array, east_m: Array, clearance_m: float) -> Array:
    """Least heights (...) over places (...)."""
    feet = ground_feet_m(terrain, north_m, east_m, clearance_m)
    return np.asarray(_height(terrain, north_m, east_m, feet, clearance_m).max(axis=0))


def coarse_floor_m(terrain: Terrain, north_m: Array, east_m: Array, clearance_m: float) -> Array:
    """`clearance_floor_m`, or a little less, from nine feet: for searches."""
    north_m, east_m = np.broadcast_arrays(north_m, east_m)
    floor = np.full(north_m.shape, -np.inf)
    for share in _COARSE:
        foot = np.broadcast_to(clearance_m * share, (*north_m.shape, 2))
        floor = np.maximum(floor, _height(terrain, north_m, east_m, foot, clearance_m))
    return floor


def ground_feet_m(terrain: Terrain, north_m: Array, east_m: Array, clearance_m: float) -> Array:
    """The two feet (2, ..., 2), north and east of places (...), that require most height: the second one lies on the
    other side of the place."""
    north_m, east_m = (np.asarray(part, dtype=np.float64) for part in np.broadcast_arrays(north_m, east_m))
    trial = _OUTERMOST * trial_places(_RINGS)
    columns = (1,) * north_m.ndim
    feet = clearance_m * np.broadcast_to(trial.reshape(-1, *columns, 2), (len(trial), *north_m.shape, 2))
    heights = _height(terrain, north_m, east_m, feet, clearance_m)
    first = heights.argmax(axis=0)
    chosen = trial[first]
    beside = np.tensordot(trial, chosen, axes=(1, -1)) <= 1e-9
    beside &= np.arange(len(trial)).reshape(-1, *columns) != first
    second = np.where(beside, heights, -np.inf).argmax(axis=0)
    found = clearance_m * np.stack([chosen, trial[second]])
    return _improved(terrain, north_m, east_m, found, clearance_m)


def _improved(terrain: Terrain, north_m: Array, east_m: Array, feet: Array, clearance_m: float) -> Array:
    """Feet (F, ..., 2) moved uphill, by ever smaller steps."""
    feet, step = feet.copy(), _FIRST_STEP * clearance_m
    best = _height(terrain, north_m, east_m, feet, clearance_m)
    for _ in range(_HALVINGS):
        for way in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            moved = feet + step * np.array(way)
            size = np.linalg.norm(moved, axis=-1, keepdims=True)
            moved *= np.minimum(1.0, _OUTERMOST * clearance_m / np.maximum(size, 1e-12))
            height = _height(terrain, north_m, east_m, moved, clearance_m)
            better = height > best
            feet, best = np.where(better[..., None], moved, feet), np.where(better, height, best)
        step *= 0.5
    return feet


def _height(terrain: Terrain, north_m: Array, east_m: Array, feet: Array, clearance_m: float) -> Array:
    ground = ground_envelope_m(terrain, north_m + feet[..., 0], east_m + feet[..., 1])
    return np.asarray(ground + lift_m(feet, clearance_m))


def lift_m(feet: Array, clearance_m: float) -> Array:
    """Height (...) over a foot (..., 2) that keeps the distance to it."""
    return np.asarray(np.sqrt(np.maximum(clearance_m**2 - np.sum(feet * feet, axis=-1), 0.0)))
