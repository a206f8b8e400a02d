"""The route among the lines and single points of a map: one line is flown, else the points in their order."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gcs.frames import Origin, geodetic_to_ned
from gcs.mission.drawings.drawing import Drawing, DrawnPoint, Sketch

_SAME_M = 5.0  # a named point so near to a corner of the line names it


@dataclass(frozen=True)
class DrawnLine:
    """A line of a map. `recorded`: a receiver wrote it on its way."""

    label: str
    points: tuple[DrawnPoint, ...]
    recorded: bool = False


@dataclass
class MapSketch(Sketch):
    """A map while it is read: lines, and points beside them."""

    lines: list[DrawnLine] = field(default_factory=list)
    spots: list[DrawnPoint] = field(default_factory=list)


def drawing_of(sketch: MapSketch) -> Drawing:
    """The drawing whose route is the first drawn line, else the first recorded one, else the `spots`.

    What is not flown is left out with a sentence.
    """
    lines = sketch.lines
    if not lines:
        return sketch.drawing(points=tuple(sketch.spots))
    flown = next((line for line in lines if not line.recorded), lines[0])
    for line in lines:
        if line is not flown:
            sketch.leave_out(line.label, f"not flown: the route is {flown.label}; a file per route carries it over")
    points = tuple(_named(sketch, flown))
    return sketch.drawing(points=points, recorded=flown.recorded)


def _named(sketch: MapSketch, line: DrawnLine) -> list[DrawnPoint]:
    """The points of a line, with the names of the spots on them."""
    points, spots = list(line.points), sketch.spots
    if not spots or not points:
        return points
    origin = Origin(*points[0].place, 0.0)
    lat, lon = np.array([point.place for point in points]).T
    places_m = geodetic_to_ned(lat, lon, 0.0, origin)
    for spot in spots:
        away_m = np.linalg.norm(places_m - geodetic_to_ned(*spot.place, 0.0, origin), axis=1)
        row = int(away_m.argmin())
        if away_m[row] <= _SAME_M and spot.name and not points[row].name:
            points[row] = replace(points[row], name=spot.name)
        elif away_m[row] > _SAME_M:
            sketch.leave_out(spot.label, f"not on the route, {line.label}; not carried over")
    return points
