"""Passes of a line abreast over an area, there and back, such that each place is near the track of a vehicle.

The line keeps its direction and flies sideways from pass to pass: abreast of a pass is abreast of the way back too.
A line that turned with its course would never be faster. On the same track of the centre the speed of an outer vehicle
would be the centre's plus the turn rate times its distance, and the limits hold for every vehicle.

Of all directions, an edge of the area's convex hull has the fewest passes: the width of a convex polygon is least
across one of its edges. Other edges are tried too, because the legs count as well.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from gcs.scenario.schema.places import ROUTE_MAX
from gcs.types import Array

_TURN_MPS2 = 1.0  # sideways in a turn: half of what a bank of 11 degrees gives
_SAME_DEG = 0.2  # directions that differ by less are one
_DIRECTIONS_MAX = 90  # tried at most: an outline of hundreds of corners has no edge to fly along
_ROUNDING_M = 1e-6
_NEAR_BEST = 1.02  # of the least time: as good, so that fewer vehicles are better
_LEAST_M = 0.5  # a shorter piece of a pass is not flown
BOW_M = 0.5  # a planned pass may bow by as much and still cover the area's edge

Place = tuple[float, float]  # north, east, m
Leg = tuple[Place, Place]  # where the middle of the line begins and ends


@dataclass(frozen=True)
class PassTimes:
    """The time that flying takes: a speed, and what each turn between two legs adds."""

    speed_mps: float = 4.0
    turn_s: float = 3.0

    @property
    def lead_m(self) -> float:
        """How far outside of the area a turn begins: it ends before the line is over the area again."""
        return self.speed_mps**2 / _TURN_MPS2

    def time_s(self, places: Sequence[Place], passes: int) -> float:
        """The time for a way with `passes`, each with a turn at both ends, s."""
        length_m = sum(math.dist(a, b) for a, b in itertools.pairwise(places))
        return length_m / self.speed_mps + 2 * passes * self.turn_s


@dataclass(frozen=True)
class Strip:
    """What one pass of the line covers: its middle across, its ends along, and the pieces in which it is flown, m."""

    middle_m: float
    low_m: float
    high_m: float
    pieces: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class MownPoint:
    """A point of the route of a survey (north, east), m."""

    name: str
    place_m: Place
    ends_pass: bool = False


@dataclass(frozen=True)
class Mowing:
    """A line abreast of `count` vehicles, `spacing_m` apart, whose front is at `course_deg`, and its passes in order.

    Passes are those of the middle of the line. The direction of flight is the front or its opposite. `leads_m` are the
    lengths before and after each pass that are flown straight as well, so that the line turns outside of the area.
    """

    course_deg: float
    count: int
    spacing_m: float
    passes: tuple[Leg, ...]
    leads_m: tuple[tuple[float, float], ...]
    time_s: float = 0.0

    @property
    def lines(self) -> shapely.MultiLineString:
        """The passes of all vehicles (north, east), m."""
        across = np.array(_axes(self.course_deg)[1])
        away = (np.arange(self.count) - (self.count - 1) / 2.0) * self.spacing_m
        return shapely.MultiLineString([np.array(leg) + one * across for leg in self.passes for one in away])

    def places(self) -> list[MownPoint]:
        """The places of the middle of the line in order."""
        found: list[MownPoint] = []
        for number, ((begin, end), (before_m, after_m)) in enumerate(
            zip(self.passes, self.leads_m, strict=True), start=1
        ):
            ahead = np.subtract(end, begin) / math.dist(begin, end)
            if before_m:
                found.append(MownPoint(f"before pass {number}", _moved(begin, -before_m * ahead)))
            found += [MownPoint(f"pass {number} begins", begin), MownPoint(f"pass {number} ends", end, ends_pass=True)]
            if after_m:
                found.append(MownPoint(f"after pass {number}", _moved(end, after_m * ahead)))
        return found


def mowing(
    area: shapely.Polygon,
    widest_m: float,
    counts: Iterable[int],
    *,
    course_deg: float | None = None,
    start_m: Place | None = None,
    avoided: BaseGeometry | None = None,
    times: PassTimes | None = None,
) -> Mowing:
    """The quickest passes over an area (north, east), m, with vehicles at most `widest_m` apart.

    `counts` are the numbers of vehicles to choose from: of nearly equal times, the one with the fewest. Without
    `course_deg` the direction is chosen as well. The flight begins and ends at `start_m`; without it, where the passes
    begin. No vehicle's pass enters `avoided`; what is seen beside it comes before time. Raises ValueError where every
    way has more points than a route.
    """
    times = times or PassTimes()
    courses = directions_deg(area) if course_deg is None else [course_deg]
    found = [
        one
        for course, count in itertools.product(courses, counts)
        for one in _orders(area, widest_m, count, course, start_m, avoided, times)
    ]
    if not found:
        raise ValueError(f"more than {ROUTE_MAX} points")
    if avoided is not None:  # passes that are cut short are quick: seeing the area comes first
        inside_m2 = [one.spacing_m * one.lines.intersection(area).length for one in found]
        found = [one for one, seen_m2 in zip(found, inside_m2, strict=True) if _NEAR_BEST * seen_m2 >= max(inside_m2)]
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
    start_m: Place | None,
    avoided: BaseGeometry | None,
    times: PassTimes,
) -> Iterator[Mowing]:
    """The four orders in which strips side by side can be flown."""
    along, across = (np.array(axis) for axis in _axes(course_deg))
    spacing_m, strips = _strips(_in_axes(area, along, across), widest_m, count, _in_axes(avoided, along, across))
    if 2 * sum(len(strip.pieces) for strip in strips) > ROUTE_MAX:
        return
    for is_reversed, goes_back in itertools.product((False, True), repeat=2):
        passes: list[Leg] = []
        leads_m: list[tuple[float, float]] = []
        ahead = not goes_back
        for strip in reversed(strips) if is_reversed else strips:
            for piece in strip.pieces if ahead else reversed(strip.pieces):
                # Inside a strip a pass goes on behind what it avoids: there is no turn.
                leads = [times.lead_m * (piece[0] == strip.low_m), times.lead_m * (piece[1] == strip.high_m)]
                ends = [tuple((end * along + strip.middle_m * across).tolist()) for end in piece]
                passes.append(tuple(ends if ahead else ends[::-1]))  # type: ignore[arg-type]
                leads_m.append(tuple(leads if ahead else leads[::-1]))  # type: ignore[arg-type]
            ahead = ahead != bool(strip.pieces)
        if not passes:
            continue
        if start_m is None:  # the first pass begins at rest
            leads_m[0] = (0.0, leads_m[0][1])
        front_deg = (course_deg + 180.0 * goes_back) % 360.0
        mown = Mowing(front_deg, count, spacing_m, tuple(passes), tuple(leads_m))
        flown = [point.place_m for point in mown.places()]
        if len(flown) <= ROUTE_MAX:
            home = [start_m or flown[0]]
            time_s = times.time_s([*home, *flown, *home], len(passes))
            # Behind what a pass avoids the line comes back to its strip: as far aside as it is wide
            aside_m = count * spacing_m * sum(len(strip.pieces) - 1 for strip in strips if strip.pieces)
            yield replace(mown, time_s=time_s + 2.0 * aside_m / times.speed_mps)


def _strips(area: BaseGeometry, widest_m: float, count: int, avoided: BaseGeometry) -> tuple[float, list[Strip]]:
    """The spacing of vehicles and the strips of the line, in order across: they divide the area's width evenly.

    `BOW_M` on each side counts too: what a track that bows leaves out there, no neighbour sees.
    """
    west, south, east, north = area.bounds  # across is x, along is y
    west, east = west - BOW_M, east + BOW_M
    number = max(1, math.ceil((east - west) / (count * widest_m) - _ROUNDING_M))
    width_m = (east - west) / number
    spacing_m = width_m / count
    strips: list[Strip] = []
    for left in west + width_m * np.arange(number):
        inside = shapely.clip_by_rect(area, left, south - 1.0, left + width_m, north + 1.0)
        if not inside.is_empty:
            low, high = float(inside.bounds[1]), float(inside.bounds[3])
            tracks = left + spacing_m * (np.arange(count) + 0.5)
            strips.append(Strip(float(left + width_m / 2.0), low, high, _free(low, high, tracks, avoided)))
    return spacing_m, strips


def _free(low: float, high: float, tracks_m: Array, avoided: BaseGeometry) -> tuple[tuple[float, float], ...]:
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
    return tuple((a, b) for a, b in pieces if b - a >= _LEAST_M)


def _moved(place: Place, by_m: Array) -> Place:
    return place[0] + float(by_m[0]), place[1] + float(by_m[1])


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
