"""Returns of a fleet as the ground station flies them, from any instant of a plan, and their safety."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gcs.mission.machine_independent import EQUAL, first_least
from gcs.mission.predicted.closest_approach import least_distance
from gcs.mission.returns.ground_below import highest_along_m
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_motion import PiecewiseMotion, Stops, routed_motion, stops
from gcs.mission.returns.rtl_cases import ReturnSpeeds, ReturnTo, WorstReturn, landing_ends_ned_m
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.types import Array

_LOOKS_M = 5.0  # between samples of the ground under a way
_SAMPLES = 40  # of the climbs, and of the descents
_RESTS_S = 0.01  # a shorter brake is none
_CLIMBED, _SINKING = 5, -4  # knots at which a vehicle has reached its return altitude, and leaves it
RESOLUTION_S = 1e-3
_JUMP = 0.05  # corners jump by metres; the strengths of brakes, m/s^2, are at least 0.09 apart
_NEARER_M = 0.05  # less is not looked for
_AT_ONCE = 32  # instants
_NEAR_MAX, _SOLVED_MAX = 150, 500  # instants, after which none is added near the least distance; and none at all
_PAIRS_MAX = 66  # of vehicles; a fleet that has more is looked at once more only


@dataclass(frozen=True)
class RoutedReturns:
    """Returns of V vehicles from plan times t_s (N,). Rows of `stop` and ways (V * N, W, 2): vehicle by vehicle."""

    to: ReturnTo
    t_s: Array
    stop: Stops
    ways_m: Array
    length_m: Array  # (V, N), infinite without a way
    end_down_m: Array  # (V * N,)

    def kinds(self) -> Array:
        """What (N, V, 6) jumps where ways do: the first corner, the end, and how the vehicle brakes."""
        stop, duration_s = self.stop, self.stop.duration_s
        run = stop.end_ned_m - stop.places - 0.5 * stop.velocities * duration_s[:, None]
        aside = stop.velocities[:, 0] * run[:, 1] - stop.velocities[:, 1] * run[:, 0]
        level_mps = np.hypot(stop.velocities[:, 0], stop.velocities[:, 1])
        rests = (duration_s < _RESTS_S) | (level_mps < _RESTS_S)
        strength = [
            np.divide(aside, level_mps * duration_s**2, out=np.zeros_like(aside), where=~rests),
            np.divide(np.linalg.norm(stop.velocities, axis=1), duration_s, out=np.zeros_like(aside), where=~rests),
        ]
        found = np.column_stack([self.ways_m[:, 2], self.ways_m[:, -1], *strength])
        vehicles = len(self.length_m)
        return np.ascontiguousarray(found.reshape(vehicles, len(self.t_s), -1).swapaxes(0, 1))

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


def instants_s(plan: Plan, period_s: float) -> Array:
    """Instants (N,) of a plan, from its begin to its end."""
    count = max(2, math.ceil((plan.t_end_s - plan.t_start_s) / period_s) + 1)
    return np.linspace(plan.t_start_s, plan.t_end_s, count)


def routed_returns(plan: Plan, routes: ReturnRoutes, t_s: Array) -> list[RoutedReturns]:
    """Two cases: returns to homes, and to the end of the shorter way of home and landing point."""
    count = len(t_s)
    leader = plan.leader_trajectory.state(t_s)
    places = (leader[:, POSITION] + plan.offsets(t_s)).reshape(-1, 3)
    velocities = (leader[:, VELOCITY] + plan.offsets(t_s, 1)).reshape(-1, 3)
    all_s = np.tile(t_s, len(plan.sysids))
    stop = stops(places, velocities, all_s, routes)
    ends = [np.repeat(end, count, axis=0) for end in (plan.pads_ned_m, landing_ends_ned_m(plan))]
    homes, landings = (routes.ways(stop.end_ned_m[:, :2], end[:, :2], all_s) for end in ends)
    home_first = homes.length_m <= landings.length_m
    points = max(homes.points_m.shape[1], landings.points_m.shape[1])
    wide = [
        np.append(w.points_m, np.repeat(w.points_m[:, -1:], points - w.points_m.shape[1], axis=1), axis=1)
        for w in (homes, landings)
    ]
    shape = len(plan.sysids), count
    cases = [RoutedReturns(ReturnTo.HOME, t_s, stop, homes.points_m, homes.length_m.reshape(shape), ends[0][:, 2])]
    if not home_first.all():
        ways = np.where(home_first[:, None, None], *wide)
        lengths = np.minimum(homes.length_m, landings.length_m).reshape(shape)
        cases.append(
            RoutedReturns(ReturnTo.NEAREST, t_s, stop, ways, lengths, np.where(home_first, *(e[:, 2] for e in ends)))
        )
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


def nearest_pairs(
    case: RoutedReturns, top_down_m: Array, speeds: ReturnSpeeds, apart_m: float
) -> tuple[Array, NDArray[np.intp]]:
    """The least distance (N,) of two vehicles of each return, and their rows (N, 2).

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
    least_m, pairs = np.full(count, np.inf), np.zeros((count, 2), dtype=np.intp)
    for first, second in itertools.combinations(range(vehicles), 2):
        between = places[second] - places[first]
        distance, _ = least_distance(between[:, :-1], between[:, 1:])
        distance[:, _SAMPLES - 1] = np.where(together, distance[:, _SAMPLES - 1], np.inf)
        nearer = distance.min(axis=1) < least_m - EQUAL
        least_m[nearer], pairs[nearer] = distance.min(axis=1)[nearer], (first, second)
    return least_m, pairs


def nearest_return(
    plan: Plan, routes: ReturnRoutes, first: list[RoutedReturns], top_down_m: Array, speeds: ReturnSpeeds
) -> WorstReturn:
    """The nearest two vehicles; `first` are the returns to begin with, at least two vehicles of them.

    Intervals between instants are halved, down to 1 ms, where a way jumps to another corner or another brake, and where
    the distance may fall below the least one if it changes as fast as vehicles fly. That is a search, not a proof: a
    way that jumps twice between two of the first instants is not seen.
    """
    apart_m = plan.scenario.limits.separation_min_m
    rate_mps = float(np.hypot(*plan.scenario.limits.speed_ned_mps[:2]))
    found: list[WorstReturn] = []

    def looked_at(cases: list[RoutedReturns]) -> dict[ReturnTo, _Instants]:
        instants = {}
        for case in cases:
            least_m, pairs = nearest_pairs(case, top_down_m, speeds, apart_m)
            at = first_least(least_m)
            sysids = plan.sysids[int(pairs[at, 0])], plan.sysids[int(pairs[at, 1])]
            found.append(WorstReturn(float(least_m[at]), float(case.t_s[at]), sysids, case.to))
            instants[case.to] = _Instants(case.t_s, least_m, case.kinds())
        return instants

    known = looked_at(first)
    solved, most = 0, _SOLVED_MAX if len(top_down_m) * (len(top_down_m) - 1) // 2 <= _PAIRS_MAX else 1
    while solved < most:
        best_m = min(one.distance_m for one in found)
        wanted = [instants.wanted(best_m, rate_mps) for instants in known.values()]
        middle_s, low_m, jumps = (np.concatenate(column) for column in zip(*wanted, strict=True))
        order = np.argsort(low_m, kind="stable")
        near = order[~jumps[order]][: _AT_ONCE if solved < _NEAR_MAX else 0]
        at_s = np.unique(middle_s[np.concatenate([order[jumps[order]][:_AT_ONCE], near])])
        if not len(at_s):
            break
        solved += len(at_s)
        more = looked_at(routed_returns(plan, routes, at_s))
        # Where all return home, there is no other case.
        known = {to: instants.joined(more.get(to, more[ReturnTo.HOME])) for to, instants in known.items()}
    return found[first_least(np.array([one.distance_m for one in found]))]


@dataclass(frozen=True)
class _Instants:
    """Instants (N,), in order, the least distances of their returns, and what jumps where ways do (N, V, 6)."""

    t_s: Array
    least_m: Array
    kinds: Array

    def wanted(self, best_m: float, rate_mps: float) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Middles (M,) of intervals to halve, how near (M,) vehicles may be in them, and whether a way jumps."""
        width_s = np.diff(self.t_s)
        low_m = np.minimum(self.least_m[:-1], self.least_m[1:]) - 0.5 * rate_mps * width_s
        jumps: NDArray[np.bool_] = np.any(np.abs(np.diff(self.kinds, axis=0)) > _JUMP, axis=(1, 2))
        left = (width_s > RESOLUTION_S) & (jumps | (low_m < best_m - _NEARER_M))
        return (0.5 * (self.t_s[:-1] + self.t_s[1:]))[left], low_m[left], jumps[left]

    def joined(self, other: _Instants) -> _Instants:
        """Both, in order; what both have counts once."""
        t_s, order = np.unique(np.concatenate([self.t_s, other.t_s]), return_index=True)
        least_m = np.concatenate([self.least_m, other.least_m])[order]
        return _Instants(t_s, least_m, np.concatenate([self.kinds, other.kinds])[order])
