"""Which instants of a trajectory become waypoints: few, and close in space and in time.

Knows: sampled positions. Does not know: plans, items, autopilots.
A leg is flown straight at constant speed: length / time, or the slowest an autopilot flies and then a wait. It may
leave the path by `path_m` (from every sample to the leg, in 3D) and be away from where the plan is *at the same
time* by `time_m`, so a leg along which the speed changes is split even where the path is straight.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.quadrotor import Array

_EVENING_STEPS = 6


@dataclass(frozen=True)
class Deviation:
    """Distances of straight, constant-speed legs from the samples, over all vehicles: limits, or largest found."""

    path_m: float  # from a sample to the leg
    time_m: float  # from a sample to the vehicle on the leg at the same time


@dataclass(frozen=True)
class Flown:
    """Samples of a trajectory and how it will be flown: times (N,), positions (V, N, 3) in NED of all vehicles."""

    t_s: Array
    position_ned_m: Array
    speed_min_mps: float = 0.0

    def leg_errors_m(self, i: int, j: int) -> Array:
        """(path, time) error (2,) of the leg from sample i to j."""
        along = self.position_ned_m[:, i : j + 1] - self.position_ned_m[:, i : i + 1]
        chord = along[:, -1:]
        length2 = np.maximum(np.sum(chord * chord, axis=-1, keepdims=True), 1e-18)
        foot = np.clip(np.sum(along * chord, axis=-1, keepdims=True) / length2, 0.0, 1.0)
        elapsed = (self.t_s[i : j + 1] - self.t_s[i])[None, :, None]
        rate = np.maximum(1.0 / (self.t_s[j] - self.t_s[i]), self.speed_min_mps / np.sqrt(length2))
        offsets = along - np.stack([foot * chord, np.minimum(elapsed * rate, 1.0) * chord])
        return np.asarray(np.sqrt(np.max(np.sum(offsets * offsets, axis=-1), axis=(1, 2))))


def waypoint_indices(flown: Flown, limits: Deviation) -> list[int]:
    """Samples to keep, first and last included.

    Every leg is the longest that holds both limits; then the limits are tightened as far as the number of legs
    allows, which spreads what would be a short last leg over all. A leg from one sample to the next is always
    taken: sample finely enough.
    """
    both = np.array([limits.path_m, limits.time_m])
    best = _longest_legs(flown, both)
    low, high = 0.0, 1.0
    for _ in range(_EVENING_STEPS):
        middle = 0.5 * (low + high)
        indices = _longest_legs(flown, both * middle)
        if len(indices) > len(best):
            low = middle
        else:
            best, high = indices, middle
    return best


def deviation(flown: Flown, indices: list[int]) -> Deviation:
    """The largest errors of the legs between these samples."""
    path_m, time_m = np.max([flown.leg_errors_m(i, j) for i, j in pairwise(indices)], axis=0)
    return Deviation(float(path_m), float(time_m))


def _longest_legs(flown: Flown, limits: Array) -> list[int]:
    """Greedy: from each waypoint gallop ahead in doubling steps, then halve the gap to the first leg that fails."""
    last = len(flown.t_s) - 1
    indices = [0]
    while indices[-1] < last:
        start = indices[-1]

        def holds(end: int, start: int = start) -> bool:
            return bool(np.all(flown.leg_errors_m(start, end) <= limits))

        good, step = start + 1, 1
        while good + step <= last and holds(good + step):
            good, step = good + step, 2 * step
        bad = min(good + step, last + 1)
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if holds(middle) else (good, middle)
        indices.append(good)
    return indices
