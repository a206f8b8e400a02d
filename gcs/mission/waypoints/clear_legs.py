"""Which straight legs keep the clearance over the ground, in any direction.

The choice of waypoints may be a little wrong: `gcs.mission.check` proves the clearance of missions as written.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gcs.mission.check.flight_limits import limits_of
from gcs.mission.waypoints.placement import Allowed
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.ground_distance import steepness
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario, Terrain

_OVER_M, _OVER_SHARE = 0.02, 0.25  # above the required clearance, for rounding; and of the tolerance, at most
_RINGS, _ANGLES = (0.3, 0.6, 0.9), 12  # places around another one, as shares of the clearance


def clear_legs(scenario: Scenario, t_s: Array, position_ned_m: Array) -> Allowed:
    """Return the test of legs between samples at `t_s` (N,), flown by all vehicles at positions (V, N, 3)."""
    least_m = limits_of(scenario).clearance_m + min(_OVER_M, _OVER_SHARE * scenario.mission.tolerance_m)

    @cache  # the search asks for the same legs again and again
    def allowed(first: int, last: int) -> bool:
        share = ((t_s[first : last + 1] - t_s[first]) / (t_s[last] - t_s[first]))[:, None]
        begin, end = position_ned_m[:, None, first], position_ned_m[:, None, last]
        places = begin + share * (end - begin)  # (V, M, 3)
        above_m = -places[..., 2] - ground_height_m(scenario.terrain, places[..., 0], places[..., 1])
        return not np.any(above_m < least_m) and not np.any(short_of_m(scenario.terrain, places, least_m) > 0.0)

    return allowed


def short_of_m(terrain: Terrain, places_ned_m: Array, clearance_m: float) -> Array:
    """How much nearer (...) to the ground than the clearance places (..., 3) are; 0 or less where they are clear."""
    above_m = -places_ned_m[..., 2] - ground_height_m(terrain, places_ned_m[..., 0], places_ned_m[..., 1])
    short_m = clearance_m - above_m
    # Where the ground is steep, that beside a place is nearer than that below it.
    near = (above_m > 0.0) & (above_m < clearance_m * np.hypot(1.0, steepness(terrain)))
    north_m, east_m, down_m = places_ned_m[near].T
    if not north_m.size:
        return np.asarray(short_m)
    angles = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    radius_m = (np.array(_RINGS) * clearance_m)[:, None, None]
    beside = north_m + radius_m * np.cos(angles)[:, None], east_m + radius_m * np.sin(angles)[:, None]
    over_m = np.maximum(-down_m - ground_height_m(terrain, *beside), 0.0)
    short_m[near] = clearance_m - np.minimum(above_m[near], np.hypot(radius_m, over_m).min(axis=(0, 1)))
    return np.asarray(short_m)
