"""Volumes in space and time that contain every vehicle of a plan with its navigation error, proved on intervals.

A volume holds the whole formation for a part of the flight. Its outline is what lies behind lines in 16 directions: how
far the vehicles reach in each is bounded by Taylor models over intervals of time, so nothing between two samples is
missed. Of all ways to divide the flight into that many parts, the one with the least volume times duration is taken.
Take-off and landing are one part each, because autopilots climb and descend at their own rates.

What is proved is what is written: corners in degrees, heights above the ellipsoid, instants of whole milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import pairwise

import numpy as np
import shapely

from gcs.errors import UsageError, VerificationError, counted
from gcs.frames import geodetic_to_ned, ned_to_geodetic
from gcs.mission.formats.flight_volume import FlightVolume, OperationalIntent
from gcs.mission.machine_independent import rounded_down
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import combined, enclosed
from gcs.plan.verification.proof.taylor import Taylor
from gcs.scenario.values.navigation_error import NavigationError, navigation_error
from gcs.scenario.values.si import local_origin
from gcs.types import Array

VOLUMES_MAX = 100
_DIRECTIONS = 16
_ORDER = 3
_LONGEST_S = 0.5
_PARTS_MAX = 400  # between which the flight may be divided
_BATCH = 64  # vehicles bounded at once
_ROUNDED_M = 0.002  # outwards, for the digits that are written
_DEGREE_DIGITS, _HEIGHT_DIGITS = 9, 3
_BETTER = 0.999
_EARTH_M = 6_371_000.0
_DOWN = 2
_GEOID_MOST_M = 110.0
_LATE_MOST_S = 3600.0
_SAME_S = 1e-9  # sums of instants are rounded, which leaves no time without a volume


@dataclass(frozen=True)
class VolumeOrder:
    """What a plan does not say: when the take-off begins, and where mean sea level is.

    `geoid_m` is its height above the WGS-84 ellipsoid, which counts as the same everywhere in the flight. Volumes also
    hold a flight that is late by up to `late_s`, all of it or from any instant on: each is in force so much longer.
    """

    takeoff: datetime
    geoid_m: float
    volumes: int = 10
    late_s: float = 0.0

    def __post_init__(self) -> None:
        if self.takeoff.tzinfo is None:
            raise UsageError("the time of the take-off has no time zone", hint="give it in UTC: 2026-11-28T10:30:00Z")
        if not 1 <= self.volumes <= VOLUMES_MAX:
            raise UsageError(f"{self.volumes} volumes", hint=f"give 1 to {VOLUMES_MAX}")
        if not 0.0 <= self.late_s <= _LATE_MOST_S:
            raise UsageError(f"{self.late_s:g} s late", hint=f"give 0 to {_LATE_MOST_S:g} s")
        if not -_GEOID_MOST_M <= self.geoid_m <= _GEOID_MOST_M:
            text = f"mean sea level {self.geoid_m:g} m above the ellipsoid; it is nowhere beyond {_GEOID_MOST_M:g} m"
            raise UsageError(text, hint="give the separation of geoid and ellipsoid, not an altitude")

    def at(self, plan: Plan, t_s: float) -> datetime:
        """The instant of a plan time."""
        return self.takeoff.astimezone(UTC) + timedelta(seconds=t_s - plan.t_start_s)


@dataclass(frozen=True)
class ProvedVolumes:
    """Volumes, what they were made for, and by how much every vehicle is proved inside."""

    order: VolumeOrder
    intent: OperationalIntent
    error: NavigationError  # of every vehicle, which is inside with it
    margin_m: float

    def data(self) -> dict[str, object]:
        """What index.json and `--json` say of them."""
        return {
            "count": len(self.intent.volumes),
            "takeoff": self.order.takeoff.astimezone(UTC).isoformat(timespec="milliseconds"),
            "geoid_m": self.order.geoid_m,
            "late_s": self.order.late_s,
            "navigation_error_m": [self.error.horizontal_m, self.error.vertical_m],
            "margin_proved_m": rounded_down(self.margin_m),
        }

    def __str__(self) -> str:
        error, order = self.error, self.order
        return (
            f"{counted(len(self.intent.volumes), 'volume')} from take-off to touch-down, in which every vehicle is "
            f"proved to be with its navigation error of {error.horizontal_m:g} m ({error.vertical_m:g} m in height), "
            f"up to {order.late_s:g} s late; heights above the ellipsoid, with mean sea level at {order.geoid_m:g} m"
        )


def flight_volumes(plan: Plan, order: VolumeOrder) -> ProvedVolumes:
    """At most `order.volumes` volumes of a plan. Raises `VerificationError` where they cannot be proved."""
    edges_s, parts = _parts(plan)
    reach = _Reach.of(plan, edges_s)
    merged = reach.merged(parts)
    firsts = _division(merged, order.volumes)
    volumes = []
    for first, last in zip(firsts, [*firsts[1:], len(merged.length_s)], strict=True):
        begin_s, end_s = float(edges_s[parts[first]]), float(edges_s[parts[last]])
        volumes.append(_volume(plan, order, merged.over(first, last), begin_s, end_s))
    intent = OperationalIntent(tuple(volumes))
    margin_m, t_s = containment(plan, order, intent)
    if margin_m < 0.0:
        text = f"a vehicle with its navigation error is {-margin_m:.3f} m outside its volume at t = {t_s:.3f} s"
        raise VerificationError(text, hint="this is a mistake of the program: report it with the plan")
    return ProvedVolumes(order, intent, navigation_error(plan.scenario), margin_m)


def containment(plan: Plan, order: VolumeOrder, intent: OperationalIntent) -> tuple[float, float]:
    """By how much, m, every vehicle with its navigation error is proved inside a volume of its time, and where least.

    A volume counts from its start, and until `late_s` before its end: so it holds a flight of any delay up to that.
    Negative where one is not proved inside; minus infinity at a time without a volume.
    """
    start, late, own_s = order.at(plan, plan.t_start_s), timedelta(seconds=order.late_s), _edges_s(plan)
    windows_s = []
    for one in intent.volumes:
        after_s = np.array([(at - start).total_seconds() for at in (one.start, one.end - late)])
        ends_s = plan.clamped(plan.t_start_s + after_s)
        nearest_s = own_s[np.abs(own_s - ends_s[:, None]).argmin(axis=1)]
        windows_s.append(np.where(np.abs(nearest_s - ends_s) < _SAME_S, nearest_s, ends_s))
    edges_s = np.unique(np.concatenate([own_s, *windows_s]))
    found = np.full(len(edges_s) - 1, -np.inf)
    for volume, (begin_s, end_s) in zip(intent.volumes, windows_s, strict=True):
        inside = (edges_s[:-1] >= begin_s) & (edges_s[1:] <= end_s)
        if inside.any():
            in_force_s = edges_s[(edges_s >= begin_s) & (edges_s <= end_s)]
            found[inside] = np.maximum(found[inside], _margins(plan, order, volume, in_force_s))
    worst = int(found.argmin())
    return float(found[worst]), float(edges_s[worst])


def _margins(plan: Plan, order: VolumeOrder, volume: FlightVolume, edges_s: Array) -> Array:
    """The least margin (M,) of all vehicles in the intervals between instants (M + 1,)."""
    origin, error = local_origin(plan.scenario), navigation_error(plan.scenario)
    lat, lon = np.array(volume.corners_deg).T
    corners = geodetic_to_ned(lat, lon, origin.alt_amsl_m, origin)[:, :2]
    ring = shapely.Polygon(corners)
    if not ring.is_valid or not shapely.equals_exact(ring.convex_hull.normalize(), ring.normalize(), 1e-6):
        return np.full(len(edges_s) - 1, -np.inf)  # lines are what is proved: only a convex outline is all behind them
    corners = np.array(ring.exterior.coords) if ring.exterior.is_ccw else np.array(ring.exterior.coords)[::-1]
    along = np.diff(corners, axis=0)
    length = np.linalg.norm(along, axis=1)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    limits = np.einsum("ka,ka->k", normals, corners[:-1]) - _bow_m(corners, length) - error.horizontal_m
    height_m = origin.alt_amsl_m + order.geoid_m
    upper_m, lower_m = volume.upper_w84_m - height_m, volume.lower_w84_m - height_m
    found = np.full(len(edges_s) - 1, np.inf)
    for place in _places(plan, edges_s):
        for (north, east), limit in zip(normals.tolist(), limits.tolist(), strict=True):
            _, far = (place[0] * north + place[1] * east).range()
            found = np.minimum(found, limit - far.max(axis=0))
        low, high = (-place[_DOWN]).range()
        found = np.minimum(found, upper_m - error.vertical_m - high.max(axis=0))
        found = np.minimum(found, low.min(axis=0) - error.vertical_m - lower_m)
    return found


def _bow_m(corners: Array, length: Array) -> float:
    """How far the shortest path on Earth between two corners (N, 2) may be from the straight line of the plane."""
    far_m = float(np.linalg.norm(corners, axis=1).max())
    return float(length.max()) ** 2 * far_m / (2.0 * _EARTH_M**2)


def _edges_s(plan: Plan) -> Array:
    """The ends (M + 1,) of intervals in each of which every vehicle has one polynomial."""
    phases_s = [phase.start_s for phase in plan.phases]
    joints_s = np.unique([plan.t_start_s, plan.t_end_s, *phases_s, *plan.joints_s])
    joints_s = joints_s[(joints_s >= plan.t_start_s) & (joints_s <= plan.t_end_s)]
    counts = np.ceil(np.diff(joints_s) / _LONGEST_S).astype(int)
    parts = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(joints_s.tolist()), counts, strict=True)]
    return np.append(np.concatenate(parts), joints_s[-1])


def _parts(plan: Plan) -> tuple[Array, list[int]]:
    """The ends of all intervals in seconds, and the indices of those ends at which a volume may end."""
    edges_s = _edges_s(plan)
    whole = [phase for phase in plan.phases if phase.name in (PhaseKind.TAKEOFF, PhaseKind.LANDING)]
    inside = np.zeros(len(edges_s), dtype=bool)
    for phase in whole:
        inside |= (edges_s > phase.start_s + 1e-9) & (edges_s < phase.end_s - 1e-9)
    free = np.flatnonzero(~inside)
    step = max(1, math.ceil(len(free) / _PARTS_MAX))
    must = [int(np.abs(edges_s - at).argmin()) for phase in whole for at in (phase.start_s, phase.end_s)]
    return edges_s, sorted({0, len(edges_s) - 1, *must, *free[::step].tolist()})


def _places(plan: Plan, edges_s: Array) -> Iterator[list[Taylor]]:
    """North, east and down (W, M) of some vehicles at a time, in the intervals between instants (M + 1,)."""
    leader = enclosed(plan.leader_trajectory.state, edges_s[:-1], edges_s[1:], _ORDER)[:3]
    functions = enclosed(plan.shape.functions, edges_s[:-1], edges_s[1:], _ORDER)
    for first in range(0, len(plan.sysids), _BATCH):
        tables = plan.shape.basis_ned_m[:, first : first + _BATCH]
        yield [leader[axis, None] + part for axis, part in enumerate(combined(functions, tables))]


@dataclass(frozen=True)
class _Reach:
    """How far vehicles reach, with their navigation error, in parts of the flight (M,)."""

    out_m: Array  # (K, M) in the directions, from the origin
    low_m: Array  # (M,) heights above the origin
    high_m: Array
    length_s: Array

    @classmethod
    def of(cls, plan: Plan, edges_s: Array) -> _Reach:
        """The reach of all vehicles in each interval between instants (M + 1,)."""
        error = navigation_error(plan.scenario)
        count = len(edges_s) - 1
        out, low, high = np.full((_DIRECTIONS, count), -np.inf), np.full(count, np.inf), np.full(count, -np.inf)
        for place in _places(plan, edges_s):
            for row, (north, east) in enumerate(_directions().tolist()):
                _, far = (place[0] * north + place[1] * east).range()
                out[row] = np.maximum(out[row], far.max(axis=0))
            least, most = (-place[_DOWN]).range()
            low, high = np.minimum(low, least.min(axis=0)), np.maximum(high, most.max(axis=0))
        return cls(out + error.horizontal_m, low - error.vertical_m, high + error.vertical_m, np.diff(edges_s))

    def merged(self, parts: list[int]) -> _Reach:
        """The reach in longer parts, each from one of these intervals up to the next."""
        at = np.array(parts[:-1])
        return _Reach(
            np.maximum.reduceat(self.out_m, at, axis=1),
            np.minimum.reduceat(self.low_m, at),
            np.maximum.reduceat(self.high_m, at),
            np.add.reduceat(self.length_s, at),
        )

    def over(self, first: int, last: int) -> tuple[Array, float, float]:
        """The reach (K,) in all directions, and the heights, in parts `first` up to `last`."""
        chosen = slice(first, last)
        return self.out_m[:, chosen].max(axis=1), float(self.low_m[chosen].min()), float(self.high_m[chosen].max())

    def costs(self, first: int) -> Array:
        """Volume times duration of parts `first` to each later one."""
        out = np.maximum.accumulate(self.out_m[:, first:], axis=1)
        height = np.maximum.accumulate(self.high_m[first:]) - np.minimum.accumulate(self.low_m[first:])
        return np.asarray(_area_m2(out) * height * np.cumsum(self.length_s[first:]))


def _directions() -> Array:
    """Unit vectors (K, 2), north and east."""
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _area_m2(out_m: Array) -> Array:
    """The area (...) behind lines at these distances (K, ...), each of which touches what it holds."""
    turn = 2.0 * np.pi / _DIRECTIONS
    side = np.roll(out_m, 1, axis=0) + np.roll(out_m, -1, axis=0) - 2.0 * np.cos(turn) * out_m
    return np.asarray(0.5 * (out_m * side).sum(axis=0) / np.sin(turn))


def _division(reach: _Reach, most: int) -> list[int]:
    """The first part of each volume, at most `most`, with the least total cost; fewer, where they cost hardly more."""
    count = len(reach.length_s)
    cost = np.full((count, count + 1), np.inf)
    for first in range(count):
        cost[first, first + 1 :] = reach.costs(first)
    best = cost[0].copy()  # of the parts before each end, by one volume
    chosen: list[Array] = []
    for _ in range(1, min(most, count)):
        every = best[:count, None] + cost
        least = every.min(axis=0)
        better = least < _BETTER * best  # else one volume fewer does as well
        chosen.append(np.where(better, every.argmin(axis=0), 0))
        best = np.where(better, least, best)
    firsts, end = [], count
    for choice in reversed(chosen):
        first = int(choice[end])
        if first > 0:
            firsts.append(first)
            end = first
    return [0, *reversed(firsts)]


def _volume(
    plan: Plan, order: VolumeOrder, reach: tuple[Array, float, float], begin_s: float, end_s: float
) -> FlightVolume:
    """The volume around a reach, rounded outwards."""
    origin = local_origin(plan.scenario)
    out_m, low_m, high_m = reach
    wide = 2.0 * np.pi / _DIRECTIONS
    side_m = np.hypot(*np.ptp(_directions() * out_m[:, None], axis=0))
    far_m = float(np.abs(out_m).max()) + side_m
    slack_m = _ROUNDED_M + side_m**2 * far_m / (2.0 * _EARTH_M**2)
    after = np.roll(out_m, -1) + slack_m
    before = out_m + slack_m
    # Where the lines of two neighbouring directions meet.
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    across = (after - before * np.cos(wide)) / np.sin(wide)
    north = before * np.cos(angle) - across * np.sin(angle)
    east = before * np.sin(angle) + across * np.cos(angle)
    hull = shapely.convex_hull(shapely.multipoints(np.stack([north, east], axis=1)))
    corners = np.array(hull.simplify(0.0).exterior.coords)[:-1]
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners, np.zeros(len(corners))]), origin)
    height_m, step_m = origin.alt_amsl_m + order.geoid_m, 10.0**-_HEIGHT_DIGITS
    return FlightVolume(
        tuple(zip(np.round(lat, _DEGREE_DIGITS).tolist(), np.round(lon, _DEGREE_DIGITS).tolist(), strict=True)),
        round(math.floor((height_m + low_m) / step_m) * step_m - step_m, _HEIGHT_DIGITS),
        round(math.ceil((height_m + high_m) / step_m) * step_m + step_m, _HEIGHT_DIGITS),
        _whole(order.at(plan, begin_s), up=False),
        _whole(order.at(plan, end_s + order.late_s), up=True),
    )


def _whole(at: datetime, *, up: bool) -> datetime:
    """The whole millisecond at or before an instant, or at or after it."""
    beyond = at.microsecond % 1000
    return at + timedelta(microseconds=(1000 - beyond if up else -beyond) if beyond else 0)
