"""The distance of pairs that break off at one instant and return, over spans of the instant and of the time since.

Where it is not certain how a vehicle brakes or which ways lead home from a span of instants, nothing is proved of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from gcs.mission.proving.break_off import RETURNED, Braking
from gcs.mission.proving.break_off_spans import SPAN_S
from gcs.mission.proving.plan_tracks import plan_velocities
from gcs.mission.proving.return_tubes import ReturnTubes
from gcs.mission.proving.track import FleetMotion
from gcs.mission.proving.track_criteria import TrackCriterion, squared
from gcs.mission.proving.track_report import TrackCheck
from gcs.mission.returns.return_routes import CLEARANCES_M, ReturnRoutes
from gcs.mission.returns.routed_motion import ACCEL_MPS2, PiecewiseMotion
from gcs.mission.returns.routed_returns import RoutedReturns, routed_returns
from gcs.mission.returns.rtl_altitudes import KEPT_M, ReturnPlan, plan_returns
from gcs.mission.returns.rtl_cases import ReturnTo, landing_ends_ned_m
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.subdivision import Cells, Constraint, Mask, Rows, halved, joined, plain_cells
from gcs.types import Array

_ROUNDING_M = 1e-9
_LONGEST_S, _SHORTEST_SINCE_S = 1.0, 1e-3
_REST_S = 1.0  # beyond the longest return
_FROM, _TO = 0, 1  # columns of a patch: time since the breaking off
_DOWN = 2
_AROUND, _POINT_M = 1.006, 1e-6  # of a disk's radius, so that its outline holds it, and it has an area

_Options = list[tuple[Array, Array]]  # ways (W, 2) that a return may take, and the places (3,) where they end


def returned(
    plan: Plan, motion: FleetMotion, separation_m: float | None, vertical_scale: float
) -> tuple[list[TrackCheck], list[ReturnSeparation]]:
    """What `gcs plan` proved of the autopilots' own returns, and what is to be proved of the ground station's.

    Without a separation, the one that a flight is judged by is required.
    """
    if len(plan.sysids) < 2:
        return [], []
    found = plan_returns(plan, plan.autopilots)
    limit_m, worst = separation_m or found.required_m, found.worst
    assert worst is not None
    proved_m = 0.0 if worst.proved_m is None else min(worst.proved_m, worst.distance_m)
    who = tuple(map(str, worst.sysids))
    name = "separation, returns of the autopilots, straight"
    straight = TrackCheck(name, "m", limit_m, False, worst.distance_m, proved_m, KEPT_M, who, worst.t_s)
    ends = [ReturnTo.HOME, ReturnTo.NEAREST]
    if np.array_equal(landing_ends_ned_m(plan), plan.pads_ned_m):
        ends = ends[:1]
    routes = ReturnRoutes(plan)
    velocities = FleetMotion.of(plan_velocities(plan), motion.edges_s)
    family = ReturnSeparation(plan, motion, velocities, found, limit_m, vertical_scale, ends[0], routes)
    return [straight], [replace(family, to=to, _known={}) for to in ends]


@dataclass(frozen=True, eq=False)
class ReturnSeparation:
    """The distance of pairs (a, b) of a plan's vehicles that begin the station's own returns at one instant.

    All return home, or all to the nearer of home and landing point.
    """

    plan: Plan
    motion: FleetMotion
    velocities: FleetMotion
    returns: ReturnPlan
    limit_m: float
    vertical_scale: float
    to: ReturnTo
    routes: ReturnRoutes
    _known: dict[tuple[int, float, float], _Options | None] = field(default_factory=dict)

    @property
    def criteria(self) -> tuple[TrackCriterion, ...]:
        """The one criterion."""
        return (TrackCriterion(f"separation, broken off to return to {self.to.words}", "m", self.limit_m),)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return (RETURNED,)

    @property
    def _tops_down_m(self) -> Array:
        return np.asarray(self.plan.pads_ned_m[:, 2] - np.array(self.returns.altitudes_m))

    def cells(self) -> Cells:
        """Every pair in spans of up to a second, and all of the time until the last vehicle has returned."""
        edges_s = self.motion.edges_s
        step_s = min(_LONGEST_S, self.routes.changes_s)
        if np.isfinite(self.routes.changes_s):
            more_s = np.arange(np.ceil(edges_s[0] / step_s), np.floor(edges_s[-1] / step_s) + 1) * step_s
            edges_s = np.union1d(edges_s, more_s)
        counts = np.ceil(np.diff(edges_s) / step_s).astype(int)
        parts = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(edges_s[:-1], edges_s[1:], counts, strict=True)]
        edges_s = np.append(np.concatenate(parts), edges_s[-1])
        pairs = np.stack(np.triu_indices(len(self.plan.sysids), 1), axis=1)
        which, span = (index.ravel() for index in np.indices((len(pairs), len(edges_s) - 1)))
        cells = plain_cells(pairs[which], edges_s[span], edges_s[span + 1])
        return replace(cells, patch=np.tile([0.0, self._longest_s], (len(cells), 1)))

    @cached_property
    def _longest_s(self) -> float:
        """A time after which every return that is looked at has ended; its halves are looked at first."""
        t_s = np.linspace(self.plan.t_start_s, self.plan.t_end_s, 50)
        ends_s = [self._motion_of(case).times_s[:, -1].max() for case in self._cases(t_s)]
        return float(2.0 * max(ends_s)) + _REST_S

    def _cases(self, t_s: Array) -> list[RoutedReturns]:
        cases = routed_returns(self.plan, self.routes, self.plan.clamped(t_s))
        own = [case for case in cases if case.to is self.to]
        return own or cases[:1]  # where all return home, there is no other case

    def _motion_of(self, case: RoutedReturns) -> PiecewiseMotion:
        return case.motion(self._tops_down_m, self.returns.speeds)

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        options, tubes, rows, sure = self._tubes(cells)
        low_m = np.where(sure[rows].all(axis=0), np.inf, 0.0)
        certain = np.flatnonzero(sure[rows].all(axis=0))
        begin_s, until_s = cells.patch.T
        apart_m = self._together_m(cells)
        firsts, counts = options
        ends_s = tubes.ends_s.high
        for one in range(int(counts.max(initial=0))):
            for other in range(int(counts.max(initial=0))):
                which = certain[(one < counts[rows[0, certain]]) & (other < counts[rows[1, certain]])]
                if not len(which):
                    continue
                chosen = firsts[rows[0, which]] + one, firsts[rows[1, which]] + other
                box, against = (tubes.boxes(option, begin_s[which], until_s[which]) for option in chosen)
                gap = np.maximum(np.maximum(box.low - against.high, against.low - box.high), 0.0)
                gap[:, _DOWN] /= self.vertical_scale
                level_m = np.hypot(gap[:, 0], gap[:, 1])
                stays = until_s[which] <= np.minimum(*(tubes.leaves_s.low[option] for option in chosen))
                level_m = np.where(stays, np.maximum(level_m, apart_m[which]), level_m)
                # Afterwards all rest where they are at the end of the time that is looked at.
                late = np.any([ends_s[option] > self._longest_s for option in chosen], axis=0)
                low_m[which] = np.minimum(low_m[which], np.where(late, 0.0, np.hypot(level_m, gap[:, _DOWN])))
        return low_m[None] - _ROUNDING_M - self.limit_m, self._seen_m(cells)[None] - self.limit_m

    def _braking(self, row: Rows, start_s: Array, end_s: Array) -> Braking:
        place, velocity = (each.enclosed(row, start_s, end_s) for each in (self.motion, self.velocities))
        return Braking(place, velocity, ACCEL_MPS2)

    def _together_m(self, cells: Cells) -> Array:
        """How far apart (N,) vehicles are, level, while they brake and climb: what they do together does not count."""
        first, second = (self._braking(cells.who[:, one], cells.start_s, cells.end_s) for one in (0, 1))
        level = np.array([[1.0], [1.0], [0.0]])
        begun = np.sqrt(np.maximum(squared((first.place - second.place) * level).low(), 0.0))
        return np.asarray(begun - first.against_m(second, cells.patch[:, _TO]))

    def _seen_m(self, cells: Cells) -> Array:
        """The distance (N,) of the returns from the middle instant at the middle of the time since."""
        at_s, which = np.unique(cells.middle_s, return_inverse=True)
        (case,) = self._cases(at_s)[:1]
        motion, count = self._motion_of(case), len(at_s)
        after_s = cells.patch.mean(axis=1)
        places = []
        for one in (0, 1):
            row = cells.who[:, one] * count + which.reshape(-1)
            own = PiecewiseMotion(motion.times_s[row], motion.places[row], motion.velocities[row])
            places.append(own.places_at(after_s[:, None])[:, 0])
        apart = places[1] - places[0]
        apart[:, _DOWN] /= self.vertical_scale
        landed = np.isinf(case.length_m.reshape(-1))
        no_way = np.any([landed[cells.who[:, one] * count + which.reshape(-1)] for one in (0, 1)], axis=0)
        return np.where(no_way, np.inf, np.linalg.norm(apart, axis=1))

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: halves of the instants or of the time since, whichever matters more.

        Of the instants where it is not certain how a vehicle returns, or that it does in the time that is looked at.
        """
        (firsts, counts), tubes, rows, sure = self._tubes(cells)
        last_s = self._most(tubes.ends_s.high, firsts, counts)
        vague_s = self._most(tubes.ends_s.high - tubes.ends_s.low, firsts, counts)
        sure = sure & (last_s <= self._longest_s)
        numbers = np.flatnonzero(chosen)
        some = cells[numbers]
        begin_s, until_s = some.patch.T
        fastest = max(self.returns.speeds.cruise_mps, self.returns.speeds.climb_mps, self.returns.speeds.sink_mps)
        of_time = 2.0 * fastest * (until_s - begin_s)
        of_instant = np.zeros(len(some))
        for one in (0, 1):
            braking = self._braking(some.who[:, one], some.start_s, some.end_s)
            off_m = np.linalg.norm(braking.place.deviation(), axis=0) + braking.spread_m(np.full(len(some), np.inf))
            of_instant += off_m + fastest * vague_s[rows[one, numbers]]
        unsure = ~sure[rows[:, numbers]].all(axis=0)
        can_time, can_instant = until_s - begin_s > _SHORTEST_SINCE_S, some.end_s - some.start_s > 0.5 * SPAN_S
        in_time = can_time & ~unsure & ((of_time > of_instant) | ~can_instant)
        in_instant = can_instant & ~in_time
        found, origins = [halved(some[in_instant])], [numbers[in_instant]] * 2
        for side in (0, 1):
            half = some[in_time]
            patch = half.patch.copy()
            patch[:, _TO - side] = 0.5 * patch.sum(axis=1)
            found.append(replace(half, patch=patch))
            origins.append(numbers[in_time])
        return joined(found), np.concatenate(origins)

    @staticmethod
    def _most(values: Array, firsts: Rows, counts: Rows) -> Array:
        """The largest value (N,) of the options of each vehicle in each span; 0 without options."""
        found = np.zeros(len(firsts))
        some = counts > 0
        if some.any():
            found[some] = np.maximum.reduceat(values, firsts[some])
        return found

    def moved_m(self, cells: Cells) -> Array:
        """How much (N,) what was seen differs for other instants of a cell: not known."""
        return np.full(len(cells), np.inf)

    @lru_cache(maxsize=1)  # noqa: B019 - asked twice in a row for the same cells; the family lives no longer than a proof
    def _tubes(self, cells: Cells) -> tuple[tuple[Rows, Rows], ReturnTubes, Rows, Mask]:
        """Options of each vehicle in each span once: first and count; tubes; (2, N) of pairs; whether they are sure."""
        of_both = np.concatenate([cells.who[:, 0], cells.who[:, 1]]).astype(np.float64)
        keys = np.stack([of_both, np.tile(cells.start_s, 2), np.tile(cells.end_s, 2)], axis=1)
        unique, index = np.unique(keys, axis=0, return_inverse=True)
        row, start_s, end_s = unique[:, 0].astype(np.intp), unique[:, 1], unique[:, 2]
        every = list(zip(row.tolist(), start_s.tolist(), end_s.tolist(), strict=True))
        new = np.array([n for n, key in enumerate(every) if key not in self._known], dtype=np.intp)
        if len(new):
            for n, found in zip(new.tolist(), self._options(row[new], start_s[new], end_s[new]), strict=True):
                self._known[every[n]] = found
        options = [self._known[key] for key in every]
        counts = np.array([len(each or ()) for each in options], dtype=np.intp)
        firsts = np.cumsum(counts) - counts
        cell = np.repeat(np.arange(len(every)), counts)
        flat = [option for each in options for option in each or ()]
        braking = self._braking(row[cell], start_s[cell], end_s[cell])
        ends_down_m = np.array([end[_DOWN] for _, end in flat])
        tubes = ReturnTubes.of(
            braking, [way for way, _ in flat], self._tops_down_m[row[cell]], ends_down_m, self.returns.speeds
        )
        return (firsts, counts), tubes, index.reshape(2, -1), counts > 0

    def _options(self, row: Rows, start_s: Array, end_s: Array) -> list[_Options | None]:
        """All ways that returns of vehicles (M,) may take which begin in spans (M,); None where that is not certain."""
        braking = self._braking(row, start_s, end_s)
        stop = braking.share(np.ones(len(row)), np.ones(len(row)))
        centre, reach_m = stop.middle[:2].T, np.hypot(*stop.deviation()[:2])
        begin = braking.place.middle[:2].T, np.hypot(*braking.place.deviation()[:2])
        disks = [
            shapely.buffer(shapely.points(at), off_m * _AROUND + _POINT_M, quad_segs=8)
            for at, off_m in (begin, (centre, reach_m))
        ]
        tracks: NDArray[np.object_] = shapely.convex_hull(shapely.union(*disks))
        found: list[_Options | None] = [None] * len(row)
        ends = [self.plan.pads_ned_m]
        if self.to is ReturnTo.NEAREST:
            ends.append(landing_ends_ned_m(self.plan))
        middle_s = 0.5 * (start_s + end_s)
        window = np.floor(middle_s / self.routes.changes_s) if np.isfinite(self.routes.changes_s) else 0.0 * middle_s
        for vehicle, at in np.unique(np.stack([row.astype(np.float64), window], axis=1), axis=0).tolist():
            chosen = np.flatnonzero((row == vehicle) & (window == at))
            t_s = float(middle_s[chosen[0]])
            clear = ~shapely.intersects(self.routes.forbidden(t_s), tracks[chosen])
            chosen = chosen[clear]
            if not len(chosen):
                continue
            graph = self.routes.graph(t_s, CLEARANCES_M[0])
            ways = [graph.possible(centre[chosen], reach_m[chosen], end[int(vehicle), :2]) for end in ends]
            for number, of_ends in zip(chosen.tolist(), zip(*ways, strict=True), strict=True):
                found[number] = _nearest_ends([end[int(vehicle)] for end in ends], of_ends, float(reach_m[number]))
        return found


def _nearest_ends(ends: list[Array], ways: tuple[list[Array] | None, ...], reach_m: float) -> _Options | None:
    """The options that lead to the nearest end; None where the ways to one of them are not certain."""
    sure = [each for each in ways if each is not None]
    if len(sure) < len(ways):
        return None
    lengths = [[float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()) for way in each] for each in sure]
    # An end may be the nearest whose shortest way may be shorter than the longest that another one may have.
    most_m = min(max(each) for each in lengths) + 2.0 * reach_m
    return [
        (way, end)
        for end, each, their in zip(ends, sure, lengths, strict=True)
        for way, length_m in zip(each, their, strict=True)
        if length_m <= most_m + _ROUNDING_M
    ]
