"""Distances over time, planned, reported or true.

From the formation (Definition 1 and Eq. 4), between vehicles, to no-fly zones and to the ground.
"""

import numpy as np
from scipy.spatial.distance import pdist

from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.no_fly import nearest_zone_m, zones
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array


def formation_errors_m(positions_ned_m: Array, offsets_ned_m: Array) -> Array:
    """Errors |xi_i - h_i - c| of each vehicle (V, N), m, from positions xi and offsets h, both (V, N, 3).

    c is the formation's own centre, the mean of xi - h: a formation that flies elsewhere as a whole has no error.
    """
    seen = positions_ned_m - offsets_ned_m
    return np.asarray(np.linalg.norm(seen - seen.mean(axis=0), axis=-1))


def formation_error_m(positions_ned_m: Array, offsets_ned_m: Array) -> Array:
    """The formation error (N,), m: the largest error of all vehicles; zero where Eq. 4 holds."""
    return np.asarray(formation_errors_m(positions_ned_m, offsets_ned_m).max(axis=0))


def separations_m(positions_ned_m: Array) -> Array:
    """Distance (N,) between the nearest two of positions (V, N, 3); infinite for one vehicle."""
    if len(positions_ned_m) < 2:
        return np.full(positions_ned_m.shape[1], np.inf)
    return np.array([pdist(places).min() for places in positions_ned_m.swapaxes(0, 1)])


def zone_distances_m(scenario: Scenario, t_s: Array, positions_ned_m: Array, since_s: tuple[float, ...] = ()) -> Array:
    """Distances (V, N) of positions (V, N, 3) at plan times (N,) to the edge of the nearest no-fly zone.

    Negative inside, infinite without zones. `since_s`: from when each of `zones` counts; without it, always.
    """
    north, east, down = np.moveaxis(positions_ned_m, -1, 0)
    return nearest_zone_m(zones(scenario), t_s, north, east, -down, since_s)


def ground_distances_m(scenario: Scenario, positions_ned_m: Array, reach_m: float) -> Array:
    """Distances (V, N) of positions (V, N, 3) to the ground in any direction; `reach_m` where they are larger."""
    north, east, down = np.moveaxis(positions_ned_m, -1, 0)
    return ground_distance_m(scenario.terrain, north, east, -down, reach_m)
