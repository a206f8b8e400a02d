"""Shortest ways back for a plan's fleet: round every no-fly zone and inside the fence.

A way is a polyline in the plane. Its corners are those of a visibility graph: the corners of the zones, with a
clearance around them. A moving zone counts with all the area that it covers while the return may take.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse.csgraph import csgraph_from_dense, dijkstra

from gcs.mission.failsafe.fence_areas import inclusion_corners, outside_area, planned_places_m, swept_area
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

CLEARANCES_M = (3.0, 1.0)  # around zones and inside the fence; the smaller one where the larger one leaves no way
_CLEAR_M = 0.02  # corners of ways stand so far outside the area that legs avoid
_WINDOW_S = 10.0  # in which a moving zone's covered area is the same
_SLOWEST_SHARE = 0.5  # of the speed limit: the slowest return
_LONGEST_SHARE = 1.5  # of the fence's diameter: the longest way that a moving zone's area is taken for
_FLAT = -1e-9

Area = Callable[[float], shapely.Geometry]  # the area to avoid, by the clearance around it


@dataclass(frozen=True)
class Ways:
    """Ways from N places: their points (N, W, 2), the last one repeated, and lengths (N,), infinite without a way."""

    points_m: Array
    length_m: Array


class ReturnRoutes:
    """The ways of a plan's fleet from anywhere to any place, for returns that begin at a plan time."""

    def __init__(self, plan: Plan) -> None:
        corners = inclusion_corners(planned_places_m(plan))
        self._inclusion = shapely.Polygon(corners)
        self._zones = plan.scenario.no_fly
        self._moves = any(zone.moves for zone in self._zones)
        limits = plan.scenario.limits
        longest_m = _LONGEST_SHARE * float(np.linalg.norm(np.ptp(corners, axis=0)))
        climb_s = 2.0 * float(np.ptp(limits.height_m)) / limits.speed_ned_mps[2]
        self._return_s = longest_m / (_SLOWEST_SHARE * min(limits.speed_ned_mps[:2])) + climb_s
        self._graphs: dict[tuple[int, float], _Graph] = {}

    def way_ned_m(self, from_ned_m: Array, to_ned_m: Array, t_s: float = 0.0) -> Array | None:
        """The shortest way (W, 2) of a return that begins at `t_s`; None without a way.

        A vehicle in an area to avoid leaves it by the nearest edge; so it enters one that its end is in.
        """
        found = self.ways(np.asarray(from_ned_m)[None, :2], to_ned_m, np.array([t_s]))
        if not np.isfinite(found.length_m[0]):
            return None
        points = found.points_m[0]
        moved = np.any(points[1:] != points[:-1], axis=1)
        return np.asarray(points[np.append(True, moved)] if moved.any() else np.repeat(points[:1], 2, axis=0))

    def length_m(self, from_ned_m: Array, to_ned_m: Array, t_s: float = 0.0) -> float:
        """The length of the shortest way; infinite without one."""
        return float(self.ways(np.asarray(from_ned_m)[None, :2], to_ned_m, np.array([t_s])).length_m[0])

    def ways(self, from_m: Array, to_m: Array, t_s: Array) -> Ways:
        """The shortest ways from places (N, 2) to one place, for returns that begin at plan times (N,)."""
        end = (float(to_m[0]), float(to_m[1]))
        windows = np.floor(t_s / _WINDOW_S).astype(int) if self._moves else np.zeros(len(from_m), dtype=int)
        points, lengths = [np.empty((0, 2))] * len(from_m), np.full(len(from_m), np.inf)
        for window in np.unique(windows).tolist():
            left = np.flatnonzero(windows == window)
            for clearance_m in CLEARANCES_M:
                found, length_m = self._graph(window, clearance_m).ways(from_m[left], end)
                for row, way in zip(left.tolist(), found, strict=True):
                    points[row] = way
                lengths[left] = length_m
                left = left[~np.isfinite(length_m)]
                if not len(left):
                    break
        most = max(len(way) for way in points)
        return Ways(np.stack([np.append(w, np.repeat(w[-1:], most - len(w), axis=0), axis=0) for w in points]), lengths)

    def _graph(self, window: int, clearance_m: float) -> _Graph:
        if (window, clearance_m) not in self._graphs:
            self._graphs[window, clearance_m] = _Graph(lambda more_m: self._avoided(window, clearance_m + more_m))
        return self._graphs[window, clearance_m]

    def _avoided(self, window: int, clearance_m: float) -> shapely.Geometry:
        begin_s = window * _WINDOW_S
        zones = [swept_area(z, clearance_m, begin_s, begin_s + _WINDOW_S + self._return_s) for z in self._zones]
        return shapely.union_all([*zones, outside_area(self._inclusion, clearance_m)])


class _Graph:
    """The visibility graph of one area to avoid, and the shortest ways through it."""

    def __init__(self, avoided: Area) -> None:
        self._avoided = avoided(0.0)
        shapely.prepare(self._avoided)
        wide = avoided(_CLEAR_M)
        self._free = shapely.box(*shapely.bounds(wide)).difference(wide)
        self._corners = _outer_corners(self._free)
        first, second = np.triu_indices(len(self._corners), 1)
        seen = self._sees(self._corners[first], self._corners[second])
        self._apart_m = np.full((len(self._corners),) * 2, np.inf)
        away_m = np.linalg.norm(self._corners[first] - self._corners[second], axis=1)
        self._apart_m[first, second] = self._apart_m[second, first] = np.where(seen, away_m, np.inf)
        self._trees: dict[tuple[float, float], tuple[Array, list[Array]]] = {}

    def ways(self, starts: Array, end: tuple[float, float]) -> tuple[list[Array], Array]:
        """Ways from starts (N, 2) to the end, and their lengths (N,)."""
        last = np.array([end, *self._nearest_free(np.array([end]))])[::-1]  # from the graph to the end
        outs = self._nearest_free(starts)
        inside_m = np.linalg.norm(outs - starts, axis=1) + float(np.linalg.norm(last[1] - last[0]))
        length_m = np.linalg.norm(outs - last[0], axis=1)
        straight = self._sees(outs, np.broadcast_to(last[0], outs.shape))
        tails: list[Array] = [last] * len(starts)
        length_m[~straight] = np.inf
        hidden = np.flatnonzero(~straight)
        if len(hidden) and len(self._corners):
            left_m, chains = self._tree(end, last[0])
            total_m = np.linalg.norm(outs[hidden, None] - self._corners, axis=-1) + left_m
            order = np.argsort(total_m, axis=1, kind="stable")
            for place in range(len(self._corners)):
                corner = order[:, place]
                best_m = total_m[np.arange(len(hidden)), corner]
                possible = np.isfinite(best_m)
                hidden, order, total_m, corner = (a[possible] for a in (hidden, order, total_m, corner))
                seen = self._sees(outs[hidden], self._corners[corner])
                for row, number in zip(hidden[seen].tolist(), corner[seen].tolist(), strict=True):
                    tails[row] = np.append(chains[number], last, axis=0)
                length_m[hidden[seen]] = best_m[possible][seen]
                hidden, order, total_m = (a[~seen] for a in (hidden, order, total_m))
                if not len(hidden):
                    break
        ways = [np.concatenate([[a], [b], tail]) for a, b, tail in zip(starts, outs, tails, strict=True)]
        return [way[np.append(True, np.any(way[1:] != way[:-1], axis=1))] for way in ways], length_m + inside_m

    def _tree(self, end: tuple[float, float], place: Array) -> tuple[Array, list[Array]]:
        """The length (C,) of the way from each corner to a place, and its corners."""
        if end not in self._trees:
            count = len(self._corners)
            apart_m = np.full((count + 1, count + 1), np.inf)
            apart_m[:count, :count] = self._apart_m
            seen = self._sees(self._corners, np.broadcast_to(place, self._corners.shape))
            away_m = np.maximum(np.linalg.norm(self._corners - place, axis=1), 1e-6)  # 0 means no edge
            apart_m[count, :count] = apart_m[:count, count] = np.where(seen, away_m, np.inf)
            graph = csgraph_from_dense(apart_m, null_value=np.inf)
            left_m, following = dijkstra(graph, directed=False, indices=count, return_predecessors=True)
            chains = []
            for corner in range(count):
                chain = [corner]
                while 0 <= (after := int(following[chain[-1]])) < count:
                    chain.append(after)
                chains.append(self._corners[chain])
            self._trees[end] = left_m[:count], chains
        return self._trees[end]

    def _sees(self, first: Array, second: Array) -> NDArray[np.bool_]:
        """Whether straight legs (N, 2) to (N, 2) keep out of the area."""
        legs = shapely.linestrings(np.stack([first, second], axis=1))
        return np.asarray(~shapely.intersects(self._avoided, legs))

    def _nearest_free(self, places: Array) -> Array:
        """The nearest places (N, 2) outside the area."""
        nearest = places.copy()
        points = shapely.points(places)
        inside = shapely.intersects(self._avoided, points)
        if inside.any() and not self._free.is_empty:
            lines = shapely.shortest_line(points[inside], self._free)
            nearest[inside] = shapely.get_coordinates(lines).reshape(-1, 2, 2)[:, 1]
        return nearest


def _outer_corners(free: shapely.Geometry) -> Array:
    """The corners (C, 2) round which a shortest way through the free area may turn."""
    found = [np.empty((0, 2))]
    for part in shapely.get_parts(shapely.orient_polygons(free, exterior_cw=False)):
        for ring in (part.exterior, *part.interiors):
            corners = np.array(ring.coords)[:-1]
            before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
            found.append(corners[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < _FLAT])
    return np.concatenate(found)
