"""No-fly zones: the distance of a place outside a disk (Eq. 21) or polygon at a time, and a polygon's convex pieces.

Inside or outside is exact. The distance of a place outside a polygon's piece is that to the line of an edge: beside a
corner it is less than the true distance, never more. `widened` makes the zone that a planner avoids to keep a margin.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from gcs.physics.quadrotor import Array
from gcs.scenario.schema.scenario import NoFlyZone

_CORNERS = 256  # of a disk: less than a centimetre too large up to a radius of 100 m
_CONVEX = 1.0 - 1e-9  # share of its hull's area that a convex polygon fills
_CORNER_REACH = 1.2  # of the margin: a widened polygon's corners are cut off there


@dataclass(frozen=True)
class Disk:
    """All places within a radius."""

    centre_m: tuple[float, float]
    radius_m: float

    def outside_m(self, north_m: Array, east_m: Array) -> Array:
        """Distance (...) of places (...) from the edge; negative inside."""
        return np.asarray(np.hypot(north_m - self.centre_m[0], east_m - self.centre_m[1]) - self.radius_m)


@dataclass(frozen=True)
class Convex:
    """All places on the inner side of every edge."""

    normals: tuple[tuple[float, float], ...]  # outward, of length one
    offsets_m: tuple[float, ...]  # a place is inside of an edge where normal . place < offset
    corners_m: tuple[tuple[float, float], ...]  # the edge of a normal begins at the corner of its number

    def outside_m(self, north_m: Array, east_m: Array) -> Array:
        """Distance (...) of places (...) from the farthest edge's line; negative inside."""
        edges = zip(self.normals, self.offsets_m, strict=True)
        return np.asarray(np.max([n * north_m + e * east_m - off for (n, e), off in edges], axis=0))

    def facing(self, north_m: Array, east_m: Array) -> tuple[Array, Array, Array]:
        """Direction north, east (N,) from the nearest place of the piece to places (N,), and its support (N,).

        No place of the piece lies farther that way than the support; so direction . place - support is no more than
        the true distance anywhere. Places inside have the direction 0, which says nothing.
        """
        corners = np.array(self.corners_m)
        along = np.roll(corners, -1, axis=0) - corners
        place = np.stack([north_m, east_m], axis=-1)[:, None]
        share = np.clip(np.sum((place - corners) * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0)
        away = place - (corners + share[..., None] * along)  # (N, E, 2)
        nearest = np.argmin(np.sum(away**2, axis=-1), axis=1)
        away = away[np.arange(len(away)), nearest]
        length = np.linalg.norm(away, axis=1)
        outside = (self.outside_m(north_m, east_m) > 0.0) & (length > 0.0)
        unit = np.where(outside[:, None], away / np.maximum(length, 1e-12)[:, None], 0.0)
        return unit[:, 0], unit[:, 1], np.max(unit @ corners.T, axis=1)


Piece = Disk | Convex
Edge = frozenset[tuple[float, ...]]  # two corners


@dataclass(frozen=True, eq=False)
class _Part:
    """A convex part of a polygon; it is itself, not its equal."""

    polygon: shapely.Polygon
    edges: tuple[Edge, ...]

    @classmethod
    def of(cls, polygon: shapely.Polygon) -> _Part:
        return cls(polygon, tuple(map(frozenset, itertools.pairwise(polygon.exterior.coords))))


@lru_cache(maxsize=256)
def pieces(zone: NoFlyZone) -> tuple[Piece, ...]:
    """The disk, or convex polygons that make up the zone, where it is when it has not moved."""
    if zone.radius_m is not None:
        assert zone.north_m is not None and zone.east_m is not None
        return (Disk((zone.north_m, zone.east_m), zone.radius_m),)
    whole = outline(zone)
    if _is_convex(whole):
        return (_convex(whole),)
    parts = [_Part.of(part) for part in shapely.constrained_delaunay_triangles(whole).geoms]
    refused: set[tuple[_Part, _Part]] = set()
    while (found := _mergeable(parts, refused)) is not None:
        first, second, both = found
        parts = [part for part in parts if part not in (first, second)] + [both]
    return tuple(_convex(part.polygon) for part in parts)


def _mergeable(parts: list[_Part], refused: set[tuple[_Part, _Part]]) -> tuple[_Part, _Part, _Part] | None:
    """Two convex parts that are convex together, and what they make; `refused` learns the others."""
    for first, second in _neighbours(parts):
        if (first, second) in refused:
            continue
        both = shapely.union(first.polygon, second.polygon)
        if both.geom_type == "Polygon" and _is_convex(both):
            return first, second, _Part.of(both)
        refused.add((first, second))
    return None


def _neighbours(parts: list[_Part]) -> list[tuple[_Part, _Part]]:
    """The pairs of parts that share an edge, in order."""
    holders: dict[Edge, list[int]] = {}
    for number, part in enumerate(parts):
        for edge in part.edges:
            holders.setdefault(edge, []).append(number)
    pairs = sorted({(pair[0], pair[1]) for pair in holders.values() if len(pair) == 2})
    return [(parts[first], parts[second]) for first, second in pairs]


@lru_cache(maxsize=256)
def outline(zone: NoFlyZone) -> shapely.Polygon:
    """The zone (north, east) in the plane, where it is when it has not moved; a disk with many corners around it."""
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
    corners = np.array(grown.exterior.coords)[:-1]
    return zone.model_copy(update={"polygon_m": tuple((float(n), float(e)) for n, e in corners)})


def displacement_m(zone: NoFlyZone, t_s: Array) -> Array:
    """How far (..., 2), north and east, the zone has moved at plan times (...)."""
    t_s = np.asarray(t_s, dtype=np.float64)
    if not zone.moves:
        return np.zeros((*t_s.shape, 2))
    times, north, east = np.array(zone.moves).T
    return np.stack([np.interp(t_s, times, north), np.interp(t_s, times, east)], axis=-1)


def outside_m(zone: NoFlyZone, t_s: Array, north_m: Array, east_m: Array) -> Array:
    """Distance (...) outside the zone of places (...) at plan times that broadcast with them; negative inside."""
    moved = displacement_m(zone, t_s)
    return np.asarray(
        np.min([piece.outside_m(north_m - moved[..., 0], east_m - moved[..., 1]) for piece in pieces(zone)], axis=0)
    )


def signed_distance_m(zone: NoFlyZone, north_m: Array, east_m: Array) -> Array:
    """Distance (...) of places (...) to the edge of the zone where it has not moved: negative inside, true everywhere.

    It changes by no more than a place moves.
    """
    if zone.radius_m is not None:
        return pieces(zone)[0].outside_m(north_m, east_m)
    area = outline(zone)
    shapely.prepare(area)
    points = shapely.points(north_m, east_m)
    away_m = shapely.distance(area.exterior, points)
    return np.asarray(np.where(shapely.intersects(area, points), -away_m, away_m))


def nearest_zone_m(zones: Sequence[NoFlyZone], t_s: Array, north_m: Array, east_m: Array) -> Array:
    """True distance (...) of places (...) to the edge of the nearest zone at plan times that broadcast with them.

    Negative inside, infinite without zones.
    """
    found = np.full(np.broadcast_shapes(np.shape(t_s), np.shape(north_m)), np.inf)
    for zone in zones:
        moved = displacement_m(zone, t_s)
        found = np.minimum(found, signed_distance_m(zone, north_m - moved[..., 0], east_m - moved[..., 1]))
    return found


def _is_convex(polygon: shapely.Polygon) -> bool:
    return bool(polygon.area >= _CONVEX * polygon.convex_hull.area)


def _convex(polygon: shapely.Polygon) -> Convex:
    corners = np.array(shapely.orient_polygons(polygon.convex_hull, exterior_cw=False).exterior.coords)
    along = np.diff(corners, axis=0)
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    offsets = np.sum(normals * corners[:-1], axis=1)
    places = tuple((float(n), float(e)) for n, e in corners[:-1])
    return Convex(tuple((float(n), float(e)) for n, e in normals), tuple(offsets.tolist()), places)
