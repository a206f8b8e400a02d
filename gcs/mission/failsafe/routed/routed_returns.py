"""The returns of a fleet as the ground station flies them, from every instant of a plan, and whether they are safe."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from gcs.mission.failsafe.every_start.ground_below import highest_along_m
from gcs.mission.failsafe.return_routes import ReturnRoutes
from gcs.mission.failsafe.routed.routed_motion import PiecewiseMotion, Stops, routed_motion, stops
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.mission.machine_independent import EQUAL, first_least
from gcs.mission.predicted.closest_approach import least_distance
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.scenario.environment.terrain import ground_envelope_m

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_LOOKS_M = 5.0  # between samples of the ground under a way
_SAMPLES = 40  # of the climbs, and of the descents
_CLIMBED, _SINKING = 5, -4  # knots at which a vehicle has reached its return altitude, and leaves it


@dataclass(frozen=True)
class RoutedReturns:
    """Returns of V vehicles from plan times t_s (N,). Rows of `stop` and ways (V * N, W, 2): vehicle by vehicle."""

    name: str
    t_s: Array
    stop: Stops
    ways_m: Array
    length_m: Array  # (V, N), infinite without a way
    end_down_m: Array  # (V * N,)

    def motion(self, top_down_m: Array, speeds: ReturnSpeeds) -> PiecewiseMotion:
        """All motions; top_down_m (V,) are the heights at which vehicles return. A higher one keeps its height."""
        tops = np.minimum(np.repeat(top_down_m, len(self.t_s)), self.stop.end_ned_m[:, 2])
        return routed_motion(self.stop, self.ways_m, tops, self.end_down_m, speeds)


@dataclass(frozen=True)
class NoWay:
    """A vehicle that lands where it is, because no way leads home, if its return begins in [from_s, to_s]."""

    sysid: int
    from_s: float
    to_s: float


def routed_returns(
    plan: Plan, routes: ReturnRoutes, period_s: float, within: tuple[float, float] | None = None
) -> list[RoutedReturns]:
    """Two cases: returns to homes, and to the end of the shorter way of home and landing point."""
    begin_s, end_s = within or (plan.t_start_s, plan.t_end_s)
    count = max(2, math.ceil((end_s - begin_s) / period_s) + 1)
    t_s = np.clip(np.linspace(begin_s, end_s, count), plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    leader = plan.leader_trajectory.state(t_s)
    places = (leader[:, POSITION] + plan.offsets(t_s)).reshape(-1, 3)
    velocities = (leader[:, VELOCITY] + plan.offsets(t_s, 1)).reshape(-1, 3)
    all_s = np.tile(t_s, len(plan.sysids))
    stop = stops(places, velocities, all_s, routes)
    ends = [np.repeat(end, count, axis=0) for end in (plan.pads_ned_m, plan.landing_points_ned_m)]
    homes, landings = (routes.ways(stop.end_ned_m[:, :2], end[:, :2], all_s) for end in ends)
    home_first = homes.length_m <= landings.length_m
    points = max(homes.points_m.shape[1], landings.points_m.shape[1])
    wide = [
        np.append(w.points_m, np.repeat(w.points_m[:, -1:], points - w.points_m.shape[1], axis=1), axis=1)
        for w in (homes, landings)
    ]
    shape = len(plan.sysids), count
    cases = [RoutedReturns("home", t_s, stop, homes.points_m, homes.length_m.reshape(shape), ends[0][:, 2])]
    if not home_first.all():
        ways = np.where(home_first[:, None, None], *wide)
        lengths = np.minimum(homes.length_m, landings.length_m).reshape(shape)
        cases.append(RoutedReturns("nearest", t_s, stop, ways, lengths, np.where(home_first, *(e[:, 2] for e in ends))))
    return cases


def highest_under_ways_m(plan: Plan, cases: list[RoutedReturns]) -> float:
    """A height above the origin's that no ground below these ways is above.

    It is that of the smooth envelope every `_LOOKS_M`, and of the ground between.
    """
    highest = -math.inf
    for case in cases:
        brakes = np.stack([case.stop.places[:, :2], case.stop.half_ned_m[:, :2]], axis=1)
        tracks = np.concatenate([brakes, case.ways_m], axis=1)
        lines = shapely.linestrings(tracks[np.ptp(tracks, axis=1).any(axis=1)])
        along = shapely.get_coordinates(shapely.segmentize(lines, _LOOKS_M)) if len(lines) else tracks[:, 0]
        places = np.concatenate([along, tracks[:, 0]])
        highest = max(highest, float(np.max(ground_envelope_m(plan.scenario.terrain, places[:, 0], places[:, 1]))))
        begin_m, end_m = (legs.reshape(-1, 2) for legs in (tracks[:, :-1], tracks[:, 1:]))
        moved = np.any(begin_m != end_m, axis=1)
        highest = highest_along_m(plan, begin_m[moved], end_m[moved], highest)
    return highest


def without_way(plan: Plan, cases: list[RoutedReturns]) -> Iterator[NoWay]:
    """The intervals in which a return of a vehicle to its home would have no way."""
    for row, sysid in enumerate(plan.sysids):
        shut = np.isinf(cases[0].length_m[row])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], shut, [False]])))
        for begin, end in edges.reshape(-1, 2).tolist():
            yield NoWay(sysid, float(cases[0].t_s[begin]), float(cases[0].t_s[end - 1]))


def nearest_pair(
    case: RoutedReturns, top_down_m: Array, speeds: ReturnSpeeds, apart_m: float
) -> tuple[float, float, tuple[int, int]]:
    """The least distance of two vehicles of all returns, the plan time at which it begins, and their rows.

    Vehicles at return altitudes that are `apart_m` apart count as such: then only climbs and descents are looked at.
    """
    vehicles, count = len(top_down_m), len(case.t_s)
    motion = case.motion(top_down_m, speeds)
    knots_s = motion.times_s.reshape(vehicles, count, -1)
    tops = np.sort(np.minimum(top_down_m[:, None], case.stop.end_ned_m[:, 2].reshape(vehicles, count)), axis=0)
    cruise_m = np.diff(tops, axis=0).min(axis=0)
    climbed_s, sinking_s = knots_s[..., _CLIMBED].max(axis=0), knots_s[..., _SINKING].min(axis=0)
    together = (cruise_m < apart_m) | (sinking_s < climbed_s)
    sinking_s = np.where(together, climbed_s, sinking_s)
    shares = np.linspace(0.0, 1.0, _SAMPLES)
    landed_s = knots_s[..., -1].max(axis=0)
    looks_s = np.concatenate(
        [climbed_s[:, None] * shares, sinking_s[:, None] + (landed_s - sinking_s)[:, None] * shares], axis=1
    )
    places = motion.places_at(np.tile(looks_s, (vehicles, 1))).reshape(vehicles, count, -1, 3)
    best = math.inf, math.nan, (0, 0)
    for first, second in itertools.combinations(range(vehicles), 2):
        between = places[second] - places[first]
        distance, _ = least_distance(between[:, :-1], between[:, 1:])
        distance[:, _SAMPLES - 1] = np.where(together, distance[:, _SAMPLES - 1], np.inf)
        at = first_least(distance.min(axis=1))
        least = float(distance.min())
        if least < best[0] - EQUAL:
            best = least, float(case.t_s[at]), (first, second)
    return best
