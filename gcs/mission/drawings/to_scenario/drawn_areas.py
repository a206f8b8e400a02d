"""The areas of a drawing as [[keep_in]] and [[no_fly]] of a scenario; none of them may make the route impossible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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


@dataclass(frozen=True)
class AreaTable:
    """An area of the scenario: its corners, or its centre with a radius; what the drawing calls it."""

    label: str
    corners: tuple[Place, ...]
    radius_m: float | None = None


@dataclass(frozen=True)
class AreaTables:
    """The areas to stay in, the no-fly zones, and the remarks on areas."""

    keep_in: tuple[AreaTable, ...]
    no_fly: tuple[AreaTable, ...]
    left_out: tuple[LeftOut, ...]


@dataclass(frozen=True)
class _Area:
    table: AreaTable
    shape: shapely.Polygon  # north, east, m
    inside: bool | None
    holes: tuple[_Area, ...] = ()  # no-fly zones, unless it is left out


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
    for area in _areas(drawing, route.origin):
        if area.inside is not None:
            (keep_in if area.inside else no_fly).append(area)
        elif shapely.covers(area.shape, points).all():
            keep_in.append(area)
        else:
            text = "not round the whole route, and not carried over; if it is a no-fly zone, write it as [[no_fly]]"
            said.append(LeftOut(area.table.label, text))
            continue
        holes += area.holes
    no_fly += holes
    for zone in no_fly:
        inside = shapely.contains_properly(zone.shape, points)
        if inside.any():
            label = route.points[int(inside.argmax())].drawn.label
            raise FileFormatError(
                f"{drawing.source}: {label} lies in {zone.table.label}, a no-fly zone.", hint="draw the route around it"
            )
    keep_in = _together(drawing, keep_in, route, points, said)
    for areas, most, what in ((keep_in, KEEP_IN_MAX, "areas to stay in"), (no_fly, NO_FLY_MAX, "no-fly zones")):
        if len(areas) > most:
            raise FileFormatError(f"{drawing.source}: has {len(areas)} {what}; a scenario has at most {most}.")
    for area in (*keep_in, *no_fly):
        if len(area.table.corners) > CORNERS_MAX:
            text = f"{area.table.label} has {len(area.table.corners)} corners; an area has at most {CORNERS_MAX}"
            raise FileFormatError(f"{drawing.source}: {text}.", hint="draw it with fewer corners")
    return AreaTables(tuple(area.table for area in keep_in), tuple(area.table for area in no_fly), tuple(said))


def _areas(drawing: Drawing, origin: Origin) -> Iterator[_Area]:
    for area in drawing.areas:
        shape = _shape(drawing, area.label, area.corners, origin)
        holes = () if area.inside is False else tuple(_holes(drawing, area, origin))
        yield _Area(AreaTable(area.label, area.corners), shape, area.inside, holes)
    for disk in drawing.disks:
        north_m, east_m = place_up_m(*disk.centre, 0.0, origin)[:2]
        angle = np.linspace(0.0, 2.0 * np.pi, _CIRCLE_CORNERS, endpoint=False)
        edge_m = np.column_stack([north_m + disk.radius_m * np.cos(angle), east_m + disk.radius_m * np.sin(angle)])
        table = AreaTable(disk.label, (disk.centre,), disk.radius_m)
        if disk.inside:  # [[keep_in]] has polygons only; this one lies in the circle
            table = AreaTable(f"{disk.label}, radius {disk.radius_m:g} m", _degrees(edge_m, origin))
        yield _Area(table, shapely.Polygon(edge_m), disk.inside)


def _holes(drawing: Drawing, area: DrawnArea, origin: Origin) -> Iterator[_Area]:
    for number, hole in enumerate(area.holes, start=1):
        label = f"{area.label}, hole {number}"
        yield _Area(AreaTable(label, hole), _shape(drawing, label, hole, origin), False)


def _together(
    drawing: Drawing, areas: Sequence[_Area], route: PlacedRoute, points: np.ndarray, said: list[LeftOut]
) -> list[_Area]:
    """The areas to stay in, each of which holds the route: as they are, or joined to one."""
    if all(shapely.covers(area.shape, points).all() for area in areas):
        return list(areas)
    joined = shapely.union_all([area.shape for area in areas])
    outside = ~shapely.covers(joined, points)
    if outside.any():
        row = int(outside.argmax())
        away_m = float(shapely.distance(joined, points[row]))
        raise FileFormatError(
            f"{drawing.source}: {route.points[row].drawn.label} is {away_m:.1f} m outside {areas[0].table.label}"
            + (" and the other areas to stay in." if len(areas) > 1 else "."),
            hint="draw the route inside, or the area larger",
        )
    labels = " and ".join(area.table.label for area in areas)
    if joined.geom_type != "Polygon" or joined.interiors:
        raise FileFormatError(
            f"{drawing.source}: the route leads through {labels}, which are apart.", hint="join them to one area"
        )
    said.append(LeftOut(labels, "the route is only in both together; one area to stay in"))
    corners = _degrees(np.array(joined.exterior.coords)[:-1], route.origin)
    return [_Area(AreaTable(labels, corners), joined, True)]


def _shape(drawing: Drawing, label: str, corners: Sequence[Place], origin: Origin) -> shapely.Polygon:
    """An area in metres, north and east. Raises `FileFormatError` for one that crosses itself."""
    lat, lon = np.array(corners).T
    shape = shapely.Polygon(place_up_m(lat, lon, 0.0, origin)[:, :2])
    if not shape.is_valid or shape.area <= 0.0:
        raise FileFormatError(f"{drawing.source}: {label} crosses itself.", hint="draw its corners in order")
    return shape


def _degrees(corners_m: np.ndarray, origin: Origin) -> tuple[Place, ...]:
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners_m, np.zeros(len(corners_m))]), origin)
    return tuple((float(a), float(b)) for a, b in zip(lat, lon, strict=True))
