"""Returns (RTL) of a fleet, to be verified: start, end, altitude datum, ground, rally points, and motion.

All begin at once, climb, fly straight to their ends, and descend. Return altitudes are arguments here; `rtl_altitudes`
chooses them.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
import shapely
from numpy.typing import NDArray

from gcs.autopilots.traits import FleetFirmware, one_each
from gcs.mission.predicted.closest_approach import least_distance
from gcs.mission.returns.fence_areas import inclusion_corners, outside_area, planned_places_m, swept_area
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import ZoneName, displacement_m, outline, zones
from gcs.scenario.environment.terrain import ground_envelope_m, ground_height_m
from gcs.types import Array

Rows = NDArray[np.intp]
_LOOKS_M = 5.0  # between samples of the (smooth) ground under a return track
_LOOKS_MAX = 3_000_000
Motion = tuple[Array, Array]  # times since the return began (..., K), places (..., K, 3) in NED
_INSTANTS, _CANDIDATES = 70, 36
_CLEARANCE_M = 3.0  # from no-fly zones and inside the fence
_ASIDE_M = (0.0, 6.0, -6.0)  # of the track
_FLAT_M, _SLOPE = 3.0, math.tan(math.radians(10.0))
_SAME_M = 1e-6
_LOWER_M = 0.3  # than home: PX4's return altitude counts from the ground of the rally point


@dataclass(frozen=True)
class ReturnSpeeds:
    """Speeds of a return, m/s, and the longest wait above its end, s."""

    climb_mps: float
    cruise_mps: float
    sink_mps: float
    wait_s: float


class ReturnTo(StrEnum):
    """The destination of returns."""

    HOME = "home"
    NEAREST = "nearest"  # of home and rally points

    @property
    def words(self) -> str:
        """The destination in words."""
        return "home" if self is ReturnTo.HOME else "the nearest of home and rally points"

    @classmethod
    def either(cls, *, to_rally: bool) -> Self:
        """Return the nearest end, if it may be a rally point; otherwise home."""
        return cls.NEAREST if to_rally else cls.HOME


@dataclass(frozen=True)
class Returning:
    """Begins and ends (V, N, 3) of a fleet's returns from instants t_s (N,).

    `datum_m` (V, N) is the height that return altitudes count from: that of home, on PX4 that of the return's end.
    `waits_s` (V,) or (V, N) are the waits above the ends, if they differ between vehicles.
    """

    to: ReturnTo
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
        wait_s = self.speeds.wait_s if self.waits_s is None else self.waits_s[row]
        return self._motion(self.from_ned_m[row], self.to_ned_m[row], self.datum_m[row] + altitude_m, wait_s)

    def at(self, rows: Rows, instants: Rows, altitudes_m: Array) -> Motion:
        """Motions (M, K) of vehicles `rows` (M,) from these instants (M,), at altitudes (M,)."""
        waits_s = self.speeds.wait_s if self.waits_s is None else self.waits_s[rows]
        if np.ndim(waits_s) > 1:
            waits_s = np.take_along_axis(np.asarray(waits_s), instants[:, None], axis=1)[:, 0]
        begin, end = self.from_ned_m[rows, instants], self.to_ned_m[rows, instants]
        return self._motion(begin, end, self.datum_m[rows, instants] + altitudes_m, waits_s)

    def _motion(self, start: Array, end: Array, top_m: Array, wait_s: Array | float) -> Motion:
        speeds = self.speeds
        top_down = np.minimum(start[:, 2], -top_m)
        shape = top_down.shape
        flat_m = np.broadcast_to(np.hypot(end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]), shape)
        climb_s = (start[:, 2] - top_down) / speeds.climb_mps
        sink_s = np.maximum(end[:, 2] - top_down, 0.0) / speeds.sink_mps
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


@dataclass(frozen=True)
class Crossing:
    """A zone that straight returns of some vehicles cross only if they begin in [from_s, to_s] of plan time."""

    zone: int
    ends: ReturnTo
    from_s: float
    to_s: float
    sysids: tuple[int, ...]
    keep_in: bool = False  # the zone is what is outside a keep-in area

    @property
    def name(self) -> ZoneName:
        """The name of the zone."""
        return ZoneName(self.zone, self.keep_in)


@dataclass(frozen=True)
class WorstReturn:
    """The nearest two vehicles of all returns; `t_s` is the plan time at which that return begins.

    At whatever instant a return begins, no two vehicles come nearer than `proved_m`; None where no distance is proved.
    """

    distance_m: float
    t_s: float
    sysids: tuple[int, int]
    ends: ReturnTo
    proved_m: float | None = None

    def in_words(self, required_m: float) -> str:
        """When it begins and what happens, for a sentence."""
        first, second = self.sysids
        near = f"vehicles {first} and {second} come within {self.distance_m:.2f} m ({required_m:g} m required)"
        return f"{self.t_s:.1f} s, {near}"


@dataclass(frozen=True)
class ReturnEnds:
    """Where each vehicle may return to (V, E, 3): its home, then its rally points. Waits above the ends (V,)."""

    ned_m: Array
    above_home: NDArray[np.bool_]  # (V,) whether return altitudes count from home, wherever the vehicle returns to
    waits_s: Array

    def datum_m(self, to_ned_m: Array, *, to_rally: bool) -> Array:
        """The heights (V, N) that return altitudes count from, of returns to (V, N, 3)."""
        homes = np.broadcast_to(self.ned_m[:, :1, 2], to_ned_m.shape[:2])
        return np.asarray(-np.where(self.above_home[:, None] | (not to_rally), homes, to_ned_m[..., 2]))


def return_ends(plan: Plan, firmware: FleetFirmware, rally_ned_m: Array | None = None) -> ReturnEnds:
    """Where a fleet's returns end: at home or at rally points (V, R, 3), by default the landing points."""
    rows = [known.traits.returns for known in one_each(firmware, len(plan.sysids))]
    rally = plan.landing_points_ned_m[:, None] if rally_ned_m is None else rally_ned_m
    homes = plan.pads_ned_m[:, None]
    ends = homes if np.array_equal(rally, homes) else np.concatenate([homes, rally], axis=1)
    above_home = np.array([row.altitude_above_home for row in rows])
    return ReturnEnds(ends, above_home, np.array([row.wait_s for row in rows]))


def return_cases(
    plan: Plan,
    firmware: FleetFirmware,
    speeds: ReturnSpeeds,
    period_s: float,
    within: tuple[float, float] | None = None,
    rally_ned_m: Array | None = None,
) -> list[Returning]:
    """Two cases: returns to homes, and to the nearest of home and rally points, from instants `period_s` apart.

    One case where the rally points are the homes. `rally_ned_m` (V, R, 3) are the rally points; without it, the
    landing points are.
    """
    begin_s, end_s = within or (plan.t_start_s, plan.t_end_s)
    count = max(2, math.ceil((end_s - begin_s) / period_s) + 1)
    t_s = plan.clamped(np.linspace(begin_s, end_s, count))
    start = plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s)
    ends = return_ends(plan, firmware, rally_ned_m)
    homes = np.broadcast_to(plan.pads_ned_m[:, None], start.shape)
    away_m = np.linalg.norm(start[:, :, None, :2] - ends.ned_m[:, None, :, :2], axis=-1)
    nearest = np.take_along_axis(ends.ned_m, np.argmin(away_m, axis=-1)[..., None], axis=1)
    return [
        Returning(to, t_s, start, end, ends.datum_m(end, to_rally=to is ReturnTo.NEAREST), speeds, ends.waits_s)
        for to, end in ((ReturnTo.HOME, homes), (ReturnTo.NEAREST, nearest))[: ends.ned_m.shape[1]]
    ]


def highest_ground_m(plan: Plan, cases: list[Returning]) -> float:
    """The highest envelope of the ground under all return tracks, above the origin's height, every `_LOOKS_M`."""
    start = cases[0].from_ned_m[..., :2]
    longest_m = max(float(np.linalg.norm(c.to_ned_m[..., :2] - start, axis=-1).max()) for c in cases)
    looks = max(2, math.ceil(longest_m / _LOOKS_M))
    terrain = plan.scenario.terrain
    if len(cases) * start[..., 0].size * looks > _LOOKS_MAX:
        # Too many tracks to sample each: all of them stay inside this rectangle.
        everywhere = np.concatenate([start, *(c.to_ned_m[..., :2] for c in cases)], axis=1).reshape(-1, 2)
        low, high = everywhere.min(axis=0), everywhere.max(axis=0)
        north, east = (np.arange(a, b + _LOOKS_M, _LOOKS_M) for a, b in zip(low, high, strict=True))
        return float(np.max(ground_envelope_m(terrain, *np.meshgrid(north, east))))
    shares = np.linspace(0.0, 1.0, looks)[:, None, None]
    highest = -np.inf
    for case in cases:
        track = case.to_ned_m[..., :2] - start
        north, east = (start[..., axis] + shares * track[..., axis] for axis in range(2))
        highest = max(highest, float(np.max(ground_envelope_m(terrain, north, east))))
    return highest


def rally_points_ned_m(plan: Plan, points_max: int) -> Array:
    """Ground points (V, R, 3): each vehicle's landing point, then those that keep more returns out of no-fly zones.

    Autopilots return straight to the nearest of home and rally points. Points are chosen so that such returns cross
    no-fly zones at as few instants as possible. They lie below the vehicle's own track or a little beside it, as at one
    plan time for all vehicles, on flat ground.
    """
    chosen = landing_ends_ned_m(plan)[:, None]
    if not zones(plan.scenario):
        return chosen
    t_s = np.linspace(plan.t_start_s, plan.t_end_s, _INSTANTS)
    start = (plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s))[..., :2]  # (V, N, 2)
    candidates = _candidates(plan)  # (V, C, 3)
    ends = np.concatenate([plan.pads_ned_m[:, None], chosen, candidates], axis=1)
    away_m = np.linalg.norm(start[:, :, None] - ends[:, None, :, :2], axis=-1)  # (V, N, E)
    # Whether (V, N, E) straight tracks cross a no-fly zone
    shape = (len(start), len(t_s), ends.shape[1], 2)
    first, last = np.broadcast_to(start[:, :, None], shape), np.broadcast_to(ends[:, None, :, :2], shape)
    through = np.zeros(shape[:3], dtype=bool)
    for zone in zones(plan.scenario):
        area = outline(zone).buffer(-plan.scenario.mission.tolerance_m)
        shapely.prepare(area)
        moved = displacement_m(zone, t_s)[:, None]
        through |= shapely.intersects(area, shapely.linestrings(np.stack([first - moved, last - moved], axis=-2)))
    taken = [0, 1]
    best = _crossings(away_m, through, taken)
    while best and len(taken) <= points_max:
        possible = [
            (_crossings(away_m, through, [*taken, end]), end)
            for end in range(2, ends.shape[1])
            if end not in taken and _apart(plan, ends[:, taken], ends[:, end])
        ]
        fewer, end = min(possible, default=(best, 0))
        if fewer >= best:
            break
        best = fewer
        taken.append(end)
    return np.asarray(ends[:, taken[1:]])


def landing_ends_ned_m(plan: Plan) -> Array:
    """The places (V, 3) where returns may end instead of at home: landing points, or homes if they are in the way.

    Vehicles that land on each other's pads would return to one place: one from home, the other to its landing point.
    """
    landing, homes = plan.landing_points_ned_m, plan.pads_ned_m
    away_m = np.linalg.norm(landing[:, None, :2] - homes[None, :, :2], axis=-1)
    np.fill_diagonal(away_m, np.inf)
    return landing if away_m.min() >= plan.scenario.limits.separation_min_m - _SAME_M else homes


def _candidates(plan: Plan) -> Array:
    """Ground points (V, C, 3) where all vehicles have flat ground, clear of zones and inside the fence."""
    t_s = np.linspace(plan.t_start_s, plan.t_end_s, _CANDIDATES + 2)[1:-1]
    leader = plan.leader_trajectory.state(t_s)
    tracks = (leader[:, POSITION] + plan.offsets(t_s))[..., :2]
    right = np.stack([-leader[:, VELOCITY][:, 1], leader[:, VELOCITY][:, 0]], axis=-1)
    right /= np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-9)
    flat = np.concatenate([tracks + aside_m * right for aside_m in _ASIDE_M], axis=1)
    around = np.concatenate([[[0.0, 0.0]], _FLAT_M * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])])
    near = flat[..., None, :] + around
    ground_m = ground_height_m(plan.scenario.terrain, near[..., 0], near[..., 1])
    good = np.ptp(ground_m, axis=-1) <= 2 * _FLAT_M * _SLOPE
    good &= ground_m[..., 0] >= -plan.pads_ned_m[:, None, 2] - _LOWER_M
    fence = shapely.Polygon(inclusion_corners(planned_places_m(plan)))
    avoided = [swept_area(zone, _CLEARANCE_M, plan.t_start_s, math.inf) for zone in zones(plan.scenario)]
    for area in (outside_area(fence, _CLEARANCE_M), *avoided):
        good &= ~shapely.intersects(area, shapely.points(flat))
    places = np.concatenate([flat, -ground_m[..., :1]], axis=-1)
    return np.asarray(places[:, good.all(axis=0)])


def _apart(plan: Plan, taken: Array, points: Array) -> bool:
    """Whether points (V, 3) keep the plan's separation from each other and from those of other vehicles (V, T, 3)."""
    others = np.concatenate([taken, points[:, None]], axis=1)[..., :2]
    away_m = np.linalg.norm(points[:, None, None, :2] - others, axis=-1)  # (V, V, T + 1)
    away_m[np.arange(len(points)), np.arange(len(points))] = np.inf
    return bool(away_m.min() >= plan.scenario.limits.separation_min_m)


def _crossings(away_m: Array, through: Array, ends: list[int]) -> int:
    """The number of returns to the nearest of these ends that cross a no-fly zone."""
    nearest = np.argmin(away_m[..., ends], axis=-1)
    return int(np.take_along_axis(through[..., ends], nearest[..., None], axis=-1).sum())
