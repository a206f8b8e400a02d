"""Which instants of a trajectory become waypoints: few, and close in space and in time.

Knows: sampled positions. Does not know: plans, items, autopilots.
A leg is flown straight at constant speed: length / time, or the slowest an autopilot flies and then a wait. It may
leave the path by `path_m` (from every sample to the leg, in 3D) and be away from where the plan is *at the same
time* by `time_m`, so a leg along which the speed changes is split even where the path is straight. For an autopilot
that cannot keep its speed over short legs they are as long as it needs, and leave the path by more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcs.physics.quadrotor import Array

_EVENING_STEPS = 6
_STILL_MPS = 0.02  # who hovers needs no length
_LENGTHS_M = np.geomspace(0.05, 300.0, 100)

Sustained = Callable[[float], float]  # length of legs, m -> the speed that is kept up over such legs, m/s


@dataclass(frozen=True)
class Deviation:
    """Distances of straight, constant-speed legs from the samples, over all vehicles: limits, or largest found."""

    path_m: float  # from a sample to the leg
    time_m: float  # from a sample to the vehicle on the leg at the same time


@dataclass(frozen=True)
class SampledFlight:
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


def waypoint_indices(flown: SampledFlight, limits: Deviation) -> list[int]:
    """Samples to keep, first and last included.

    Every leg is the longest that holds both limits; then the limits are tightened as far as the number of legs
    allows, which spreads what would be a short last leg over all. A leg from one sample to the next is always
    taken: sample finely enough.
    """
    best = fewest_indices(flown, limits)
    low, high = 0.0, 1.0
    for _ in range(_EVENING_STEPS):
        middle = 0.5 * (low + high)
        indices = fewest_indices(flown, Deviation(limits.path_m * middle, limits.time_m * middle))
        if len(indices) > len(best):
            low = middle
        else:
            best, high = indices, middle
    return best


def deviation(flown: SampledFlight, indices: list[int]) -> Deviation:
    """The largest errors of the legs between these samples."""
    path_m, time_m = np.max([flown.leg_errors_m(i, j) for i, j in pairwise(indices)], axis=0)
    return Deviation(float(path_m), float(time_m))


def gentle_indices(flown: SampledFlight, limits: Deviation, sustained: Sustained, share: float) -> list[int]:
    """Samples to keep: the longest legs that hold both limits, but none too short for its speed.

    A leg is long enough where `share` of its speed, halfway between the mean and the highest of the samples, is
    sustained for every vehicle.
    """
    pace = _Pace(flown, sustained, share)
    both = np.array([limits.path_m, limits.time_m])
    last = len(flown.t_s) - 1
    indices = [0]
    while indices[-1] < last:
        end = _longest_leg(flown, both, indices[-1])
        while end < last and not pace.holds(indices[-1], end):
            end += 1
        indices.append(end)
    while len(indices) > 2 and not pace.holds(indices[-2], last):
        del indices[-2]
    return indices


class _Pace:
    """Whether legs between samples are long enough."""

    def __init__(self, flown: SampledFlight, sustained: Sustained, share: float) -> None:
        self._flown = flown
        self._kept_mps = np.array([sustained(length) for length in _LENGTHS_M.tolist()]) / share
        self._steps_m = np.linalg.norm(np.diff(flown.position_ned_m, axis=1), axis=-1)  # (V, N-1)
        self._step_mps = self._steps_m / np.diff(flown.t_s)

    def holds(self, i: int, j: int) -> bool:
        """For the leg from sample i to j."""
        ends = self._flown.position_ned_m
        length_m = np.linalg.norm(ends[:, j] - ends[:, i], axis=-1)
        mean_mps = self._steps_m[:, i:j].sum(axis=1) / (self._flown.t_s[j] - self._flown.t_s[i])
        speed_mps = 0.5 * (mean_mps + self._step_mps[:, i:j].max(axis=1))
        return bool(np.all(np.interp(length_m, _LENGTHS_M, self._kept_mps, left=0.0) + _STILL_MPS >= speed_mps))


def fewest_indices(flown: SampledFlight, limits: Deviation) -> list[int]:
    """The longest legs that hold both limits, one after the other from the first sample."""
    both = np.array([limits.path_m, limits.time_m])
    indices = [0]
    while indices[-1] < len(flown.t_s) - 1:
        indices.append(_longest_leg(flown, both, indices[-1]))
    return indices


def _longest_leg(flown: SampledFlight, limits: Array, start: int) -> int:
    """End of the leg from `start`: gallop ahead in doubling steps, then halve the gap to the first leg that fails."""
    last = len(flown.t_s) - 1

    def holds(end: int) -> bool:
        return bool(np.all(flown.leg_errors_m(start, end) <= limits))

    good, step = start + 1, 1
    while good + step <= last and holds(good + step):
        good, step = good + step, 2 * step
    bad = min(good + step, last + 1)
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good
