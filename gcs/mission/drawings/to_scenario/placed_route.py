"""The points of a drawing as the leader flies them: in metres from the origin, at heights that can be flown.

There are as many as a scenario may have, and no two of them at one place; a recorded line is thinned.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import FileFormatError, counted
from gcs.frames import Origin, geodetic_to_ned, place_up_m
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnPoint
from gcs.mission.drawings.item_course import HOLD_MAX_S
from gcs.mission.drawings.labels import Label, LeftOut, sentences
from gcs.mission.drawings.to_scenario.drawn_ground import LEVEL, Ground, ground_of
from gcs.scenario.schema.degree_keys import ABOVE_GROUND
from gcs.scenario.schema.fields import FARTHEST_M
from gcs.scenario.schema.places import ROUTE_MAX
from gcs.types import Array

_BEYOND_M = 20_000.0  # such heights are no numbers of metres
_HIGHEST_M = 1500.0  # a formation climbs half an hour to it
_HOME_NEAR_M = 20_000.0
_BACK_M = 2.0  # a route that ends so near to its start comes back
_SAME_M = 0.3
_TRACK_M, _TRACK_MAX_M, _STRAIGHT_M = 1.0, 32.0, 0.5  # tolerances of lines with fewer points
_CLIMB_M, _STILL_M = 2.0, 3.0  # a take-off climbs more, and stays so near to where it began
_GIVE_GROUND = "give the altitude of the ground: --at LAT,LON,ALT"
_SAID_MAX = 3  # sentences in an error
HEIGHT_M = 15.0  # of points without one, above the origin
LOWEST_M = 1.0  # lower points are on the ground


@dataclass(frozen=True)
class PlacedPoint:
    """A point, its place north, east and up from the origin, and its height by the key that the scenario has for it."""

    drawn: DrawnPoint
    place_m: tuple[float, float, float]
    key: str
    height_m: float
    ground_m: float = 0.0  # height of the ground there
    remark: str = ""  # what is changed of it


def placed_point(
    point: DrawnPoint,
    origin: Origin,
    drawing: Drawing,
    height_m: float | None,
    ground: Ground = LEVEL,
) -> PlacedPoint:
    """A point in metres; one without a height, or on the ground, gets `height_m`."""
    ground_m = ground.height_m(point.place, origin)
    if point.datum is Datum.GROUND:
        above_m, remark = point.height_m, ""
        if height_m is not None and above_m < LOWEST_M:
            remark = f"a height of {above_m:g} m is on the ground; flown at {height_m:g} m"
            above_m = height_m
        placed = _placed(point, ABOVE_GROUND, ground_m + above_m, origin, ground_m)
        return replace(placed, height_m=round(above_m, 3), remark=remark)
    if point.datum is Datum.NONE:
        return _placed(point, "height_m", HEIGHT_M if height_m is None else height_m, origin, ground_m)
    key, value = "height_m", point.height_m
    home = drawing.home if point.datum is Datum.HOME else None
    if point.datum is Datum.SEA:
        key = "alt_amsl_m"
    elif home is not None and home.alt_amsl_m != origin.alt_amsl_m:
        key, value = "alt_amsl_m", home.alt_amsl_m + value
    placed = _placed(point, key, value, origin, ground_m)
    above_ground_m = placed.place_m[2] - ground_m
    if point.datum is not Datum.SEA:  # home may be lower than the origin, or higher
        above_ground_m = min(above_ground_m, point.height_m)
    if height_m is not None and above_ground_m < LOWEST_M:
        where = "above the sea is under the ground" if point.datum is Datum.SEA else "is on the ground"
        remark = f"a height of {point.height_m:g} m {where}; flown at {height_m:g} m"
        return replace(_placed(point, "height_m", height_m, origin, ground_m), remark=remark)
    return placed


def _placed(point: DrawnPoint, key: str, value: float, origin: Origin, ground_m: float) -> PlacedPoint:
    if key == "alt_amsl_m":
        place_m = geodetic_to_ned(*point.place, value, origin) * [1.0, 1.0, -1.0]
    else:
        place_m = place_up_m(*point.place, value, origin)
    north_m, east_m, up_m = map(float, place_m)
    return PlacedPoint(point, (north_m, east_m, up_m), key, round(value, 3), ground_m)


def fewer(drawing: Drawing, points: list[PlacedPoint]) -> tuple[list[PlacedPoint], list[LeftOut]]:
    """As many points as a scenario may have, with a remark. Raises `FileFormatError` where drawn ones would be lost."""
    most = ROUTE_MAX + (1 if drawing.returns else 2)
    if len(points) <= most and not drawing.recorded:
        return points, []
    places_m = np.array([point.place_m for point in points])
    drawn = [point.drawn for point in points]
    pairs = zip(drawn, [*drawn[1:], drawn[-1]], strict=True)
    # More than places between the points before and after
    kept = np.array(
        [bool(a.hold_s or (a.name and a.name != b.name) or a.speed_mps != b.speed_mps) for a, b in pairs], dtype=bool
    )
    is_line = all(one.datum is not Datum.HOME and not one.hold_s and one.speed_mps is None for one in drawn)
    tolerance_m = _TRACK_M if is_line else _STRAIGHT_M
    stays = thinned(places_m, tolerance_m, kept & (not drawing.recorded))
    while is_line and stays.sum() > most and tolerance_m < _TRACK_MAX_M:
        tolerance_m *= 2.0
        stays = thinned(places_m, tolerance_m, np.zeros(len(points), dtype=bool))
    if stays.sum() > most:
        text = f"{drawing.source}: has {len(points)} points, and a route has at most {most}."
        raise FileFormatError(text, hint="split it into several files, or draw it with fewer points")
    flown = f"{stays.sum()} of {len(points)} points are flown"
    remark = LeftOut(Label("points"), f"{flown}; no other is more than {tolerance_m:g} m from the route")
    return [one for one, stay in zip(points, stays, strict=True) if stay], [remark] * (not stays.all())


def merged_points(points: list[PlacedPoint]) -> tuple[list[PlacedPoint], list[LeftOut]]:
    """The points without those at the place of the one before, whose holds count there, and remarks on these."""
    merged, left_out = points[:1], []
    for point in points[1:]:
        before = merged[-1]
        if float(np.linalg.norm(np.subtract(point.place_m, before.place_m))) > _SAME_M:
            merged.append(point)
            continue
        hold_s = min(before.drawn.hold_s + point.drawn.hold_s, HOLD_MAX_S)
        radius_m = 0.0 if hold_s else before.drawn.radius_m
        name = before.drawn.name or point.drawn.name
        merged[-1] = replace(before, drawn=replace(before.drawn, hold_s=hold_s, radius_m=radius_m, name=name))
        left_out.append(LeftOut(point.drawn.label, f"at the place of {before.drawn.label}; one point with it"))
    return merged, left_out


def thinned(points_m: Array, tolerance_m: float, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the points (N, 3) a line within `tolerance_m` of all points needs (N,); those of `kept` stay.

    Between two points that stay, the point farthest from the straight line stays too, until none is too far.
    """
    stays = kept.copy()
    stays[[0, -1]] = True
    rows = np.flatnonzero(stays)
    waiting = list(itertools.pairwise(rows.tolist()))
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        # The distances of the points between from the straight line
        along, from_first_m = points_m[last] - points_m[first], points_m[first + 1 : last] - points_m[first]
        length2 = float(along @ along)
        share = np.clip(from_first_m @ along / length2, 0.0, 1.0) if length2 else np.zeros(len(from_first_m))
        away_m = np.linalg.norm(from_first_m - share[:, None] * along, axis=1)
        farthest = int(away_m.argmax())
        if away_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            stays[middle] = True
            waiting += [(first, middle), (middle, last)]
    return stays


def airborne(points_m: Array) -> tuple[int, int]:
    """The rows of the first and the last point of a track (N, 3) between its vertical take-off and landing.

    Without a take-off or a landing in the track it is 0, or N - 1.
    """
    return _top(points_m), len(points_m) - 1 - _top(points_m[::-1])


def _top(points_m: Array) -> int:
    """The row at which a vertical climb from the first point ends; 0 if there is none."""
    is_away = np.hypot(*(points_m[:, :2] - points_m[0, :2]).T) > _STILL_M
    rows = int(is_away.argmax()) if is_away.any() else len(points_m)
    climbed_m = points_m[:rows, 2] - points_m[0, 2]
    return int(climbed_m.argmax()) if climbed_m.max() >= _CLIMB_M else 0


@dataclass(frozen=True)
class PlacedRoute:
    """The points in order, whether the route ends at its start, the origin, and the remarks on the drawing."""

    points: tuple[PlacedPoint, ...]
    returns: bool
    origin: Origin
    origin_is: str
    left_out: tuple[LeftOut, ...]
    ground: Ground = LEVEL

    @property
    def places_m(self) -> Array:
        """The places of the points (N, 3), north, east, up, m."""
        return np.array([point.place_m for point in self.points])


def placed_route(
    drawing: Drawing,
    at: tuple[float, float, float | None] | None,
    height_m: float | None,
    terrain: Path | None = None,
) -> PlacedRoute:
    """The route of a drawing, with the origin `at`, else at its planned home, else at its first point.

    `height_m` is the height of points without one, or on the ground; `terrain` the elevation model from which heights
    above the ground count. Raises `FileFormatError` for a drawing that makes no route.
    """
    drawing, of_home = _with_home(drawing)
    left_out = [*drawing.left_out, *of_home]
    _refuse_few(drawing, len(drawing.points))
    ground_m = None
    points = list(drawing.points)
    for point in points:
        if abs(point.height_m) > _BEYOND_M:
            where = drawing.where(point.label)
            raise FileFormatError(f"{where}: {point.label} is at {point.height_m:g} m, beyond any flight.")
    if height_m is None:
        points, of_heights = _with_heights(points)
        left_out += of_heights
    if drawing.recorded:
        points, ground_m, of_ends = _in_the_air(points)
        left_out += of_ends
    ground = LEVEL if terrain is None else ground_of(terrain, [point.place for point in points])
    origin, origin_is, of_origin = _origin(drawing, points, at, ground_m, height_m or HEIGHT_M, ground)
    placed = [placed_point(point, origin, drawing, height_m, ground) for point in points]
    left_out += [*of_origin, *(LeftOut(one.drawn.label, one.remark) for one in placed if one.remark)]
    if terrain is None and any(point.key == ABOVE_GROUND for point in placed):
        text = (
            "above the ground count from level ground at the origin's altitude; for the true ground give --terrain DEM"
        )
        left_out.append(LeftOut(Label("heights"), text))
    if bare := sum(point.datum is Datum.NONE for point in points):
        every = "no point has a height" if bare == len(points) else f"{counted(bare, 'point')} without a height"
        left_out.append(
            LeftOut(Label("heights"), f"{every}; flown {height_m or HEIGHT_M:g} m above the origin (--height)")
        )
    placed, of_few = fewer(drawing, placed)
    placed, of_merged = merged_points(placed)
    left_out += [*of_few, *of_merged]
    places_m = np.array([point.place_m for point in placed])
    far_m = float(np.abs(places_m).max())
    if far_m > FARTHEST_M:
        limit = f"the limit is {FARTHEST_M / 1000.0:,.0f} km"
        label = placed[int(np.abs(places_m).max(axis=1).argmax())].drawn.label
        text = f"{drawing.where(label)}: {label} is {far_m / 1000.0:,.0f} km from the origin ({origin_is}); {limit}."
        raise FileFormatError(text, hint="correct that point, or give --at near the route")
    comes_back = len(placed) > 2 and float(np.linalg.norm(places_m[-1] - places_m[0])) <= _BACK_M
    if comes_back:
        placed = placed[:-1]
    returns = comes_back or drawing.returns
    _refuse_few(drawing, len(placed))
    _refuse_heights(drawing, placed, ground_given=at is not None and at[2] is not None)
    ends = placed[:1] if returns else [placed[0], placed[-1]]
    text = "the hold is not carried over; the formation hovers there before or after the flight"
    left_out += [LeftOut(point.drawn.label, text) for point in ends if point.drawn.hold_s]
    return PlacedRoute(tuple(placed), returns, origin, origin_is, tuple(left_out), ground)


def _refuse_few(drawing: Drawing, count: int) -> None:
    if count >= 2:
        return
    step = "draw a line through the area" if drawing.areas and not drawing.points else "draw at least two points"
    has = "no point" if not drawing.points else "only one place"
    left_out = sentences(drawing.left_out, drawing.unit)
    why = f" ({'; '.join(left_out[:_SAID_MAX])}{'; ...' if len(left_out) > _SAID_MAX else ''})" if left_out else ""
    raise FileFormatError(f"{drawing.source}: is no route: it has {has} to fly to{why}.", hint=step)


def _with_home(drawing: Drawing) -> tuple[Drawing, list[LeftOut]]:
    """The drawing without a home that is far from its route; with a point above home, where it has one other only."""
    home = drawing.home
    if home is None or not drawing.points:
        return drawing, []
    first = Origin(*drawing.points[0].place, home.alt_amsl_m)
    away_m = float(np.linalg.norm(geodetic_to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m, first)))
    if away_m > _HOME_NEAR_M:
        text = f"it is {away_m / 1000.0:,.0f} km away; the origin is the first point"
        return replace(drawing, home=None), [LeftOut(Label("the planned home"), text)]
    only, *more = drawing.points
    if more:
        return drawing, []
    above = replace(only, place=(home.lat_deg, home.lon_deg), label=Label("the planned home"), name="", hold_s=0.0)
    text = "the file has no other point; the route begins at its height above home"
    return replace(drawing, points=(above, only)), [LeftOut(only.label, text)]


def _with_heights(points: list[DrawnPoint]) -> tuple[list[DrawnPoint], list[LeftOut]]:
    """The points, where only some have a height: between two at heights that count alike on the straight line.

    Elsewhere, the height of the point before, and before the first one its own.
    """
    known = [row for row, point in enumerate(points) if point.datum is not Datum.NONE]
    if not known or len(known) == len(points):
        return points, []
    lat, lon = np.array([point.place for point in points]).T
    along_m = np.linalg.norm(np.diff(place_up_m(lat, lon, 0.0, Origin(*points[0].place, 0.0)), axis=0), axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(along_m)])
    found, left_out = [], []
    for row, point in enumerate(points):
        if point.datum is not Datum.NONE:
            found.append(point)
            continue
        before, after = max((one for one in known if one < row), default=known[0]), known[-1]
        after = min((one for one in known if one > row), default=before)
        ends = points[before], points[after]
        if ends[0].datum is not ends[1].datum:
            after = before
        heights_m = points[before].height_m, points[after].height_m
        height_m = float(np.interp(way_m[row], way_m[[before, after]], heights_m)) if after > before else heights_m[0]
        found.append(replace(point, height_m=height_m, datum=ends[0].datum))
        left_out.append(LeftOut(point.label, "has no height; flown at that of the points beside it (--height)"))
    return found, left_out


def _in_the_air(points: list[DrawnPoint]) -> tuple[list[DrawnPoint], float | None, list[LeftOut]]:
    """A track without its take-off and landing, the height of the ground where it takes off, and remarks."""
    if any(point.datum is Datum.NONE or point.datum is not points[0].datum for point in points):
        return points, None, []
    # The places of points of one datum (N, 3), north, east and up from the first, m
    lat, lon = np.array([point.place for point in points]).T
    places_m = place_up_m(lat, lon, np.array([point.height_m for point in points]), Origin(*points[0].place, 0.0))
    first, last = airborne(places_m)
    if last <= first:
        return points, None, []
    left_out = [
        LeftOut(points[end].label, f"the route {'ends' if end else 'begins'} above it, in the air")
        for row, end in ((first, 0), (last, len(points) - 1))
        if row != end
    ]
    is_ground = first > 0 and points[0].datum is Datum.SEA
    return points[first : last + 1], points[0].height_m if is_ground else None, left_out


def _origin(
    drawing: Drawing,
    points: Sequence[DrawnPoint],
    at: tuple[float, float, float | None] | None,
    ground_m: float | None,
    below_m: float,
    ground: Ground,
) -> tuple[Origin, str, list[LeftOut]]:
    """The origin, in words what it is, and a remark on its altitude."""
    home, left_out = drawing.home, []
    place, what, alt_m = points[0].place, "the first point", ground_m
    if home is not None:
        place, what, alt_m = (home.lat_deg, home.lon_deg), "planned home", home.alt_amsl_m
    if at is not None:
        place, what, alt_m = at[:2], "as given", alt_m if at[2] is None else at[2]
    if alt_m is None and (under_m := ground.alt_amsl_m(place)) is not None:
        alt_m = round(under_m, 1)
        left_out.append(LeftOut(Label("the origin"), f"its altitude is that of --terrain, {alt_m:g} m above the sea"))
    if alt_m is None:
        above_sea_m = [point.height_m for point in points if point.datum is Datum.SEA]
        alt_m = float(np.floor(min(above_sea_m) - below_m)) if above_sea_m else 0.0
        if above_sea_m:
            text = f"the ground is taken to be {below_m:g} m below the lowest point, {alt_m:g} m above the sea"
        else:
            text = "its altitude is not in the file: 0 m above the sea"
        left_out.append(LeftOut(Label("the origin"), f"{text}; for the true one give --at LAT,LON,ALT"))
    if not (abs(place[0]) <= 85.0 and -500.0 <= alt_m <= 9000.0):
        where = f"latitude {place[0]:g}, {alt_m:g} m above the sea"
        raise FileFormatError(f"{drawing.source}: its origin is at {where}, where no scenario is.", hint="give --at")
    return Origin(*place, alt_m), what, left_out


def _refuse_heights(drawing: Drawing, points: Sequence[PlacedPoint], *, ground_given: bool) -> None:
    highest = max(points, key=lambda point: point.place_m[2])
    if (up_m := highest.place_m[2]) > _HIGHEST_M:
        text = f"{highest.drawn.label} is {up_m:,.0f} m above the origin; the limit is {_HIGHEST_M:,.0f} m."
        hint = "draw it lower" if highest.key == "height_m" else _GIVE_GROUND
        if highest.key != "height_m" and ground_given:
            hint = "draw it lower, or correct the altitude of the ground in --at"
        raise FileFormatError(f"{drawing.where(highest.drawn.label)}: {text}", hint=hint)
    lowest = min(points, key=lambda point: point.place_m[2] - point.ground_m)
    if (up_m := round(lowest.place_m[2] - lowest.ground_m, 3)) >= LOWEST_M:
        return
    what = "the ground" if lowest.ground_m or lowest.key == ABOVE_GROUND else "the origin"
    text = f"{lowest.drawn.label} is {up_m + 0.0:.1f} m above {what}; a vehicle flies at {LOWEST_M:g} m or more."
    hint = "give --height METRES for such points"
    if lowest.key == "alt_amsl_m":
        hint += ", or correct the altitude of the ground in --at" if ground_given else f", or {_GIVE_GROUND}"
    raise FileFormatError(f"{drawing.where(lowest.drawn.label)}: {text}", hint=hint)
