"""The areas of a drawing as [[keep_in]] and [[no_fly]] of a scenario; none of them may make the route impossible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from gcs.errors import FileFormatError
from gcs.frames import Origin, ned_to_geodetic, place_up_m
from gcs.mission.drawings.drawing import Drawing, DrawnArea, LeftOut, Place
from gcs.mission.drawings.to_scenario.placed_route import PlacedRoute
from gcs.scenario.schema.places import CORNERS_MAX

KEEP_IN_MAX, NO_FLY_MAX = 16, 256
_CIRCLE_CORNERS = 64


_Area = tuple[DrawnArea, shapely.Polygon]  # as the scenario has it, and (north, east), m


@dataclass(frozen=True)
class AreaTables:
    """The areas to stay in, the no-fly zones, and the remarks on areas."""

    keep_in: tuple[DrawnArea, ...]
    no_fly: tuple[DrawnArea, ...]
    left_out: tuple[LeftOut, ...]


def area_tables(drawing: Drawing, route: PlacedRoute) -> AreaTables:
    """The areas of a drawing. One whose file does not say what it is holds the whole route, or is left out.

    Vehicles stay inside each [[keep_in]]. Fences that only together hold the route become one area, if they overlap.
    Raises `FileFormatError` for a route that leaves an area to stay in, or passes a point in a no-fly zone.
    """
    said: list[LeftOut] = []
    points = shapely.points(route.places_m[:, :2])
    keep_in: list[_Area] = []
    no_fly: list[_Area] = []
    holes: list[_Area] = []
    for drawn in drawing.areas:
        area = _area(drawing, drawn, route.origin)
        if drawn.inside is False:
            no_fly.append(area)
        elif drawn.inside or shapely.covers(area[1], points).all():
            keep_in.append(area)
            inner = (DrawnArea(hole, f"{drawn.label}, hole {n}") for n, hole in enumerate(drawn.holes, start=1))
            holes += [_area(drawing, hole, route.origin) for hole in inner]
        else:
            text = "not round the whole route, and not carried over; if it is a no-fly zone, write it as [[no_fly]]"
            said.append(LeftOut(drawn.label, text))
    no_fly += holes
    for zone, shape in no_fly:
        inside = shapely.contains_properly(shape, points)
        if inside.any():
            label = route.points[int(inside.argmax())].drawn.label
            message = f"{drawing.source}: {label} lies in {zone.label}, a no-fly zone."
            raise FileFormatError(message, hint="draw the route around it")
    keep_in = _together(drawing, keep_in, route, points, said)
    for areas, most, what in ((keep_in, KEEP_IN_MAX, "areas to stay in"), (no_fly, NO_FLY_MAX, "no-fly zones")):
        if len(areas) > most:
            raise FileFormatError(f"{drawing.source}: has {len(areas)} {what}; a scenario has at most {most}.")
    for one, _ in (*keep_in, *no_fly):
        if len(one.corners) > CORNERS_MAX:
            text = f"{one.label} has {len(one.corners)} corners; an area has at most {CORNERS_MAX}"
            raise FileFormatError(f"{drawing.source}: {text}.", hint="draw it with fewer corners")
    return AreaTables(tuple(one for one, _ in keep_in), tuple(one for one, _ in no_fly), tuple(said))


def _area(drawing: Drawing, area: DrawnArea, origin: Origin) -> _Area:
    """An area in metres. Raises `FileFormatError` for one that crosses itself."""
    if area.radius_m is None:
        lat, lon = np.array(area.corners).T
        shape = shapely.Polygon(place_up_m(lat, lon, 0.0, origin)[:, :2])
        if not shape.is_valid or shape.area <= 0.0:
            text = f"{drawing.source}: {area.label} crosses itself."
            raise FileFormatError(text, hint="draw its corners in order")
        return area, shape
    angle = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_CORNERS, endpoint=False)
    edge_m = area.radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    edge_m += place_up_m(*area.corners[0], 0.0, origin)[:2]
    if area.inside:  # [[keep_in]] has polygons only; this one lies in the circle
        area = DrawnArea(_degrees(edge_m, origin), f"{area.label}, radius {area.radius_m:g} m")
    return area, shapely.Polygon(edge_m)


def _together(
    drawing: Drawing, areas: Sequence[_Area], route: PlacedRoute, points: np.ndarray, said: list[LeftOut]
) -> list[_Area]:
    """The areas to stay in, each of which holds the route: as they are, or joined to one."""
    if all(shapely.covers(shape, points).all() for _, shape in areas):
        return list(areas)
    joined = shapely.union_all([shape for _, shape in areas])
    outside = ~shapely.covers(joined, points)
    if outside.any():
        row = int(outside.argmax())
        away_m = float(shapely.distance(joined, points[row]))
        raise FileFormatError(
            f"{drawing.source}: {route.points[row].drawn.label} is {away_m:.1f} m outside {areas[0][0].label}"
            + (" and the other areas to stay in." if len(areas) > 1 else "."),
            hint="draw the route inside, or the area larger",
        )
    labels = " and ".join(area.label for area, _ in areas)
    if joined.geom_type != "Polygon" or joined.interiors:
        text = f"{drawing.source}: the route leads through {labels}, which are apart."
        raise FileFormatError(text, hint="join them to one area")
    said.append(LeftOut(labels, "the route is only in both together; one area to stay in"))
    corners = _degrees(np.array(joined.exterior.coords)[:-1], route.origin)
    return [(DrawnArea(corners, labels), joined)]


def _degrees(corners_m: np.ndarray, origin: Origin) -> tuple[Place, ...]:
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners_m, np.zeros(len(corners_m))]), origin)
    return tuple((float(a), float(b)) for a, b in zip(lat, lon, strict=True))
