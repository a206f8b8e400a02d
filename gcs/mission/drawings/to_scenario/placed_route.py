"""The points of a drawing as the leader flies them: in metres from the origin, at heights that can be flown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import FileFormatError
from gcs.frames import Origin, geodetic_to_ned, place_up_m
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnPoint, LeftOut
from gcs.mission.drawings.to_scenario.fewer_points import airborne, fewer, merged_points
from gcs.mission.drawings.to_scenario.placed_point import HEIGHT_M, LOWEST_M, PlacedPoint, placed_point, say_heights
from gcs.physics.quadrotor import Array
from gcs.scenario.schema.fields import FARTHEST_M

_BEYOND_M = 20_000.0  # such heights are no numbers of metres
_HIGHEST_M = 1500.0  # a formation climbs half an hour to it
_HOME_NEAR_M = 20_000.0
_BACK_M = 2.0  # a route that ends so near to its start comes back


@dataclass(frozen=True)
class PlacedRoute:
    """The points in order, whether the route ends at its start, the origin, and what is said about the drawing."""

    points: tuple[PlacedPoint, ...]
    returns: bool
    origin: Origin
    origin_is: str
    left_out: tuple[LeftOut, ...]

    @property
    def places_m(self) -> Array:
        """The places of the points (N, 3), north, east, up, m."""
        return np.array([point.place_m for point in self.points])


def placed_route(drawing: Drawing, at: tuple[float, float, float | None] | None, height_m: float | None) -> PlacedRoute:
    """The route of a drawing, with the origin `at`, else at its planned home, else at its first point.

    `height_m` is the height of points without one, or on the ground. Raises `FileFormatError` for a drawing that makes
    no route.
    """
    said = [*drawing.left_out]
    drawing = _from_home(_by_home(drawing, said), said)
    _refuse_few(drawing, len(drawing.points))
    ground_m = None
    points = list(drawing.points)
    for point in points:
        if abs(point.height_m) > _BEYOND_M:
            raise FileFormatError(f"{drawing.source}: {point.label} is at {point.height_m:g} m, beyond any flight.")
    if drawing.recorded:
        points, ground_m = _in_the_air(points, said)
    origin, origin_is = _origin(drawing, points, at, ground_m, height_m or HEIGHT_M, said)
    placed = [placed_point(point, origin, drawing, height_m, said) for point in points]
    say_heights(points, height_m or HEIGHT_M, said)
    placed = merged_points(fewer(drawing, placed, said), said)
    places_m = np.array([point.place_m for point in placed])
    far_m = float(np.abs(places_m).max())
    if far_m > FARTHEST_M:
        raise FileFormatError(
            f"{drawing.source}: its points are up to {far_m / 1000.0:,.0f} km from the origin; the limit is "
            f"{FARTHEST_M / 1000.0:,.0f} km.",
            hint="give --at near its first point",
        )
    comes_back = len(placed) > 2 and float(np.linalg.norm(places_m[-1] - places_m[0])) <= _BACK_M
    if comes_back:
        placed = placed[:-1]
    returns = comes_back or drawing.returns
    _refuse_few(drawing, len(placed))
    _refuse_heights(drawing, placed)
    ends = placed[:1] if returns else [placed[0], placed[-1]]
    said += [
        LeftOut(
            point.drawn.label, "the hold is not carried over; the formation hovers there before or after the flight"
        )
        for point in ends
        if point.drawn.hold_s
    ]
    return PlacedRoute(tuple(placed), returns, origin, origin_is, tuple(said))


def _refuse_few(drawing: Drawing, count: int) -> None:
    if count >= 2:
        return
    step = "draw a line through the area" if drawing.areas and not drawing.points else "draw at least two points"
    has = "no point" if not drawing.points else "only one place"
    raise FileFormatError(f"{drawing.source}: is no route: it has {has} to fly to.", hint=step)


def _from_home(drawing: Drawing, said: list[LeftOut]) -> Drawing:
    """The drawing with a second point above home, where it has only one."""
    home = drawing.home
    if home is None or len(drawing.points) != 1:
        return drawing
    only = drawing.points[0]
    above = replace(only, place=(home.lat_deg, home.lon_deg), label="the planned home", name="", hold_s=0.0)
    said.append(LeftOut(only.label, "the file has no other point; the route begins at its height above home"))
    return replace(drawing, points=(above, only))


def _by_home(drawing: Drawing, said: list[LeftOut]) -> Drawing:
    """The drawing without a home that is far from its route."""
    home = drawing.home
    if home is None or not drawing.points:
        return drawing
    first = Origin(*drawing.points[0].place, home.alt_amsl_m)
    away_m = float(np.linalg.norm(geodetic_to_ned(home.lat_deg, home.lon_deg, home.alt_amsl_m, first)))
    if away_m <= _HOME_NEAR_M:
        return drawing
    said.append(LeftOut("the planned home", f"it is {away_m / 1000.0:,.0f} km away; the origin is the first point"))
    return replace(drawing, home=None)


def _in_the_air(points: list[DrawnPoint], said: list[LeftOut]) -> tuple[list[DrawnPoint], float | None]:
    """A track without its take-off and landing, and the height of the ground where it takes off."""
    if any(point.datum is Datum.NONE for point in points):
        return points, None
    places_m = _local_m(points)
    first, last = airborne(places_m)
    if last <= first:
        return points, None
    for row, end in ((first, 0), (last, len(points) - 1)):
        if row != end:
            said.append(LeftOut(points[end].label, f"the route {'ends' if end else 'begins'} above it, in the air"))
    is_ground = first > 0 and points[0].datum is Datum.SEA
    return points[first : last + 1], points[0].height_m if is_ground else None


def _origin(
    drawing: Drawing,
    points: Sequence[DrawnPoint],
    at: tuple[float, float, float | None] | None,
    ground_m: float | None,
    below_m: float,
    said: list[LeftOut],
) -> tuple[Origin, str]:
    """The origin, and in words what it is."""
    home = drawing.home
    place, what = (
        (points[0].place, "the first point") if home is None else ((home.lat_deg, home.lon_deg), "planned home")
    )
    alt_m = ground_m if home is None else home.alt_amsl_m
    if at is not None:
        place, what, alt_m = at[:2], "as given", alt_m if at[2] is None else at[2]
    if alt_m is None:
        above_sea_m = [point.height_m for point in points if point.datum is Datum.SEA]
        alt_m = float(np.floor(min(above_sea_m) - below_m)) if above_sea_m else 0.0
        if above_sea_m:
            text = f"the ground is taken to be {below_m:g} m below the lowest point, {alt_m:g} m above the sea"
        else:
            text = "its altitude is not in the file: 0 m above the sea"
        said.append(LeftOut("the origin", f"{text}; for the true one give --at LAT,LON,ALT"))
    if not (abs(place[0]) <= 85.0 and -500.0 <= alt_m <= 9000.0):
        where = f"latitude {place[0]:g}, {alt_m:g} m above the sea"
        raise FileFormatError(f"{drawing.source}: its origin is at {where}, where no scenario is.", hint="give --at")
    return Origin(*place, alt_m), what


def _refuse_heights(drawing: Drawing, points: Sequence[PlacedPoint]) -> None:
    highest = max(points, key=lambda point: point.place_m[2])
    if (up_m := highest.place_m[2]) > _HIGHEST_M:
        raise FileFormatError(
            f"{drawing.source}: {highest.drawn.label} is {up_m:,.0f} m above the origin; "
            f"the limit is {_HIGHEST_M:,.0f} m.",
            hint="draw it lower" if highest.key == "height_m" else "give the altitude of the ground: --at LAT,LON,ALT",
        )
    lowest = min(points, key=lambda point: point.place_m[2])
    if (up_m := round(lowest.place_m[2], 3)) >= LOWEST_M:
        return
    if lowest.key == "height_m":
        hint = "give --height METRES for such points"
    else:
        hint = "give the altitude of the ground: --at LAT,LON,ALT"
    raise FileFormatError(
        f"{drawing.source}: {lowest.drawn.label} is {up_m + 0.0:.1f} m above the origin; "
        f"a vehicle flies at {LOWEST_M:g} m or more.",
        hint=hint,
    )


def _local_m(points: Sequence[DrawnPoint]) -> Array:
    """The places of points of one datum (N, 3), north, east and up from the first, m."""
    lat, lon = np.array([point.place for point in points]).T
    return place_up_m(lat, lon, np.array([point.height_m for point in points]), Origin(*points[0].place, 0.0))
