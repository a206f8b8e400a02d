"""Numbers of a plan over time for the pictures: size of the formation, distance to the ground, separation."""

import numpy as np

from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.formation_checks import nearest_pair_m
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import Array


def places_ned_m(plan: Plan, t_s: Array) -> Array:
    """Where every vehicle is (V, N, 3)."""
    return plan.states(t_s)[..., POSITION]


def size(plan: Plan, t_s: Array) -> Array:
    """Distance of the farthest vehicle from the leader over what it is at t = 0 (N,); turning does not change it."""

    def farthest_m(instants: Array) -> Array:
        return np.asarray(np.linalg.norm(plan.offsets(instants), axis=2).max(axis=0))

    return np.asarray(farthest_m(t_s) / farthest_m(np.zeros(1)))


def clearance_m(plan: Plan, t_s: Array) -> Array:
    """Least distance of any vehicle to the exact ground, in any direction (N,)."""
    places, terrain = places_ned_m(plan, t_s), plan.scenario.terrain
    north, east, up = places[..., 0], places[..., 1], -places[..., 2]
    lowest_m = (up - ground_height_m(terrain, north, east)).min(axis=0)
    away = [
        ground_distance_m(terrain, north[:, n], east[:, n], up[:, n], float(reach_m)).min()
        for n, reach_m in enumerate(lowest_m)
    ]
    return np.array(away)


def nearest_m(plan: Plan, t_s: Array) -> Array:
    """Least distance between any two vehicles (N,)."""
    return np.array([nearest_pair_m(places) for places in np.swapaxes(plan.offsets(t_s), 0, 1)])
