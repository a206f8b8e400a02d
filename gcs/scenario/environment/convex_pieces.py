"""Convex pieces of the areas that vehicles avoid: disks, polygons and half-planes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import shapely

from gcs.types import Array

_CONVEX = 1.0 - 1e-9  # share of its hull's area that a convex polygon fills
_SLIVER_M2 = 1e-9  # what rounding leaves between an area and its hull


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
    """All places on the inner side of every edge. A half-plane has one edge and no corners."""

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
        if not self.corners_m:  # the edge says all
            nowhere = np.zeros(np.shape(north_m))
            return nowhere, nowhere, nowhere
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


def pieces_inside(area: shapely.Polygon) -> tuple[Convex, ...]:
    """Convex polygons that make up an area."""
    if _is_convex(area):
        return (_convex(area),)
    parts = [_Part.of(part) for part in shapely.constrained_delaunay_triangles(area).geoms]
    refused: set[tuple[_Part, _Part]] = set()
    while (found := _mergeable(parts, refused)) is not None:
        first, second, both = found
        parts = [part for part in parts if part not in (first, second)] + [both]
    return tuple(_convex(part.polygon) for part in parts)


def pieces_outside(area: shapely.Polygon) -> tuple[Convex, ...]:
    """Convex pieces that make up everything outside an area: half-planes beyond its hull, and parts of its notches."""
    hull = _convex(area)
    beyond = [
        Convex(((-north, -east),), (-offset,), ())
        for (north, east), offset in zip(hull.normals, hull.offsets_m, strict=True)
    ]
    notches = shapely.get_parts(area.convex_hull.difference(area))
    inside = [piece for notch in notches if notch.area > _SLIVER_M2 for piece in pieces_inside(notch)]
    return (*beyond, *inside)


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


def _is_convex(polygon: shapely.Polygon) -> bool:
    return bool(polygon.area >= _CONVEX * polygon.convex_hull.area)


def _convex(polygon: shapely.Polygon) -> Convex:
    corners = np.array(shapely.orient_polygons(polygon.convex_hull, exterior_cw=False).exterior.coords)
    along = np.diff(corners, axis=0)
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    offsets = np.sum(normals * corners[:-1], axis=1)
    places = tuple((float(n), float(e)) for n, e in corners[:-1])
    return Convex(tuple((float(n), float(e)) for n, e in normals), tuple(offsets.tolist()), places)
