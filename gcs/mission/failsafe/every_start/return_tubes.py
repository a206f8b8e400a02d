"""The least distance of two returning vehicles, if their return begins at any instant of an interval.

A start that is moved by a (level) and b (vertically) moves the return, at equal time, by no more than a + v b / c level
and b + s (b / c + a / v) vertically, at climb speed c, cruise speed v and sink speed s: a straight leg at constant
speed shortens the vector to its end, which never spreads two starts. Two starts that move alike move their returns
alike, but for the shares of the legs that are done. Above its end a vehicle has no level uncertainty, on the ground
none at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.mission.failsafe.rtl_motion import Motion, ReturnSpeeds, places_at
from gcs.mission.predicted.closest_approach import least_distance
from gcs.physics.quadrotor import Array
from gcs.plan.verification.proof.subdivision import Mask, Rows


@dataclass(frozen=True)
class Tubes:
    """Returns (..., K) from the middle of intervals, and how far those from other instants are from them."""

    times_s: Array  # (..., 5)
    places_ned_m: Array  # (..., 5, 3)
    level_m: Array  # (...) of the starts
    vertical_m: Array
    top_m: Array  # of the height at which they return
    speeds: ReturnSpeeds

    @classmethod
    def of(cls, motion: Motion, level_m: Array, vertical_m: Array, climbs_m: Array, speeds: ReturnSpeeds) -> Tubes:
        """The tubes around a motion; `climbs_m` (...) is negative where a start is above its return altitude."""
        top_m = np.clip(vertical_m - climbs_m, 0.0, vertical_m)
        return cls(motion[0], motion[1], level_m, vertical_m, top_m, speeds)

    def __getitem__(self, index: tuple[Rows, ...]) -> Tubes:
        return Tubes(
            self.times_s[index],
            self.places_ned_m[index],
            self.level_m[index],
            self.vertical_m[index],
            self.top_m[index],
            self.speeds,
        )

    @property
    def _late_s(self) -> tuple[Array, Array, Array]:
        """How much (...) the ends of climb, cruise and descent may be earlier or later."""
        climbed_s = self.vertical_m / self.speeds.climb_mps
        arrived_s = climbed_s + self.level_m / self.speeds.cruise_mps
        return climbed_s, arrived_s, arrived_s + self.top_m / self.speeds.sink_mps

    def marks_s(self) -> Array:
        """Times (..., 10) between which the uncertainty does not change and motions are straight."""
        climbed_s, arrived_s, landed_s = self._late_s
        begin, climbed, across, sinks, landed = np.moveaxis(self.times_s, -1, 0)
        marks = [begin, climbed - climbed_s, climbed, climbed + climbed_s, across, across + arrived_s]
        marks += [sinks - arrived_s, sinks, landed, landed + landed_s]
        return np.asarray(np.maximum(np.stack(marks, axis=-1), 0.0))

    def climbing(self, t_s: Array) -> Mask:
        """Whether (..., I) every return still climbs."""
        return np.asarray(t_s <= (self.times_s[..., 1] - self._late_s[0])[..., None])

    def level_reach_m(self, t_s: Array) -> Array:
        """How far (..., I) returns may be from the middle one, level."""
        climbed_s, arrived_s, _ = self._late_s
        across_m = self.level_m + self.speeds.cruise_mps * climbed_s
        over = t_s >= (self.times_s[..., 2] + arrived_s)[..., None]
        return np.where(over, 0.0, np.where(self.climbing(t_s), self.level_m[..., None], across_m[..., None]))

    def shortened_m(self, t_s: Array, until_s: Array) -> Array:
        """How far (..., I) returns may be, level, from the middle one moved like its start; until `until_s`.

        The leg turns and shortens the move across it, by the share of the leg that is done.
        """
        climbed_s = self._late_s[0]
        leg = self.places_ned_m[..., 2, :2] - self.places_ned_m[..., 1, :2]
        shortest_m = np.maximum(np.hypot(leg[..., 0], leg[..., 1]) - self.level_m, 1e-6)
        passed_s = np.maximum(until_s - (self.times_s[..., 1] - climbed_s)[..., None], 0.0)
        share = np.minimum(self.speeds.cruise_mps * passed_s / shortest_m[..., None], 1.0)
        late_m = self.speeds.cruise_mps * climbed_s
        return np.where(self.climbing(t_s), 0.0, share * self.level_m[..., None] + late_m[..., None])

    def vertical_reach_m(self, t_s: Array) -> Array:
        """How far (..., I) returns may be from the middle one, vertically."""
        climbed_s, arrived_s, landed_s = self._late_s
        climbs = t_s < (self.times_s[..., 1] + climbed_s)[..., None]
        sinks = t_s > (self.times_s[..., 3] - arrived_s)[..., None]
        landed = t_s >= (self.times_s[..., 4] + landed_s)[..., None]
        reach_m = np.where(climbs, self.vertical_m[..., None], self.top_m[..., None])
        reach_m = reach_m + np.where(sinks, (self.speeds.sink_mps * arrived_s)[..., None], 0.0)
        return np.where(landed, 0.0, reach_m)


def least_of_pairs(first: Tubes, second: Tubes, against_m: tuple[Array, Array]) -> tuple[Array, Array]:
    """Two distances (M,) of pairs: one that no return of the interval is below, and the least of the middle one.

    `against_m` is how far, level and vertically, two starts move against each other.
    """
    marks_s = np.sort(np.concatenate([first.marks_s(), second.marks_s()], axis=-1), axis=-1)
    places = [places_at((one.times_s, one.places_ned_m), marks_s) for one in (first, second)]
    between = places[1] - places[0]
    middle_s = 0.5 * (marks_s[:, :-1] + marks_s[:, 1:])
    both = first.climbing(middle_s) & second.climbing(middle_s)
    level_m = first.level_reach_m(middle_s) + second.level_reach_m(middle_s)
    vertical_m = first.vertical_reach_m(middle_s) + second.vertical_reach_m(middle_s)
    shortened_m = sum(one.shortened_m(middle_s, marks_s[:, 1:]) for one in (first, second))
    level_m = np.minimum(level_m, against_m[0][:, None] + shortened_m)
    vertical_m = np.where(both, against_m[1][:, None], vertical_m)
    begin, end = between[:, :-1], between[:, 1:]
    distance_m, _ = least_distance(begin, end)
    beside_m, _ = least_distance(begin[..., :2], end[..., :2])
    over_m = np.where(begin[..., 2] * end[..., 2] <= 0.0, 0.0, np.minimum(*np.abs((begin[..., 2], end[..., 2]))))
    apart_m = np.hypot(np.maximum(beside_m - level_m, 0.0), np.maximum(over_m - vertical_m, 0.0))
    low_m = np.maximum(distance_m - np.hypot(level_m, vertical_m), apart_m)
    return np.asarray(low_m.min(axis=-1)), np.asarray(distance_m.min(axis=-1))
