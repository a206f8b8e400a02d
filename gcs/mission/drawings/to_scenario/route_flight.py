"""The scenario of a drawn route: the values for its template, with names and heights as drawn."""

import itertools
import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Self

import numpy as np

from gcs.errors import FileFormatError
from gcs.mission.drawings.drawing import Drawing, DrawnPoint, tidy
from gcs.mission.drawings.labels import Label, LeftOut, sentences
from gcs.mission.drawings.to_scenario.drawn_areas import AreaTables, area_tables, commented, number_text, place_text
from gcs.mission.drawings.to_scenario.drawn_ground import DEM_HINT
from gcs.mission.drawings.to_scenario.placed_route import PlacedPoint, PlacedRoute, placed_route
from gcs.scenario.schema.degree_keys import ABOVE_GROUND
from gcs.scenario.schema.fields import FARTHEST_M, FLIGHT_MAX_S
from gcs.scenario.schema.formation_table import Generator
from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.scenario import Performance
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.sources.flight_margins import HOVERS_S, ground_phases_s, type_limits
from gcs.scenario.sources.template import FirstFlight, ImpossibleFlight, named_beside, scenario_text
from gcs.scenario.values.formations import places_up_m, turned
from gcs.types import Array

_SHARE = 0.8  # of the speed limits: a plan needs more than the mean speed
_ROOM_M = 60.0  # beside the formation, for detours
_DEM: Key = ("terrain", "dem", "file")
_SAID_MAX = 40  # sentences in the scenario
_LONGEST_FLIGHT = f"the longest flight is {FLIGHT_MAX_S} s"
CRUISE_MPS = 10.0 / 3.0
_ACCEL_MPS2 = 5.0  # half of what a vehicle has for each unit of its load factor
_STEP_S, _LEAST_S = 5.0, 30.0
_STRAIGHT_DEG = 30.0  # at a smaller turn a formation passes at its speed


@dataclass(frozen=True)
class RouteFlight:
    """A flight of `count` vehicles in a shape along a drawn route; `route` and `areas` are what the drawing holds."""

    is_drawn: ClassVar[bool] = True
    drawing: Drawing
    route: PlacedRoute
    areas: AreaTables
    count: int = 6
    shape: Generator = "vee"
    spacing_m: float = 10.0
    cruise_mps: float = CRUISE_MPS  # where no speed is drawn
    limits: Performance = field(default_factory=type_limits)  # of the vehicles

    def quicker(self) -> Self | None:
        """The same flight as fast as it can be planned; None where it is, or where all speeds are drawn."""
        faster = replace(self, cruise_mps=self._most_mps)
        return faster if faster.flight_s < self.flight_s else None

    def fitting(self, longest_s: float) -> str:
        """What to draw in its place, where a battery is enough for `longest_s` from take-off to touch-down."""
        on_ground_s = sum(self._phases_s(0.0)) + HOVERS_S
        if longest_s <= on_ground_s + _LEAST_S:
            return f"take-off and landing take {on_ground_s:.0f} s of it: draw it lower"
        length_m = self.length_m * (longest_s - on_ground_s) / self.flight_s
        slow = "" if self.drawing.speed_mps is None else ", or a higher speed"
        return f"draw about {0.95 * length_m:.0f} of its {self.length_m:.0f} m, the rest in another file{slow}"

    def _phases_s(self, above_m: float) -> tuple[float, float]:
        """Take-off and landing of the vehicle that is highest above the leader, s."""
        ends = self.route.points[0].place_m[2], self.route.points[0 if self.route.returns else -1].place_m[2]
        return ground_phases_s(self.limits, ends[0] + above_m, ends[1] + above_m)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """What is not carried over of the drawing, or is changed."""
        return (*self.route.left_out, *self.areas.left_out, *self._speeds_said)

    @property
    def flight_s(self) -> float:
        """The time from start to end, s. Raises `FileFormatError` for more than a scenario allows."""
        holds_s = np.array([point.drawn.hold_s for point in self.route.points] + [0.0] * self.route.returns)
        holds_s[[0, -1]] = 0.0
        climb_mps, accel_mps2 = _SHARE * self.limits.speed_ned_mps[2], _ACCEL_MPS2 * self.limits.load_factor_max
        least_s = [
            np.maximum(np.diff(ground_m[:, 0]) / speed_mps, np.abs(np.diff(ground_m[:, 1])) / climb_mps).sum() * follows
            for ground_m, follows, speed_mps in zip(*self._ground, self._leg_speeds_mps, strict=True)
        ]
        time_s = flight_time_s(self._course_m, self._leg_speeds_mps, climb_mps, holds_s, accel_mps2, np.array(least_s))
        if time_s > FLIGHT_MAX_S:
            text = f"the route is {self.length_m / 1000.0:.1f} km long and takes {time_s:,.0f} s; {_LONGEST_FLIGHT}"
            raise FileFormatError(f"{self.drawing.source}: {text}.", hint="split it into several files")
        return time_s

    @property
    def length_m(self) -> float:
        """The length of the route, m."""
        return float(np.linalg.norm(np.diff(self._course_m, axis=0), axis=1).sum())

    def keys(self) -> dict[str, str]:
        """What stands in the template for each @KEY@."""
        points, returns = self.route.points, self.route.returns
        places_m = turned(places_up_m(self.shape, self.count, self.spacing_m), self._course_deg)
        lowest_m = self._lowest_m(places_m)
        bottom_m, top_m = self._bounds_m
        top_m += float(places_m[:, 2].max())
        flown = self._course_deg, max(1.0, self.length_m), points[0].place_m[2]
        first = FirstFlight(self.count, self.shape, self.spacing_m, *flown, limits=self.limits).keys()
        source = tidy(Path(self.drawing.source).name)
        yaw = f"{first['ATTITUDE'][2:]}\n" if first["ATTITUDE"] else ""
        begin, end = _with_name(points[0].drawn), _with_name(points[-1].drawn)
        interior = points[1:] if returns else points[1:-1]
        legs = zip(interior, [float(turn) for turn in turns_rad(self._course_m)], strict=False)
        north_m, east_m = self._box(places_m)
        takeoff_s, _ = self._phases_s(float(places_m[:, 2].max()))
        return first | {
            "ALONG": _text(f"{first['TITLE']} along {source}")[1:-1],
            "SOURCE": source,
            "SAID": self._comments(),
            "ORIGIN_IS": self.route.origin_is,
            "LAT": number_text(self.route.origin.lat_deg),
            "LON": number_text(self.route.origin.lon_deg),
            "ALT": repr(float(round(self.route.origin.alt_amsl_m, 3))),
            "FLIGHT": repr(self.flight_s),
            "LENGTH": f"{self.length_m:.0f} m in {self.flight_s:.0f} s",
            "END_WORD": commented('end = "start"', "the route comes back") + "\n" if returns else "",
            "TABLES": "\n".join(
                [
                    *self._terrain(),
                    _place_table("[start]", points[0], f"{begin}, of the leader, which hovers there") + yaw,
                    *(self._route_table(point, turn) for point, turn in legs),
                    *([] if returns else [_place_table("[end]", points[-1], end) + yaw]),
                    *self.areas.texts,
                ]
            ),
            "BOX_NORTH": str(north_m),
            "BOX_EAST": str(east_m),
            "BOX_HEIGHT": str([10.0 * math.floor(bottom_m / 10.0), max(40.0, 10.0 * math.ceil(top_m / 10.0 + 1.5))]),
            "CLEARANCE": repr(min(5.0, math.floor(5.0 * lowest_m) / 10.0)),
            "TAKEOFF": repr(takeoff_s),
        }

    def in_words(self, mistakes: Iterable[Mistake]) -> str:
        """Mistakes of the scenario with the labels of points and areas in place of their keys."""
        points = [self.drawing.named(point.drawn.label) for point in self.route.points]
        interior = points[1:] if self.route.returns else points[1:-1]
        ends = {"start": points[0], "end": points[0 if self.route.returns else -1]}

        def place(one: Mistake) -> str:
            match one.key:
                case ("start" | "end" as which, *_):
                    return ends[which]
                case ("route", int(number), *_) if number < len(interior):
                    return interior[number]
            return f"--terrain {self.route.ground.file}" if one.key == _DEM else self.areas.place(one, self.drawing)

        reason = "\n".join(f"{place(one)}: {one.whole}" for one in mistakes)
        return re.sub(r"\[(start|end)\]", lambda found: ends[found[1]], reason)

    @property
    def _course_m(self) -> Array:
        """The places that the leader passes (N, 3)."""
        return np.array([point.place_m for point in self._round])

    @property
    def _most_mps(self) -> float:
        """The fastest that a leg is flown."""
        return _SHARE * min(self.limits.speed_ned_mps[:2])

    @property
    def _leg_speeds_mps(self) -> Array:
        plain_mps = self.drawing.speed_mps or self.cruise_mps
        drawn = [point.drawn.speed_mps for point in self.route.points[1:]] + [None] * self.route.returns
        return np.array([min(self._most_mps, plain_mps if speed is None else speed) for speed in drawn])

    @property
    def _speeds_said(self) -> list[LeftOut]:
        text = "drawn at {:g} m/s, too fast for this vehicle type; {:g} m/s here"
        drawn = [(point.drawn.label, point.drawn.speed_mps) for point in self.route.points[1:]]
        if self.route.returns or any(speed is None for _, speed in drawn):  # legs at the speed of the whole file
            drawn.insert(0, (Label("the speed"), self.drawing.speed_mps))
        most = self._most_mps
        return [LeftOut(label, text.format(speed, most)) for label, speed in drawn if (speed or 0.0) > most]

    @property
    def _course_deg(self) -> float:
        """The direction of the first leg that is not vertical, degrees."""
        for leg_m in np.diff(self._course_m, axis=0):
            if float(np.hypot(*leg_m[:2])) > 1.0:
                return round(math.degrees(math.atan2(leg_m[1], leg_m[0])), 1) + 0.0
        return 0.0

    def _lowest_m(self, places_m: Array) -> float:
        """The least height of a vehicle above the ground. Raises `FileFormatError` for one at the ground."""
        heights_m = self.route.places_m[:, 2] - [point.ground_m for point in self.route.points]
        lowest_m = float(heights_m.min() + places_m[:, 2].min())
        if lowest_m < 1.0:
            row = int(heights_m.argmin())
            label = self.route.points[row].drawn.label
            text = f"{label} is {heights_m[row]:.1f} m above the ground, too low"
            text = f"{self.drawing.where(label)}: {text} for a {self.shape} of {self.count} vehicles."
            raise FileFormatError(text, hint="give another --shape, or a smaller --spacing")
        return lowest_m

    @property
    def _bounds_m(self) -> tuple[float, float]:
        """The lowest ground, at most 0, and the highest place of the leader, also where it follows the ground."""
        points = self._round
        lines, follows = self._ground
        above_m = [max(a.place_m[2] - a.ground_m, b.place_m[2] - b.ground_m) for a, b in itertools.pairwise(points)]
        followed = zip(lines, above_m, follows, strict=True)
        tops_m = [float(ground_m[:, 1].max()) + most_m for ground_m, most_m, is_followed in followed if is_followed]
        bottom_m = min(float(ground_m[:, 1].min()) for ground_m in lines)
        return min(0.0, bottom_m), max(float(self.route.places_m[:, 2].max()), *tops_m, 0.0)

    @property
    def _round(self) -> list[PlacedPoint]:
        """The points that the leader passes, with the start again where it comes back."""
        return [*self.route.points, *self.route.points[: int(self.route.returns)]]

    @property
    def _ground(self) -> tuple[list[Array], list[bool]]:
        """The ground along each leg, and whether the leader follows it there."""
        lines = self.route.ground.along([point.drawn.place for point in self._round], self.route.origin)
        return lines, [a.key == b.key == ABOVE_GROUND for a, b in itertools.pairwise(self._round)]

    def _terrain(self) -> list[str]:
        """The table of the elevation model, whose path is absolute: the text may stand in any folder."""
        file = self.route.ground.file
        return [] if file is None else [f"[terrain.dem]\nfile = {_text(file.resolve().as_posix())}\n"]

    def _box(self, places_m: Array) -> tuple[list[float], list[float]]:
        """The least and the greatest place north and east, for the formation at any heading, with room for detours."""
        room_m = _ROOM_M + float(np.hypot(*places_m[:, :2].T).max())
        low = 10.0 * np.floor((self._course_m[:, :2].min(axis=0) - room_m) / 10.0)
        high = 10.0 * np.ceil((self._course_m[:, :2].max(axis=0) + room_m) / 10.0)
        low, high = np.maximum(low, -FARTHEST_M), np.minimum(high, FARTHEST_M)
        return [float(low[0]), float(high[0])], [float(low[1]), float(high[1])]

    def _route_table(self, point: PlacedPoint, turn_rad: float) -> str:
        drawn, lines = point.drawn, _place_table("[[route]]", point, str(point.drawn.label))
        if drawn.name:
            head, rest = lines.split("\n", 1)
            lines = f"{head}\nname = {_text(drawn.name)}\n{rest}"
        if drawn.radius_m:
            lines += f"radius_m = {max(0.001, min(round(drawn.radius_m, 3), float(FARTHEST_M)))!r}\n"
        if drawn.hold_s:
            lines += f"hold_s = {round(drawn.hold_s, 3)!r}\n"
        elif drawn.speed_mps is not None:
            speed = f"speed_mps = {round(max(0.001, min(drawn.speed_mps, self._most_mps)), 3)!r}"
            is_straight = is_passed_at_speed(turn_rad)
            lines += f"{speed}\n" if is_straight else commented(f"# {speed}", "of the leg to it; it turns here") + "\n"
        return lines

    def _comments(self) -> str:
        """What is left out, as lines of comments; empty if nothing is."""
        said = sentences(self.left_out, self.drawing.unit)
        more = [f"and {len(said) - _SAID_MAX} more"] * (len(said) > _SAID_MAX)
        lines = ["# Not carried over as it was drawn:", *(f"#   {line}" for line in [*said[:_SAID_MAX], *more])]
        return "\n".join(lines) if said else "#"


def route_flight(
    drawing: Drawing,
    at: tuple[float, float, float | None] | None = None,
    height_m: float | None = None,
    terrain: Path | None = None,
    **formation: object,
) -> RouteFlight:
    """The flight along a drawing. `at`, `height_m` and `terrain` as `placed_route` has them.

    `formation`: count, shape, spacing_m, and the limits of the vehicles.

    Raises `FileFormatError` for a drawing that makes no flight.
    """
    route = placed_route(drawing, at, height_m, terrain)
    spots = [(point.drawn.label, point.place_m[:2]) for point in route.points]
    flight = RouteFlight(drawing, route, area_tables(drawing, drawing.areas, spots, route.origin))
    flight = replace(flight, **formation)  # type: ignore[arg-type]
    flight.keys()  # refuses a flight that takes too long
    return flight


def route_text(folder: Path, flight: RouteFlight, vehicle: str | None = None) -> str:
    """The text of the scenario of a flight, named after its folder, judged with the battery of `vehicle`.

    Raises `ImpossibleFlight` for one that the rules of scenarios refuse, in the words of the drawing.
    """
    origin = flight.route.origin
    try:
        text = scenario_text(folder, origin, flight=flight, template="template_route.toml", vehicle=vehicle)
    except ImpossibleFlight as error:
        which = f"a {flight.shape} of {flight.count}, {flight.spacing_m:g} m apart"
        text = f"{flight.drawing.source}: {which}, is not possible: {flight.in_words(error.mistakes)}"
        hint = "give a smaller --count or --spacing, or another --shape; or draw the area larger"
        if any(one.key == _DEM for one in error.mistakes):
            hint = DEM_HINT
        raise ImpossibleFlight(text, hint=hint, reason=error.reason) from None
    file = flight.route.ground.file
    return text if file is None else named_beside(text, file, folder)


def _with_name(drawn: DrawnPoint) -> str:
    """The label of a point whose table has no key for its name."""
    return f'{drawn.label}, "{drawn.name}"' if drawn.name and drawn.name not in str(drawn.label) else str(drawn.label)


def _place_table(head: str, point: PlacedPoint, comment: str) -> str:
    """A table with the place of a point."""
    title = commented(head, comment)
    return f"{title}\nposition_deg = {place_text(point.drawn.place)}\n{point.key} = {point.height_m!r}\n"


def _text(value: str) -> str:
    """A text of TOML."""
    return json.dumps(value, ensure_ascii=False)


def turns_rad(points_m: Array) -> Array:
    """The angle between the legs before and after each point between the ends (N - 2,), 0 straight ahead, rad."""
    legs_m = np.diff(points_m, axis=0)
    before, after = legs_m[:-1], legs_m[1:]
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    cosine = np.einsum("ij,ij->i", before, after) / np.maximum(lengths, 1e-9)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def is_passed_at_speed(turn_rad: float) -> bool:
    """Whether a formation can be expected to keep its speed at a turn."""
    return turn_rad <= math.radians(_STRAIGHT_DEG)


def flight_time_s(
    points_m: Array,
    speeds_mps: Array,
    climb_mps: float,
    holds_s: Array,
    accel_mps2: float = 1.0,
    least_s: Array | float = 0.0,
) -> float:
    """The time along points (N, 3) with a speed for each leg (N - 1,) and a hold at each point (N,), s.

    No leg takes less than `least_s` (N - 1,), which one over hills needs to climb and to descend.

    A stop costs the time to brake and to accelerate again, a turn the time to change the direction of the velocity.
    """
    legs_m = np.diff(points_m, axis=0)
    flown_s = np.maximum(np.linalg.norm(legs_m, axis=1) / speeds_mps, np.abs(legs_m[:, 2]) / climb_mps)
    flown_s = np.maximum(flown_s, least_s)
    slower_mps = np.minimum(speeds_mps[:-1], speeds_mps[1:])
    stops = holds_s[1:-1] > 0.0
    turned_s = slower_mps * np.where(stops, 1.0, np.sin(turns_rad(points_m) / 2.0)) / accel_mps2
    ends_s = (speeds_mps[0] + speeds_mps[-1]) / 2.0 / accel_mps2
    total_s = float(flown_s.sum() + turned_s.sum() + ends_s + holds_s.sum())
    return max(_LEAST_S, _STEP_S * math.ceil(total_s / _STEP_S))
