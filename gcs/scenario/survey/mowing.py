"""Passes of a line abreast over an area, there and back, such that each place is near the track of a vehicle.

The line keeps its direction and flies sideways from pass to pass: abreast of a pass is abreast of the way back too.
A line that turned with its course would never be faster. On the same track of the centre the speed of an outer vehicle
would be the centre's plus the turn rate times its distance, and the limits hold for every vehicle.

Of all directions, an edge of the area's convex hull has the fewest passes: the width of a convex polygon is least
across one of its edges. Other edges are tried too, because the legs count as well.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from gcs.physics.quadrotor import Array

PASSES_MAX = 49  # two points each: as many as a route has
_SAME_DEG = 0.2  # directions that differ by less are one
_DIRECTIONS_MAX = 90  # tried at most: an outline of hundreds of corners has no edge to fly along
_ROUNDING_M = 1e-6
_NEAR_BEST = 1.02  # of the least time: as good, so that fewer vehicles are better
_LEAST_M = 0.5  # a shorter piece of a pass is not flown

Strip = tuple[float, list[tuple[float, float]]]  # the middle across, and the pieces along, m
Leg = tuple[tuple[float, float], tuple[float, float]]  # where the middle of the line begins and ends: north, east, m


@dataclass(frozen=True)
class Pace:
    """The time that flying takes: a speed, and what each stop between two legs adds."""

    speed_mps: float = 4.0
    stop_s: float = 3.0

    def time_s(self, lengths_m: Iterable[float]) -> float:
        """The time for legs one after the other, s."""
        return sum(length_m / self.speed_mps + self.stop_s for length_m in lengths_m)


@dataclass(frozen=True)
class Mowing:
    """A line abreast of `count` vehicles, `spacing_m` apart, whose front is at `course_deg`, and its passes in order.

    Passes are those of the middle of the line. The direction of flight is the front or its opposite.
    """

    course_deg: float
    count: int
    spacing_m: float
    passes: tuple[Leg, ...]
    time_s: float

    @property
    def lines(self) -> shapely.MultiLineString:
        """The passes of all vehicles (north, east), m."""
        across = np.array(_axes(self.course_deg)[1])
        away = (np.arange(self.count) - (self.count - 1) / 2.0) * self.spacing_m
        return shapely.MultiLineString([np.array(leg) + one * across for leg in self.passes for one in away])

    def leg_lengths_m(self) -> list[float]:
        """The lengths of the passes and of the legs between them, in order."""
        places = [place for leg in self.passes for place in leg]
        return [math.dist(a, b) for a, b in itertools.pairwise(places)]


def mowing(
    area: shapely.Polygon,
    widest_m: float,
    counts: Iterable[int],
    *,
    course_deg: float | None = None,
    start_m: tuple[float, float] | None = None,
    avoided: BaseGeometry | None = None,
    pace: Pace | None = None,
) -> Mowing:
    """The quickest passes over an area (north, east), m, with vehicles at most `widest_m` apart.

    `counts` are the numbers of vehicles to choose from: of nearly equal times, the one with the fewest. Without
    `course_deg` the direction is chosen as well. The flight begins and ends at `start_m`; without it, where the passes
    begin. No vehicle's pass enters `avoided`. Raises ValueError where every way has more than PASSES_MAX passes.
    """
    pace = pace or Pace()
    courses = directions_deg(area) if course_deg is None else [course_deg]
    found = [
        one
        for course, count in itertools.product(courses, counts)
        for one in _orders(area, widest_m, count, course, start_m, avoided, pace)
    ]
    if not found:
        raise ValueError(f"more than {PASSES_MAX} passes")
    good_s = _NEAR_BEST * min(one.time_s for one in found)
    return min((one for one in found if one.time_s <= good_s), key=lambda one: (one.count, one.time_s))


def directions_deg(area: shapely.Polygon) -> list[float]:
    """The directions of an area's edges and of its hull's, 0 to 180 degrees from north; that of the longest first."""
    rings = [area.exterior, *area.interiors]
    if isinstance(area.convex_hull, shapely.Polygon):
        rings.insert(0, area.convex_hull.exterior)
    edges = np.concatenate([np.diff(np.array(ring.coords)[:, :2], axis=0) for ring in rings])
    lengths = np.hypot(*edges.T)
    angles = np.degrees(np.arctan2(edges[:, 1], edges[:, 0])) % 180.0
    kept: list[float] = []
    for angle in angles[np.argsort(-lengths, kind="stable")].tolist():
        if all(abs((angle - other + 90.0) % 180.0 - 90.0) > _SAME_DEG for other in kept):
            kept.append(round(angle, 3) % 180.0)
        if len(kept) == _DIRECTIONS_MAX:
            break
    return kept


def _orders(
    area: shapely.Polygon,
    widest_m: float,
    count: int,
    course_deg: float,
    start_m: tuple[float, float] | None,
    avoided: BaseGeometry | None,
    pace: Pace,
) -> Iterator[Mowing]:
    """The four orders in which strips side by side can be flown."""
    along, across = (np.array(axis) for axis in _axes(course_deg))
    spacing_m, strips = _strips(_in_axes(area, along, across), widest_m, count, _in_axes(avoided, along, across))
    if sum(map(len, strips)) > PASSES_MAX:
        return
    for is_reversed, goes_back in itertools.product((False, True), repeat=2):
        flown = []
        ahead = not goes_back
        for middle_m, pieces in reversed(strips) if is_reversed else strips:
            if not pieces:
                continue
            for low, high in pieces if ahead else reversed(pieces):
                ends = (low, high) if ahead else (high, low)
                flown.append(tuple(tuple((end * along + middle_m * across).tolist()) for end in ends))
            ahead = not ahead
        if not flown:
            continue
        front_deg = (course_deg + 180.0 * goes_back) % 360.0
        passes: tuple[Leg, ...] = tuple(flown)  # type: ignore[arg-type]
        home = start_m or passes[0][0]
        whole = Mowing(front_deg, count, spacing_m, passes, 0.0)
        ways = [math.dist(home, passes[0][0])] * (start_m is not None) + [math.dist(passes[-1][1], home)]
        time_s = pace.time_s([*whole.leg_lengths_m(), *ways])
        yield Mowing(front_deg, count, spacing_m, passes, time_s)


def _strips(area: BaseGeometry, widest_m: float, count: int, avoided: BaseGeometry) -> tuple[float, list[Strip]]:
    """The spacing of vehicles and the strips of the line, in order across; passes divide the area's width evenly."""
    west, south, east, north = area.bounds  # across is x, along is y
    number = max(1, math.ceil((east - west) / (count * widest_m) - _ROUNDING_M))
    width_m = (east - west) / number
    spacing_m = width_m / count
    strips: list[Strip] = []
    for left in west + width_m * np.arange(number):
        middle_m = float(left + width_m / 2.0)
        inside = shapely.clip_by_rect(area, left, south - 1.0, left + width_m, north + 1.0)
        if inside.is_empty:
            continue
        low, high = float(inside.bounds[1]), float(inside.bounds[3])
        tracks = left + spacing_m * (np.arange(count) + 0.5)
        pieces = _free(low, high, tracks, avoided)
        strips.append((middle_m, pieces))
    return spacing_m, strips


def _free(low: float, high: float, tracks_m: Array, avoided: BaseGeometry) -> list[tuple[float, float]]:
    """The parts of a pass in which no vehicle is in what is avoided."""
    pieces, at = [], low
    blocked = []
    for track_m in tracks_m:
        met = shapely.intersection(avoided, shapely.LineString([(track_m, low), (track_m, high)]))
        blocked += [(part.bounds[1], part.bounds[3]) for part in shapely.get_parts(met) if not part.is_empty]
    for begin, end in sorted(blocked):
        pieces.append((at, begin))
        at = max(at, end)
    pieces.append((at, high))
    return [(a, b) for a, b in pieces if b - a >= _LEAST_M]


def _axes(course_deg: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Directions (north, east) along a course and to the right of it."""
    angle = math.radians(course_deg)
    return (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))


def _in_axes(shape: BaseGeometry | None, along: Array, across: Array) -> BaseGeometry:
    """A shape (north, east) as (across, along)."""
    if shape is None:
        return shapely.Polygon()
    turned: BaseGeometry = shapely.transform(shape, lambda places: places @ np.column_stack([across, along]))
    return turned
