"""A survey as a scenario: start, points of the route, line abreast, box, and the area that must be covered."""

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import shapely

from gcs.errors import UsageError, counted
from gcs.scenario.schema.fields import FLIGHT_MAX_S
from gcs.scenario.schema.places import ROUTE_MAX
from gcs.scenario.schema.scenario import Performance
from gcs.scenario.sources.flight_margins import HOVERS_S, ground_phases_s, type_limits
from gcs.scenario.sources.mowing import BOW_M, Mowing, MownPoint, PassTimes, mowing
from gcs.scenario.sources.template import FORMATION, FirstFlight
from gcs.types import Array

COUNTS = (4, 5, 6)  # vehicles to choose from, where no number is given
_ROOM_M = 50.0  # between the box and the tracks
_BESIDE_ZONES_M = 5.0  # between a pass and a no-fly zone: the navigation error of ordinary GNSS has room
_SQUARE_M_PER_HA = 10_000.0
_STEP_M = 10.0  # along the ground
_CLIMB_SHARE = 0.8  # of the vertical speed limit
_COUNT_MAX = 20  # vehicles to propose


@dataclass(frozen=True)
class SurveyGround:
    """The elevation model over which a survey keeps its height.

    `heights_m` gives the ground (N,) above the origin under points (N, 2), north and east, m.
    """

    file: Path
    heights_m: Callable[[Array], Array]


@dataclass(frozen=True)
class SurveyOrder:
    """What is to be surveyed, and how: lengths in metres, from the origin."""

    area: shapely.Polygon  # (north, east), m, with its holes
    swath_m: float
    overlap: float = 0.2  # share of the swath that neighbours see both
    course_deg: float | None = None  # of the passes; None: chosen
    counts: tuple[int, ...] = COUNTS
    height_m: float = 15.0  # above the origin; above the ground where there is one
    speed_mps: float = 4.0
    avoided: tuple[shapely.Polygon, ...] = ()  # no-fly zones (north, east), m
    zones: str = ""  # these and other areas, as tables of a scenario
    starts_at_origin: bool = False  # else where the first pass begins
    limits: Performance = field(default_factory=type_limits)  # of the vehicles
    ground: SurveyGround | None = None


@dataclass(frozen=True)
class SurveyFlight:
    """A survey that can be written as a scenario."""

    is_drawn: ClassVar[bool] = True
    order: SurveyOrder
    mowing: Mowing

    @property
    def start_m(self) -> tuple[float, float]:
        """Where the leader starts and ends: north, east."""
        return (0.0, 0.0) if self.order.starts_at_origin else self._leader(self.mowing.passes[0][0])

    @property
    def area_ha(self) -> float:
        """The area without its holes, hectares."""
        return float(self.order.area.area) / _SQUARE_M_PER_HA

    @property
    def seen(self) -> float:
        """The share of the area that is within half a swath of a pass: less than 1 beside no-fly zones."""
        area = self.order.area
        covered = self.mowing.lines.buffer(self.order.swath_m / 2.0, cap_style="flat")
        return float(covered.intersection(area).area / area.area)

    @property
    def flight_s(self) -> float:
        """From start to end, s."""
        return 5.0 * math.ceil((self.mowing.time_s + self._climbs_s) / 5.0)

    @property
    def flown_m(self) -> Array:
        """The ends of all passes of all vehicles, and the start (N, 2), north and east, m."""
        return np.concatenate([shapely.get_coordinates(self.mowing.lines), [self.start_m]])

    @property
    def _climbs_s(self) -> float:
        """What legs over steep ground take longer than level ones, s."""
        ground, found_s = self.order.ground, 0.0
        if ground is None:
            return found_s
        places_m = np.array([self.start_m, *(point.place_m for point in self.points()), self.start_m])
        for first_m, last_m in itertools.pairwise(places_m):
            length_m = float(np.linalg.norm(last_m - first_m))
            share = np.linspace(0.0, 1.0, 2 + int(length_m / _STEP_M))[:, None]
            way_m = np.abs(np.diff(ground.heights_m(first_m + share * (last_m - first_m)))).sum()
            climb_s = float(way_m) / (_CLIMB_SHARE * self.order.limits.speed_ned_mps[2])
            found_s += max(0.0, climb_s - length_m / self.order.speed_mps)
        return found_s

    def quicker(self) -> None:
        """Speed and number of vehicles are those of the order."""

    def fitting(self, longest_s: float) -> str:
        """What to give in its place, where a battery is enough for `longest_s` from take-off to touch-down."""
        mown = self.mowing
        left_s = longest_s - sum(ground_phases_s(self.order.limits, self.order.height_m)) - HOVERS_S
        for count in range(mown.count + 1, _COUNT_MAX + 1):
            try:
                quick = survey_flight(replace(self.order, counts=(count,)))
            except UsageError:
                continue
            if quick.flight_s <= left_s:
                return f"give --count {count}, a wider --swath or less --overlap"
        return "give a part of the area, a wider --swath, less --overlap or a lower --height"

    def points(self) -> list[MownPoint]:
        """The leader's points after the start."""
        own = [replace(point, place_m=self._leader(point.place_m)) for point in self.mowing.places()]
        return own if self.order.starts_at_origin else own[1:]

    def keys(self) -> dict[str, str]:
        """What stands in the template for each @KEY@; FORMATION is the table [formation] and [survey]."""
        order, mown = self.order, self.mowing
        spacing_m = round(mown.spacing_m, 3)
        first = FirstFlight(mown.count, "line", spacing_m, mown.course_deg, 100.0, order.height_m, limits=order.limits)
        plain = first.keys()
        flown = self.flown_m
        reach_m = _ROOM_M + max(map(max, mown.leads_m)) + mown.count * spacing_m * order.starts_at_origin
        box = np.stack([flown.min(axis=0) - reach_m, flown.max(axis=0) + reach_m])
        low, high = 10.0 * np.floor(box[0] / 10.0), 10.0 * np.ceil(box[1] / 10.0)
        yaw = plain["ATTITUDE"]
        end = [
            'end = "start"                 # home again',
            *plain["END"].split("\n")[1:],
            *self._terrain(),
            *self._route(plain["YAW"]),
        ]
        return plain | {
            "TITLE": f"survey of {self.area_ha:.2f} ha by {counted(mown.count, 'quadrotor')}",
            "FLIGHT": repr(self.flight_s),
            "START": f"start = {{ position_m = {_numbers(self._position(self.start_m))}{yaw} }}  ",
            "END": "\n".join(end),
            "NO_FLY": order.zones.rstrip("\n") or "# no_fly = [{ polygon_m = [[north, east], ...] }]",
            "BOX_NORTH": _numbers([low[0], high[0]]),
            "BOX_EAST": _numbers([low[1], high[1]]),
            "BOX_HEIGHT": plain["BOX_HEIGHT"] if order.ground is None else self._heights(order.ground),
            FORMATION: "\n".join([*self._formation(spacing_m, plain["HEADING"]), "", *self._survey(), ""]),
        }

    def _leader(self, middle_m: tuple[float, float]) -> tuple[float, float]:
        """The leader's place in a line whose middle is there: with an even number, it is left of the middle."""
        aside_m = -0.5 * self.mowing.spacing_m * (self.mowing.count % 2 == 0)
        angle = math.radians(self.mowing.course_deg)
        return middle_m[0] - aside_m * math.sin(angle), middle_m[1] + aside_m * math.cos(angle)

    def _position(self, place: tuple[float, float]) -> list[float]:
        """What stands in position_m: over an elevation model the height is that of [legs]."""
        return [*place] if self.order.ground is not None else [*place, self.order.height_m]

    def _heights(self, ground: SurveyGround) -> str:
        """The box's heights, for passes that follow the ground."""
        ends_m = shapely.get_coordinates(shapely.segmentize(self.mowing.lines, _STEP_M))
        under_m = ground.heights_m(np.concatenate([ends_m, self.flown_m]))
        low_m, high_m = min(0.0, float(under_m.min())), float(under_m.max()) + self.order.height_m
        return _numbers([10.0 * math.floor(low_m / 10.0), max(40.0, 10.0 * math.ceil(high_m / 10.0 + 1.5))])

    def _terrain(self) -> list[str]:
        ground = self.order.ground
        if ground is None:
            return []
        return [
            f"terrain = {{ dem = {{ file = {json.dumps(ground.file.resolve().as_posix(), ensure_ascii=False)} }} }}",
            f"legs = {{ height_above_ground_m = {self.order.height_m!r} }}  # the leader follows it",
        ]

    def _route(self, yaw_deg: str) -> list[str]:
        # Without a heading at the points vehicles would turn towards every leg, which takes time and moves the camera.
        yaw = f", heading_deg = {yaw_deg}"
        straight = f", corridor_m = {BOW_M}"  # of a pass, which ends here
        rows = [
            f'  {{ name = "{point.name}", position_m = {_numbers(self._position(point.place_m))}{yaw}'
            f"{straight * point.ends_pass} }},"
            for point in self.points()
        ]
        return ["route = [                     # places of the leader, in order", *rows, "]"]

    def _formation(self, spacing_m: float, heading: str) -> list[str]:
        order, mown = self.order, self.mowing
        overlap = f"{1.0 - spacing_m / order.swath_m:.0%}"
        return [
            "[formation]                   # vehicle 1 leads; the line keeps its direction, also on the way back",
            f"count = {mown.count}",
            'start_shape = "line"',
            f'shape = [{{ name = "line", generator = "line", spacing_m = {spacing_m}{heading} }}]  # overlap {overlap}',
        ]

    def _survey(self) -> list[str]:
        order = self.order
        lines = [
            "[survey]                      # gcs plan proves how much of this area the vehicles see",
            f"swath_m = {order.swath_m}".ljust(30) + "# a vehicle sees half of it to each side",
            f"polygon_m = {_corners(order.area.exterior)}  # north, east",
        ]
        if order.ground is not None:
            lines.append(f"height_above_ground_m = {order.height_m!r}  # from which swath_m is seen")
        if order.area.interiors:
            note = "vehicles may cross what is no no-fly zone" if order.avoided else "vehicles may cross them"
            rows = [f"  {{ polygon_m = {_corners(ring)} }}," for ring in order.area.interiors]
            lines += [f"hole = [                      # not surveyed; {note}", *rows, "]"]
        return lines


def survey_flight(order: SurveyOrder) -> SurveyFlight:
    """The quickest survey. Raises UsageError for one that a scenario cannot hold."""
    avoided = shapely.union_all(order.avoided).buffer(_BESIDE_ZONES_M) if order.avoided else None
    widest_m = order.swath_m * (1.0 - order.overlap)
    start_m = (0.0, 0.0) if order.starts_at_origin else None
    try:
        mown = mowing(
            order.area,
            widest_m,
            order.counts,
            course_deg=order.course_deg,
            start_m=start_m,
            avoided=avoided,
            times=PassTimes(order.speed_mps),
        )
    except ValueError:
        text = f"a route has at most {ROUTE_MAX} points; {max(order.counts)} vehicles {widest_m:g} m apart need more"
        raise UsageError(text, hint="give more vehicles, a wider swath, or a part of the area") from None
    if mown.time_s > FLIGHT_MAX_S:
        text = f"the survey takes {mown.time_s:,.0f} s; a flight takes at most {FLIGHT_MAX_S:,} s"
        raise UsageError(text, hint="give more vehicles, a wider swath, or a part of the area")
    return SurveyFlight(order, mown)


def _corners(ring: shapely.LinearRing) -> str:
    return str([[round(float(value), 2) + 0.0 for value in corner] for corner in np.array(ring.coords)[:-1, :2]])


def _numbers(values: Array | list[float]) -> str:
    return str([round(float(value), 2) + 0.0 for value in values])
