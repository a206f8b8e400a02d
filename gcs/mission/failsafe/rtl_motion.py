"""The motion of a fleet that returns (RTL): all vehicles begin at once, climb, fly straight to their ends, and descend.

Return altitudes are arguments here; `rtl_altitudes` chooses them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.mission.predicted.closest_approach import least_distance
from gcs.physics.quadrotor import Array

Motion = tuple[Array, Array]  # times since the return began (..., K), places (..., K, 3) in NED


@dataclass(frozen=True)
class ReturnSpeeds:
    """Speeds of a return, m/s, and the longest wait above its end, s."""

    climb_mps: float
    cruise_mps: float
    sink_mps: float
    wait_s: float


@dataclass(frozen=True)
class Returning:
    """Begins and ends (V, N, 3) of a fleet's returns from instants t_s (N,).

    `datum_m` (V, N) is the height that return altitudes count from: that of home, on PX4 that of the return's end.
    `waits_s` (V,) or (V, N) are the waits above the ends, if they differ between vehicles.
    """

    name: str
    t_s: Array
    from_ned_m: Array
    to_ned_m: Array
    datum_m: Array
    speeds: ReturnSpeeds
    waits_s: Array | None = None

    def motion(self, row: int, altitude_m: Array | float) -> Motion:
        """Motions of one vehicle from every instant. Altitudes of shape (..., 1) give times (..., N, K).

        A vehicle above its return altitude stays at its height.
        """
        start, end, speeds = self.from_ned_m[row], self.to_ned_m[row], self.speeds
        top_down = np.minimum(start[:, 2], -(self.datum_m[row] + np.asarray(altitude_m, dtype=np.float64)))
        shape = top_down.shape
        flat_m = np.broadcast_to(np.hypot(end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]), shape)
        climb_s = (start[:, 2] - top_down) / speeds.climb_mps
        sink_s = np.maximum(end[:, 2] - top_down, 0.0) / speeds.sink_mps
        wait_s = speeds.wait_s if self.waits_s is None else self.waits_s[row]
        steps = [np.zeros(shape), climb_s, flat_m / speeds.cruise_mps, np.broadcast_to(wait_s, shape), sink_s]
        places = np.empty((*shape, len(steps), 3))
        places[..., :2, :2] = start[:, None, :2]
        places[..., 2:, :2] = end[:, None, :2]
        places[..., 0, 2] = start[:, 2]
        places[..., 1:4, 2] = top_down[..., None]
        places[..., 4, 2] = np.maximum(end[:, 2], top_down)
        return np.cumsum(np.stack(steps, axis=-1), axis=-1), places


def pair_distances(first: Motion, second: Motion) -> Array:
    """The least distance (...) of two vehicles that begin to return at the same instant; leading axes broadcast."""
    instants = np.sort(np.concatenate(np.broadcast_arrays(first[0], second[0]), axis=-1), axis=-1)
    between = places_at(second, instants) - places_at(first, instants)
    distance, _ = least_distance(between[..., :-1, :], between[..., 1:, :])
    return np.asarray(distance.min(axis=-1))


def places_at(motion: Motion, instants: Array) -> Array:
    """Places (..., I, 3) at instants (..., I) since the return began; vehicles rest before and after their motion."""
    times, places = motion
    shape = instants.shape[:-1]
    times = np.broadcast_to(times, (*shape, times.shape[-1]))
    places = np.broadcast_to(places, (*shape, *places.shape[-2:]))
    moved = np.repeat(places[..., :1, :], instants.shape[-1], axis=-2)
    for leg in range(times.shape[-1] - 1):
        begin, end = times[..., leg, None], times[..., leg + 1, None]
        share = np.clip((instants - begin) / np.maximum(end - begin, 1e-12), 0.0, 1.0)
        # A leg that takes no time is done as soon as it begins.
        share = np.where((end <= begin) & (instants >= begin), 1.0, share)
        moved += share[..., None] * (places[..., leg + 1, None, :] - places[..., leg, None, :])
    return moved
