"""The area of the ground that a flight is seen over, its heights, the outlines of zones, names of route points."""

import re

import numpy as np

from gcs.scenario.environment.no_fly import Zone, displacement_m, outline, zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import KeepIn, Scenario
from gcs.types import Array

Area = tuple[Array, Array]  # the least and the greatest north and east (2,), m
_GRID = 141
_PASS = re.compile(r"^(before |after )?(pass \d+)")  # as `gcs new --survey` names points
_ROOM, _LEAST_ROOM_M = 0.12, 5.0  # around tracks: share of their extent, and metres
_OUTSIDE_M = 15.0  # of the box of Eq. 51, how far its ground is known
_THIN = 0.4  # shorter over longer side of an area, at least


def area_of(scenario: Scenario | None, places_ned_m: Array) -> Area:
    """Return the area around places (..., 3) and the zones beside them, with some room."""
    flat = places_ned_m[..., :2].reshape(-1, 2)
    low, high = np.nanmin(flat, axis=0), np.nanmax(flat, axis=0)
    room_m = max(_ROOM * float(np.max(high - low)), _LEAST_ROOM_M)
    if scenario is not None:
        near = low - 3.0 * room_m, high + 3.0 * room_m
        for zone in zones(scenario):
            for corners in outlines(zone, (0.0, scenario.time.flight_s)):
                low = np.minimum(low, np.maximum(corners.min(axis=0), near[0]))
                high = np.maximum(high, np.minimum(corners.max(axis=0), near[1]))
    low, high = low - room_m, high + room_m
    least_m = _THIN * float(np.max(high - low))
    short_m = np.maximum(least_m - (high - low), 0.0)
    low, high = low - 0.5 * short_m, high + 0.5 * short_m
    if scenario is not None and scenario.terrain.relief is not None:  # its ground is known so far and no further
        box = np.array([scenario.limits.north_m, scenario.limits.east_m])
        low = np.minimum(np.maximum(low, box[:, 0] - _OUTSIDE_M), np.nanmin(flat, axis=0))
        high = np.maximum(np.minimum(high, box[:, 1] + _OUTSIDE_M), np.nanmax(flat, axis=0))
    return low, high


def ground_grid(scenario: Scenario, area: Area, cells: int = _GRID) -> tuple[Array, Array, Array]:
    """North, east and height (G, G) of an area, without the ripple, which is finer than the grid."""
    low, high = area
    grids = np.meshgrid(np.linspace(low[0], high[0], cells), np.linspace(low[1], high[1], cells), indexing="ij")
    smooth = scenario.terrain.model_copy(update={"ripple": None})
    return grids[0], grids[1], ground_height_m(smooth, *grids)


def moving_s(zone: Zone, span_s: tuple[float, float]) -> Array:
    """Return the times (T,) in a span at which a zone begins and ends to move; one time if it stands still."""
    if not zone.moves:
        return np.array([span_s[0]])
    times = [t_s for t_s, *_ in zone.moves]
    return np.clip([times[0], times[-1]], *span_s)


def outlines(zone: Zone, span_s: tuple[float, float]) -> list[Array]:
    """Corners (C, 2), north and east, of a zone where it is first and last in a span; once if it does not move."""
    moved = displacement_m(zone, moving_s(zone, span_s))
    area = zone.area if isinstance(zone, KeepIn) else outline(zone)
    corners = np.array(area.exterior.coords)
    return [corners + one for one in moved[: 1 + bool(np.ptp(moved, axis=0).any())]]


def route_labels(scenario: Scenario) -> tuple[str, ...]:
    """Return what stands beside each route point: its number, and its name if it has one. Later rounds fly the same.

    Each pass of a survey is named once, at the first of its points.
    """
    labels, passes = [], set()
    for number, point in enumerate(scenario.route, start=1):
        name = point.name or ""
        if scenario.survey is not None and (of := _PASS.search(name)):
            name = "" if of[2] in passes or of[1] else of[2]
            passes.add(name)
        labels.append(f"{number} {name}".strip())
    return tuple(labels)
