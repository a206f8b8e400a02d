"""The zones that vehicles avoid: no-fly zones, disks (Eq. 21) or polygons, and the outside of keep-in areas.

Inside or outside is exact. The distance of a place outside a polygon's piece is that to the line of an edge: beside a
corner it is less than the true distance, never more. `widened` and `narrowed` make the zones that a planner avoids to
keep a margin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
import shapely

from gcs.scenario.environment.convex_pieces import Disk, Piece, pieces_inside, pieces_outside
from gcs.scenario.schema.scenario import KeepIn, NoFlyZone, Scenario
from gcs.types import Array

_CORNERS = 256  # of a disk: less than a centimetre too large up to a radius of 100 m
_CORNER_REACH = 1.2  # of the margin: a widened polygon's corners are cut off there
_BEYOND_M = 1e6  # how far all that is outside a keep-in area reaches in an outline; scenarios end at 100 km

Zone = NoFlyZone | KeepIn  # a keep-in area stands for all that is outside it


class HasZones(Protocol):
    """A scenario, or the limits that follow from one."""

    @property
    def keep_in(self) -> tuple[KeepIn, ...]:
        """The areas that no vehicle leaves."""

    @property
    def no_fly(self) -> tuple[NoFlyZone, ...]:
        """The zones that no vehicle enters."""


@dataclass(frozen=True)
class ZoneName:
    """The name of a zone in messages: each kind counts from 1 in the order of the scenario."""

    number: int
    keep_in: bool = False

    def __str__(self) -> str:
        return f"{'keep-in area' if self.keep_in else 'no-fly zone'} {self.number}"

    @property
    def edge(self) -> str:
        """What a vehicle is near that passes it."""
        return f"the edge of {self}" if self.keep_in else str(self)


def zones(of: HasZones) -> tuple[Zone, ...]:
    """All that vehicles avoid: outside of keep-in areas, then no-fly zones (those that a re-plan adds are the last)."""
    return (*of.keep_in, *of.no_fly)


def zone_names(of: HasZones) -> tuple[ZoneName, ...]:
    """The names of `zones`, in their order."""
    areas = (ZoneName(number, keep_in=True) for number in range(1, len(of.keep_in) + 1))
    return (*areas, *map(ZoneName, range(1, len(of.no_fly) + 1)))


def in_words(of: HasZones) -> str:
    """The kinds of zones, as a table names them."""
    kinds = {"keep-in areas": of.keep_in, "no-fly zones": of.no_fly}
    return " and ".join(kind for kind, listed in kinds.items() if listed) or "no-fly zones"


def zone_sentences(scenario: Scenario) -> tuple[str, ...]:
    """How the zones of files were taken, and which zones a plan takes for larger than they are."""
    part = [str(n) for n, zone in enumerate(scenario.no_fly, 1) if zone.height_m is not None or zone.in_force_s]
    if not part:
        return scenario.geozones
    which = f"no-fly zone {part[0]} has" if len(part) == 1 else f"no-fly zones {', '.join(part)} have"
    how = "plan, returns and missions keep out at every height and at all times; proofs and the judge count them"
    return (*scenario.geozones, f"{which} heights or times: {how}")


@lru_cache(maxsize=256)
def pieces(zone: Zone) -> tuple[Piece, ...]:
    """The disk, or convex pieces that make up the zone, where it is when it has not moved."""
    if isinstance(zone, KeepIn):
        return pieces_outside(zone.area)
    if zone.radius_m is not None:
        assert zone.north_m is not None and zone.east_m is not None
        return (Disk((zone.north_m, zone.east_m), zone.radius_m),)
    return pieces_inside(outline(zone))


@lru_cache(maxsize=256)
def outline(zone: Zone) -> shapely.Polygon:
    """The zone (north, east) in the plane, where it is when it has not moved; a disk with many corners around it.

    All that is outside a keep-in area is a large square with the area as its hole.
    """
    if isinstance(zone, KeepIn):
        low_n, low_e, high_n, high_e = zone.area.bounds
        frame = shapely.box(low_n - _BEYOND_M, low_e - _BEYOND_M, high_n + _BEYOND_M, high_e + _BEYOND_M)
        return shapely.Polygon(frame.exterior, [zone.area.exterior])
    if zone.polygon_m is not None:
        return shapely.Polygon(zone.polygon_m)
    return shapely.Point(zone.north_m, zone.east_m).buffer(
        zone.radius_m / np.cos(np.pi / _CORNERS), quad_segs=_CORNERS // 4
    )


@lru_cache(maxsize=256)
def widened(zone: NoFlyZone, margin_m: float) -> NoFlyZone:
    """The zone, larger on all sides by `margin_m` or, at a polygon's corners, by up to a fifth more."""
    if margin_m <= 0.0:
        return zone
    if zone.radius_m is not None:
        return zone.model_copy(update={"radius_m": zone.radius_m + margin_m})
    grown = outline(zone).buffer(margin_m, join_style="mitre", mitre_limit=_CORNER_REACH)
    return zone.model_copy(update={"polygon_m": tuple(grown.exterior.coords)[:-1]})


@lru_cache(maxsize=256)
def narrowed(area: KeepIn, margin_m: float, place_m: tuple[float, float]) -> KeepIn:
    """The keep-in area, smaller on all sides by `margin_m` or, at its inner corners, by up to a fifth more.

    Where that leaves several parts, it is the one at a place (north, east) in it; where it leaves none, the whole area.
    """
    if margin_m <= 0.0:
        return area
    smaller = area.area.buffer(-margin_m, join_style="mitre", mitre_limit=_CORNER_REACH)
    parts = [part for part in shapely.get_parts(smaller) if not part.is_empty]
    if not parts:
        return area
    nearest = min(parts, key=lambda part: (float(part.distance(shapely.Point(place_m))), -part.area))
    return area.model_copy(update={"polygon_m": tuple(nearest.exterior.coords)[:-1]})


def displacement_m(zone: Zone, t_s: Array) -> Array:
    """How far (..., 2), north and east, the zone has moved at plan times (...)."""
    t_s = np.asarray(t_s, dtype=np.float64)
    if not zone.moves:
        return np.zeros((*t_s.shape, 2))
    times, north, east = np.array(zone.moves).T
    return np.stack([np.interp(t_s, times, north), np.interp(t_s, times, east)], axis=-1)


def zone_changes_s(of: Sequence[Zone]) -> Array:
    """The plan times at which a zone turns, begins or ends."""
    return np.array([t_s for zone in of for t_s in (*(move[0] for move in zone.moves), *(zone.in_force_s or ()))])


def outside_m(zone: Zone, t_s: Array, north_m: Array, east_m: Array) -> Array:
    """Distance (...) outside the zone of places (...) at plan times that broadcast with them; negative inside."""
    moved = displacement_m(zone, t_s)
    return np.asarray(
        np.min([piece.outside_m(north_m - moved[..., 0], east_m - moved[..., 1]) for piece in pieces(zone)], axis=0)
    )


def signed_distance_m(zone: Zone, north_m: Array, east_m: Array) -> Array:
    """Distance (...) of places (...) to the edge of the zone where it has not moved: negative inside, true everywhere.

    It changes by no more than a place moves.
    """
    if isinstance(zone, NoFlyZone) and zone.radius_m is not None:
        return pieces(zone)[0].outside_m(north_m, east_m)
    area = zone.area if isinstance(zone, KeepIn) else outline(zone)
    shapely.prepare(area)
    points = shapely.points(north_m, east_m)
    away_m = shapely.distance(area.exterior, points)
    is_outside = shapely.intersects(area, points) == isinstance(zone, KeepIn)
    return np.asarray(np.where(is_outside, away_m, -away_m))


def nearest_zone_m(
    beside: Sequence[Zone],
    t_s: Array,
    north_m: Array,
    east_m: Array,
    up_m: Array | None = None,
    since_s: Sequence[float] = (),
) -> Array:
    """True distance (...) of places (...) to the edge of the nearest zone at plan times that broadcast with them.

    Negative inside, infinite where no zone is in force. Without heights `up_m` (...) above height 0 zones have none.
    `since_s`: from when the first zones count; all others always do.
    """
    found = np.full(np.broadcast_shapes(np.shape(t_s), np.shape(north_m)), np.inf)
    for number, zone in enumerate(beside):
        moved = displacement_m(zone, t_s)
        away_m = signed_distance_m(zone, north_m - moved[..., 0], east_m - moved[..., 1])
        if zone.height_m is not None and up_m is not None:
            away_m = _beside_or_over_m(away_m, np.maximum(zone.height_m[0] - up_m, up_m - zone.height_m[1]))
        if zone.in_force_s is not None:
            away_m = np.where((t_s >= zone.in_force_s[0]) & (t_s <= zone.in_force_s[1]), away_m, np.inf)
        if number < len(since_s):
            away_m = np.where(t_s >= since_s[number], away_m, np.inf)
        found = np.minimum(found, away_m)
    return found


def _beside_or_over_m(beside_m: Array, over_m: Array) -> Array:
    """The distance to a prism, from that to its outline and that to its heights."""
    outside_m = np.hypot(np.maximum(beside_m, 0.0), np.maximum(over_m, 0.0))
    nearest_m = np.maximum(beside_m, over_m)
    return np.asarray(np.where(nearest_m > 0.0, outside_m, nearest_m))
