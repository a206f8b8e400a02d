"""Placement of waypoints: few samples of a trajectory, with legs that are close to it in space and in time.

A leg is flown straight at constant speed: length / time, or the lowest speed of the autopilot and then a delay. Its
distance from every sample (3D) is at most `path_m`, and its distance from the plan *at the same time* at most `time_m`;
so a leg along which the speed changes is split even if the path is straight. A leg that a flight does not allow, over a
slope for example, is split too: aside by the limit may be lower by much more. An autopilot that does not keep its speed
over short legs gets legs as long as it needs; these may exceed both limits. Drawn points stay waypoints all the same.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from gcs.mission.flight_limits import limits_of
from gcs.scenario.environment.ground_distance import steepness
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario, Terrain
from gcs.types import Array

_EVENING_STEPS = 6
_STILL_MPS = 0.02  # a hovering vehicle needs no length
_LENGTHS_M = np.geomspace(0.05, 300.0, 100)
Sustained = Callable[[float], float]  # length of legs, m -> speed sustained over such legs, m/s
Allowed = Callable[[int, int], bool]  # first and last sample of a leg -> whether it may be flown straight
_OVER_M, _OVER_SHARE = 0.02, 0.25  # above the required clearance, for rounding; and of the tolerance, at most
_RINGS, _ANGLES = (0.3, 0.6, 0.9), 12  # places around another one, as shares of the clearance


@dataclass(frozen=True)
class Deviation:
    """Distances of straight, constant-speed legs from the samples, over all vehicles: limits, or the largest values."""

    path_m: float  # from a sample to the leg
    time_m: float  # from a sample to the vehicle on the leg at the same time


@dataclass(frozen=True)
class SampledFlight:
    """Samples of a trajectory: times (N,), positions (V, N, 3) in NED of all vehicles, lowest speed of a leg.

    `allowed` refuses legs for other reasons than their deviation. `drawn` are the samples at route points, in order:
    no leg passes over them.
    """

    t_s: Array
    position_ned_m: Array
    speed_min_mps: float = 0.0
    allowed: Allowed | None = None
    drawn: tuple[int, ...] = ()

    def farthest(self, start: int) -> int:
        """The last sample at which a leg from `start` may end."""
        return next((index for index in self.drawn if index > start), len(self.t_s) - 1)

    def leg_errors_m(self, i: int, j: int) -> Array:
        """The (path, time) error (2,) of the leg from sample i to j."""
        along = self.position_ned_m[:, i : j + 1] - self.position_ned_m[:, i : i + 1]
        chord = along[:, -1:]
        length2 = np.maximum(np.sum(chord * chord, axis=-1, keepdims=True), 1e-18)
        foot = np.clip(np.sum(along * chord, axis=-1, keepdims=True) / length2, 0.0, 1.0)
        elapsed = (self.t_s[i : j + 1] - self.t_s[i])[None, :, None]
        rate = np.maximum(1.0 / (self.t_s[j] - self.t_s[i]), self.speed_min_mps / np.sqrt(length2))
        offsets = along - np.stack([foot * chord, np.minimum(elapsed * rate, 1.0) * chord])
        return np.asarray(np.sqrt(np.max(np.sum(offsets * offsets, axis=-1), axis=(1, 2))))


def waypoint_indices(flown: SampledFlight, limits: Deviation) -> list[int]:
    """Indices of the samples to keep, first and last included.

    Every leg is the longest within both limits. Then the limits are tightened as far as the number of legs allows, so
    that the last leg is not short. A leg from one sample to the next is always accepted: sample finely enough.
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
    """Indices of the samples to keep: the longest legs within both limits, but none too short for its speed.

    A leg is long enough if every vehicle sustains `share` of its speed over it. Its speed is halfway between the mean
    and the highest of the samples.
    """
    pace = _Pace(flown, sustained, share)
    both = np.array([limits.path_m, limits.time_m])
    last = len(flown.t_s) - 1
    indices = [0]
    while indices[-1] < last:
        farthest = flown.farthest(indices[-1])
        end = _longest_leg(flown, both, indices[-1])
        while end < farthest and not pace.sustained(indices[-1], end):
            end += 1
        while end == farthest and indices[-1] not in (0, *flown.drawn) and not pace.sustained(indices[-1], end):
            del indices[-1]
        indices.append(end)
    return indices


class _Pace:
    """The test whether a leg between samples is long enough for its speed."""

    def __init__(self, flown: SampledFlight, sustained: Sustained, share: float) -> None:
        self._flown = flown
        self._kept_mps = np.array([sustained(length) for length in _LENGTHS_M.tolist()]) / share
        self._steps_m = np.linalg.norm(np.diff(flown.position_ned_m, axis=1), axis=-1)  # (V, N-1)
        self._step_mps = self._steps_m / np.diff(flown.t_s)

    def sustained(self, i: int, j: int) -> bool:
        """Whether the leg from sample i to j is long enough."""
        ends = self._flown.position_ned_m
        length_m = np.linalg.norm(ends[:, j] - ends[:, i], axis=-1)
        mean_mps = self._steps_m[:, i:j].sum(axis=1) / (self._flown.t_s[j] - self._flown.t_s[i])
        speed_mps = 0.5 * (mean_mps + self._step_mps[:, i:j].max(axis=1))
        return bool(np.all(np.interp(length_m, _LENGTHS_M, self._kept_mps, left=0.0) + _STILL_MPS >= speed_mps))


def fewest_indices(flown: SampledFlight, limits: Deviation) -> list[int]:
    """Indices of the samples to keep: the longest legs within both limits, one after the other."""
    both = np.array([limits.path_m, limits.time_m])
    indices = [0]
    while indices[-1] < len(flown.t_s) - 1:
        indices.append(_longest_leg(flown, both, indices[-1]))
    return indices


def _longest_leg(flown: SampledFlight, limits: Array, start: int) -> int:
    """The end of the longest leg from `start`: doubling steps, then bisection to the first leg that exceeds a limit."""
    last = flown.farthest(start)

    def within(end: int) -> bool:
        near = bool(np.all(flown.leg_errors_m(start, end) <= limits))
        return near and (flown.allowed is None or flown.allowed(start, end))

    good, step = start + 1, 1
    while good + step <= last and within(good + step):
        good, step = good + step, 2 * step
    bad = min(good + step, last + 1)
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if within(middle) else (good, middle)
    return good


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
    """By how much (...) places (..., 3) are nearer to the ground than the clearance; 0 or less where they are not."""
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
