"""Fences and rally points as plain values, and as the mission items that carry them (commands 5000 to 5004, 5100).

`gcs.mission.check.fence_and_rally` checks whether a fence makes sense.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gcs.frames import from_degE7, to_degE7
from gcs.mavlink import FenceCommand
from gcs.mission.model import Frame, MissionItem

LEAST_VERTICES = 3


class BadItem(ValueError):
    """An item that is wrong at its position in the list; `index` counts from 0."""

    def __init__(self, index: int, reason: str) -> None:
        super().__init__(f"item {index} {reason}")
        self.index = index


@dataclass(frozen=True)
class GeoPoint:
    """A point on the map, as the wire has it."""

    lat_degE7: int
    lon_degE7: int

    @classmethod
    def at(cls, lat_deg: float, lon_deg: float) -> GeoPoint:
        """The nearest point that the wire has."""
        return cls(to_degE7(lat_deg), to_degE7(lon_deg))

    @property
    def place_deg(self) -> tuple[float, float]:
        """Its latitude and longitude, degrees."""
        return from_degE7(self.lat_degE7), from_degE7(self.lon_degE7)


@dataclass(frozen=True)
class FencePolygon:
    """A polygon of a fence: vertices in order, the last joined to the first.

    `inclusion`: vehicles stay inside it, else outside.
    """

    points: tuple[GeoPoint, ...]
    inclusion: bool


@dataclass(frozen=True)
class FenceCircle:
    """All points within a radius."""

    center: GeoPoint
    radius_m: float
    inclusion: bool


@dataclass(frozen=True)
class RallyPoint:
    """A position to return to, and the altitude above home on arrival."""

    place: GeoPoint
    alt_m: float


@dataclass(frozen=True)
class Geofence:
    """The area in which a vehicle may fly: inside the inclusions, outside the exclusions."""

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()
    return_point: RallyPoint | None = None

    @property
    def vertices(self) -> int:
        """The number of items that an autopilot stores for it."""
        return sum(len(p.points) for p in self.polygons) + len(self.circles) + (self.return_point is not None)


NO_FENCE = Geofence()


def fence_items(fence: Geofence) -> tuple[MissionItem, ...]:
    """The items sent to an autopilot: return point, polygons vertex by vertex, circles."""
    items = []
    if fence.return_point is not None:
        point = fence.return_point
        items.append(_item(FenceCommand.RETURN_POINT, Frame.GLOBAL_RELATIVE_ALT, 0.0, point.place, point.alt_m))
    for polygon in fence.polygons:
        command = FenceCommand.POLYGON_INCLUSION if polygon.inclusion else FenceCommand.POLYGON_EXCLUSION
        items += [_item(command, Frame.GLOBAL, float(len(polygon.points)), place) for place in polygon.points]
    for circle in fence.circles:
        command = FenceCommand.CIRCLE_INCLUSION if circle.inclusion else FenceCommand.CIRCLE_EXCLUSION
        items.append(_item(command, Frame.GLOBAL, circle.radius_m, circle.center))
    return tuple(items)


def fence_from_items(items: Sequence[MissionItem]) -> Geofence:
    """The fence that items describe. Raises BadItem for other commands and for polygons cut short."""
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    return_point: RallyPoint | None = None
    index = 0
    while index < len(items):
        item = items[index]
        step = 1
        if item.command in (FenceCommand.POLYGON_INCLUSION, FenceCommand.POLYGON_EXCLUSION):
            count = item.params[0]
            if not (LEAST_VERTICES <= count <= 0xFFFF and count == round(count)):
                raise BadItem(index, f"begins a polygon of {count:g} vertices; {LEAST_VERTICES} or more required")
            step = round(count)
            run = items[index : index + step]
            if len(run) < step or any((i.command, i.params[0]) != (item.command, item.params[0]) for i in run):
                raise BadItem(index, f"begins a polygon of {step} vertices, and fewer follow")
            inclusion = item.command == FenceCommand.POLYGON_INCLUSION
            polygons.append(FencePolygon(tuple(map(_place, run)), inclusion))
        elif item.command in (FenceCommand.CIRCLE_INCLUSION, FenceCommand.CIRCLE_EXCLUSION):
            if not (math.isfinite(item.params[0]) and item.params[0] > 0):
                raise BadItem(index, f"is a circle with radius {item.params[0]:g} m")
            circles.append(FenceCircle(_place(item), item.params[0], item.command == FenceCommand.CIRCLE_INCLUSION))
        elif item.command == FenceCommand.RETURN_POINT and return_point is None:
            return_point = _point_with_altitude(item, index)
        else:
            raise BadItem(index, f"with command {item.command} is no part of a fence")
        index += step
    return Geofence(tuple(polygons), tuple(circles), return_point)


def rally_items(points: Iterable[RallyPoint]) -> tuple[MissionItem, ...]:
    """The items sent to an autopilot, with altitudes above home."""
    return tuple(_item(FenceCommand.RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, 0.0, p.place, p.alt_m) for p in points)


def rally_from_items(items: Sequence[MissionItem]) -> tuple[RallyPoint, ...]:
    """The rally points that items describe. Raises BadItem for other commands and altitude frames."""
    for index, item in enumerate(items):
        if item.command != FenceCommand.RALLY_POINT:
            raise BadItem(index, f"with command {item.command} is no rally point")
        if item.frame != Frame.GLOBAL_RELATIVE_ALT:
            raise BadItem(index, f"has altitude frame {item.frame}; rally points require 3, above home")
    return tuple(_point_with_altitude(item, index) for index, item in enumerate(items))


def _item(command: FenceCommand, frame: Frame, p1: float, place: GeoPoint, alt_m: float = 0.0) -> MissionItem:
    return MissionItem(command, frame, (p1, 0.0, 0.0, 0.0), place.lat_degE7, place.lon_degE7, alt_m)


def _point_with_altitude(item: MissionItem, index: int) -> RallyPoint:
    if not math.isfinite(item.alt_m):
        raise BadItem(index, "has no altitude")
    return RallyPoint(_place(item), item.alt_m)


def _place(item: MissionItem) -> GeoPoint:
    return GeoPoint(item.lat_degE7, item.lon_degE7)
