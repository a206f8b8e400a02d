"""Drawn points in metres from the origin, with the key that a scenario has for their heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import counted
from gcs.frames import Origin, geodetic_to_ned, place_up_m
from gcs.mission.drawings.drawing import Datum, Drawing, DrawnPoint, LeftOut

HEIGHT_M = 15.0  # of points without one, above the origin
LOWEST_M = 1.0  # lower points are on the ground


@dataclass(frozen=True)
class PlacedPoint:
    """A point, its place north, east and up from the origin, and its height by the key that the scenario has for it."""

    drawn: DrawnPoint
    place_m: tuple[float, float, float]
    key: str
    height_m: float


def placed_point(
    point: DrawnPoint, origin: Origin, drawing: Drawing, height_m: float | None, said: list[LeftOut]
) -> PlacedPoint:
    """A point in metres; one without a height, or on the ground, gets `height_m`. What changes is `said`."""
    key, value = "height_m", point.height_m
    if point.datum is Datum.NONE:
        value = HEIGHT_M if height_m is None else height_m
    elif point.datum is Datum.SEA:
        key = "alt_amsl_m"
    elif height_m is not None and value < LOWEST_M:
        said.append(LeftOut(point.label, f"a height of {value:g} m is on the ground; flown at {height_m:g} m"))
        value = height_m
    elif point.datum is Datum.GROUND:
        text = "the height above the ground counts from the origin, because the file has no terrain"
        said.append(LeftOut(point.label, text))
    elif drawing.home is not None and drawing.home.alt_amsl_m != origin.alt_amsl_m:
        key, value = "alt_amsl_m", drawing.home.alt_amsl_m + value
    if key == "height_m":
        place_m = place_up_m(*point.place, value, origin)
    else:
        place_m = geodetic_to_ned(*point.place, value, origin) * [1.0, 1.0, -1.0]
    north_m, east_m, up_m = map(float, place_m)
    return PlacedPoint(point, (north_m, east_m, up_m), key, round(value, 3))


def say_heights(points: Sequence[DrawnPoint], height_m: float, said: list[LeftOut]) -> None:
    """Say how many points have no height, and at which they are flown."""
    bare = sum(point.datum is Datum.NONE for point in points)
    if bare:
        every = "no point has a height" if bare == len(points) else f"{counted(bare, 'point')} without a height"
        said.append(LeftOut("heights", f"{every}; flown {height_m:g} m above the origin (--height)"))
