"""Fences: polygons and circles from mission items, their validity, and whether a position violates them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.frames import Origin, geodetic_to_ned
from gcs.mavlink import FenceCommand, Severity
from gcs.mission.model import MissionItem
from gcs.types import Array

POLYGONS = frozenset({FenceCommand.POLYGON_INCLUSION, FenceCommand.POLYGON_EXCLUSION})
CIRCLES = frozenset({FenceCommand.CIRCLE_INCLUSION, FenceCommand.CIRCLE_EXCLUSION})
_OUTSIDE = frozenset({FenceCommand.POLYGON_EXCLUSION, FenceCommand.CIRCLE_EXCLUSION})
LEAST_VERTICES = 3


@dataclass(frozen=True)
class FenceShape:
    """A polygon (its corners (N, 2)) or a circle (its centre (1, 2) and radius), north and east in metres."""

    corners_ned_m: Array
    radius_m: float  # 0 for a polygon
    stay_outside: bool

    def violated(self, north_m: float, east_m: float) -> bool:
        """Whether a vehicle at this position is on the wrong side; on the line it is not."""
        return self._contains(north_m, east_m) == self.stay_outside

    def _contains(self, north_m: float, east_m: float) -> bool:
        if self.radius_m > 0.0:
            centre = self.corners_ned_m[0]
            return math.hypot(north_m - centre[0], east_m - centre[1]) <= self.radius_m
        north, east = self.corners_ned_m[:, 0], self.corners_ned_m[:, 1]
        next_north, next_east = np.roll(north, -1), np.roll(east, -1)
        crosses = (east > east_m) != (next_east > east_m)
        run = np.where(crosses, next_east - east, 1.0)
        at_north = north + (east_m - east) / run * (next_north - north)
        return bool(np.count_nonzero(crosses & (north_m < at_north)) % 2)


def shapes(items: Sequence[MissionItem], origin: Origin) -> tuple[FenceShape, ...]:
    """Return the polygons and circles that the fence items form; incomplete ones are left out."""
    found: list[FenceShape] = []
    at = 0
    while at < len(items):
        first = items[at]
        size = 1
        if first.command in CIRCLES and first.params[0] > 0.0:
            found.append(FenceShape(places(items[at : at + 1], origin), first.params[0], first.command in _OUTSIDE))
        elif first.command in POLYGONS:
            size = max(_whole(first.params[0]), 1)
            vertices = items[at : at + size]
            if LEAST_VERTICES <= size == len(vertices) and {v.command for v in vertices} == {first.command}:
                found.append(FenceShape(places(vertices, origin), 0.0, first.command in _OUTSIDE))
        at += size
    return tuple(found)


def what_is_wrong(items: Sequence[MissionItem]) -> tuple[Severity, str] | None:
    """Return why these items are not a valid fence, in ArduPilot's words; None if they are."""
    missing, first = 0, None
    for item in items:
        if item.command in POLYGONS:
            count = _whole(item.params[0])
            if count < LEAST_VERTICES:
                return Severity.WARNING, f"Invalid vertex count ({count})"
            if first is None or not missing:
                first, missing = item, count
            elif item.command != first.command or item.params[0] != first.params[0]:
                return Severity.WARNING, f"Vertex of another polygon ({count})"
            missing -= 1
        elif missing:
            return Severity.WARNING, f"Vertex expected, not {item.command}"
        elif item.command in CIRCLES and not item.params[0] > 0.0:
            return Severity.WARNING, "Non-positive circle radius"
    return (Severity.INFO, "Incorrect item count") if missing else None


def encloses(items: Sequence[MissionItem], place: Origin) -> bool:
    """Whether a fence is valid and not violated at `place`; an empty fence is."""
    return not _unfinished(items) and not any(shape.violated(0.0, 0.0) for shape in shapes(items, place))


def count_shapes(items: Sequence[MissionItem]) -> int:
    """Return how many polygons and circles the items of a fence begin."""
    number, missing = 0, 0
    for item in items:
        if item.command in POLYGONS and missing:
            missing -= 1
        else:
            number += 1
            missing = max(_whole(item.params[0]) - 1, 0) if item.command in POLYGONS else 0
    return number


def _unfinished(items: Sequence[MissionItem]) -> bool:
    """Whether a vertex belongs to no complete polygon."""
    whole = sum(len(shape.corners_ned_m) for shape in shapes(items, Origin(0.0, 0.0, 0.0)) if not shape.radius_m)
    return whole != sum(item.command in POLYGONS for item in items)


def places(items: Sequence[MissionItem], origin: Origin) -> Array:
    """Return the positions of the items, north and east in metres (N, 2)."""
    lat_deg, lon_deg = np.array([item.place_deg for item in items]).reshape(-1, 2).T
    ned_m = geodetic_to_ned(lat_deg, lon_deg, np.full(len(items), origin.alt_amsl_m), origin)
    return np.asarray(ned_m)[:, :2]


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) else 0
