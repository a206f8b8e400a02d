"""Shortest return routes of a fleet: around every no-fly zone, inside the fence.

A way is a polyline in the plane. Its corners are those of a visibility graph: the corners of the zones, with a
clearance around them. A moving zone counts with all the area that it covers while the return may take.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse.csgraph import csgraph_from_dense, dijkstra

from gcs.mission.returns.fence_areas import inclusion_corners, outside_area, planned_places_m, swept_area
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import zones
from gcs.types import Array

CLEARANCES_M = (3.0, 1.0)  # around zones and inside the fence; the smaller one where the larger one leaves no way
_CLEAR_M = 0.02  # corners of ways stand so far outside the area that legs avoid
_WINDOW_S = 10.0  # in which a moving zone's covered area is the same
_SLOWEST_SHARE = 0.5  # of the speed limit: the slowest return
_LONGEST_SHARE = 1.5  # of the fence's diameter: the longest way that a moving zone's area is taken for
_STRAIGHT = 1e-9  # sine of a corner's turn
_AROUND = 1.006  # of a disk's radius: its outline of 32 corners holds it
_SIDE = 1e-6  # m: an edge is on both sides of a leg along it

Flags = NDArray[np.bool_]
Area = Callable[[float], shapely.Geometry]  # the area to avoid, by the clearance around it


@dataclass(frozen=True)
class Ways:
    """Ways from N places: points (N, W, 2), some of them repeated, and lengths (N,), infinite without a way."""

    points_m: Array
    length_m: Array


class ReturnRoutes:
    """The ways of a plan's fleet from anywhere to any place, for returns that begin at a plan time."""

    def __init__(self, plan: Plan) -> None:
        corners = inclusion_corners(planned_places_m(plan))
        self._inclusion = shapely.Polygon(corners)
        self._zones = zones(plan.scenario)
        self._moves = any(zone.moves for zone in self._zones)
        limits = plan.scenario.limits
        longest_m = _LONGEST_SHARE * float(np.linalg.norm(np.ptp(corners, axis=0)))
        climb_s = 2.0 * float(np.ptp(limits.height_m)) / limits.speed_ned_mps[2]
        self._return_s = longest_m / (_SLOWEST_SHARE * min(limits.speed_ned_mps[:2])) + climb_s
        self._graphs: dict[tuple[int, float], _Graph] = {}
        self._forbidden: dict[int, shapely.Geometry] = {}

    def way_ned_m(self, from_ned_m: Array, to_ned_m: Array, t_s: float = 0.0) -> Array | None:
        """The shortest way (W, 2) of a return that begins at `t_s`; None without a way.

        A vehicle in an area to avoid leaves it by the nearest edge; so it enters one that its end is in.
        """
        found = self.ways(np.asarray(from_ned_m)[None, :2], np.asarray(to_ned_m)[None, :2], np.array([t_s]))
        if not np.isfinite(found.length_m[0]):
            return None
        points = found.points_m[0]
        moved = np.any(points[1:] != points[:-1], axis=1)
        return np.asarray(points[np.append(True, moved)] if moved.any() else points[-2:])

    def length_m(self, from_ned_m: Array, to_ned_m: Array, t_s: float = 0.0) -> float:
        """The length of the shortest way; infinite without one."""
        found = self.ways(np.asarray(from_ned_m)[None, :2], np.asarray(to_ned_m)[None, :2], np.array([t_s]))
        return float(found.length_m[0])

    def ways(self, from_m: Array, to_m: Array, t_s: Array) -> Ways:
        """The shortest ways from places (N, 2) to places (N, 2), for returns that begin at plan times (N,)."""
        windows = np.floor(t_s / _WINDOW_S).astype(int) if self._moves else np.zeros(len(from_m), dtype=int)
        points, lengths = np.stack([from_m, to_m], axis=1), np.full(len(from_m), np.inf)
        for window in np.unique(windows).tolist():
            left = np.flatnonzero(windows == window)
            for clearance_m in CLEARANCES_M:
                found = self._graph(window, clearance_m).ways(from_m[left], to_m[left])
                more = found.points_m.shape[1] - points.shape[1]
                points = np.append(points, np.repeat(points[:, -1:], max(more, 0), axis=1), axis=1)
                points[left, : found.points_m.shape[1]] = found.points_m
                points[left, found.points_m.shape[1] :] = to_m[left, None]
                lengths[left] = found.length_m
                left = left[~np.isfinite(found.length_m)]
                if not len(left):
                    break
        return Ways(points, lengths)

    def graph(self, t_s: float, clearance_m: float) -> _Graph:
        """The visibility graph of returns that begin about a plan time."""
        return self._graph(int(np.floor(t_s / _WINDOW_S)) if self._moves else 0, clearance_m)

    @property
    def changes_s(self) -> float:
        """The areas to avoid are the same between two multiples of this time; infinite without moving zones."""
        return _WINDOW_S if self._moves else float(np.inf)

    def forbidden(self, t_s: float) -> shapely.Geometry:
        """No-fly zones and all that is outside the fence, about a plan time."""
        window = int(np.floor(t_s / _WINDOW_S)) if self._moves else 0
        if window not in self._forbidden:
            self._forbidden[window] = self._avoided(window, 0.0, _WINDOW_S)
            shapely.prepare(self._forbidden[window])
        return self._forbidden[window]

    def outside_fence_m(self, places_m: Array) -> Array:
        """How far places (..., 2) are outside the fence; 0 inside."""
        return np.asarray(shapely.distance(self._inclusion, shapely.points(places_m)))

    def depth_m(self, tracks_m: Array, t_s: Array) -> Array:
        """The length (N,) of tracks (N, P, 2) in no-fly zones and outside the fence at plan times (N,)."""
        lines, inside_m = shapely.linestrings(tracks_m), np.zeros(len(tracks_m))
        windows = np.floor(t_s / _WINDOW_S).astype(int) if self._moves else np.zeros(len(tracks_m), dtype=int)
        for window in np.unique(windows).tolist():
            area = self.forbidden(window * _WINDOW_S)
            rows = np.flatnonzero((windows == window) & shapely.intersects(area, lines))
            inside_m[rows] = shapely.length(shapely.intersection(lines[rows], area))
        return inside_m

    def _graph(self, window: int, clearance_m: float) -> _Graph:
        if (window, clearance_m) not in self._graphs:
            self._graphs[window, clearance_m] = _Graph(
                lambda more_m: self._avoided(window, clearance_m + more_m, _WINDOW_S + self._return_s)
            )
        return self._graphs[window, clearance_m]

    def _avoided(self, window: int, clearance_m: float, for_s: float) -> shapely.Geometry:
        begin_s = window * _WINDOW_S
        zones = [swept_area(zone, clearance_m, begin_s, begin_s + for_s) for zone in self._zones]
        return shapely.union_all([*zones, outside_area(self._inclusion, clearance_m)])


class _Graph:
    """The visibility graph of one area to avoid, and the shortest ways through it."""

    def __init__(self, avoided: Area) -> None:
        self._avoided = avoided(0.0)
        shapely.prepare(self._avoided)
        wide = avoided(_CLEAR_M)
        self._free = shapely.box(*shapely.bounds(wide)).difference(wide)
        self._corners, self._before, self._after = _outer_corners(self._free)
        count = len(self._corners)
        self._apart_m = np.full((count, count), np.inf)
        first, second = np.nonzero(np.triu(self._turns(self._corners) & self._turns(self._corners).T, 1))
        seen = self._sees(self._corners[first], self._corners[second])
        away_m = np.linalg.norm(self._corners[first] - self._corners[second], axis=1)
        self._apart_m[first, second] = self._apart_m[second, first] = np.where(seen, away_m, np.inf)
        self._trees: dict[tuple[float, float], tuple[Array, Array]] = {}

    def ways(self, starts: Array, ends: Array) -> Ways:
        """Ways from starts (N, 2) to ends (N, 2)."""
        outs, ins = self._nearest_free(starts), self._nearest_free(ends)
        different, which = np.unique(ins, axis=0, return_inverse=True)
        hidden = np.flatnonzero(~self._sees(outs, ins))
        length_m = np.linalg.norm(outs - ins, axis=1)
        length_m[hidden] = np.inf
        middle = ins[:, None]
        if len(hidden) and len(self._corners):
            trees = [self._tree(place) for place in different]
            longest = max(chains.shape[1] for _, chains in trees)
            middle = np.repeat(middle, longest, axis=1)
            left_m = np.stack([left for left, _ in trees])[which.reshape(-1)[hidden]]
            total_m = np.linalg.norm(outs[hidden, None] - self._corners, axis=-1) + left_m
            total_m[~self._turns(outs[hidden])] = np.inf
            while len(hidden):
                corner = np.argmin(total_m, axis=1)
                rows = np.arange(len(hidden))
                best_m = total_m[rows, corner]
                seen = np.isfinite(best_m) & self._sees(outs[hidden], self._corners[corner])
                length_m[hidden[seen]] = best_m[seen]
                for row, number in zip(hidden[seen].tolist(), corner[seen].tolist(), strict=True):
                    chain = trees[which.reshape(-1)[row]][1][number]
                    middle[row, : len(chain)] = chain
                total_m[rows, corner] = np.inf
                more = ~seen & np.isfinite(best_m)
                hidden, total_m = hidden[more], total_m[more]
        length_m += np.linalg.norm(outs - starts, axis=1) + np.linalg.norm(ends - ins, axis=1)
        return Ways(
            np.concatenate([starts[:, None], outs[:, None], middle, ins[:, None], ends[:, None]], axis=1), length_m
        )

    def possible(self, centres: Array, reach_m: Array, end: Array) -> list[list[Array] | None]:
        """Ways (W, 2) to one end, of which the one from any start within a disk (N) is one, but for its start.

        The first point of each is the disk's centre. None where that is not certain: a disk that meets the area to
        avoid, or one without a certain way.
        """
        disks = shapely.buffer(shapely.points(centres), reach_m * _AROUND + _SIDE, quad_segs=8)  # of 0 it is empty
        free = ~shapely.intersects(self._avoided, disks)
        last = self._nearest_free(end[None])
        rest = last if np.array_equal(last[0], end) else np.concatenate([last, end[None]])
        straight = free & self._clear(disks, np.broadcast_to(last[0], centres.shape))
        found: list[list[Array] | None] = [None] * len(centres)
        for row in np.flatnonzero(free).tolist():
            centre, corners = centres[row], self._corners
            if straight[row]:
                found[row] = [np.concatenate([centre[None], rest])]
                continue
            if not len(corners):
                continue
            left_m, chains = self._tree(last[0])
            total_m = np.linalg.norm(corners - centre, axis=1) + left_m
            reach = float(reach_m[row])
            every = np.flatnonzero(np.isfinite(total_m) & self._turns(centre[None], -reach)[0])
            turning = every[self._turns(centre[None], reach)[0, every]]
            sure = turning[self._clear(np.full(len(turning), disks[row]), corners[turning])]
            if not len(sure):
                continue
            near = every[total_m[every] <= total_m[sure].min() + 2.0 * reach + _SIDE]
            near = near[~self._blocked(centre, corners[near], reach)]
            ways = [] if self._blocked(centre, last, reach)[0] else [rest]
            # A corner, and then what leads on from it; the place itself ends each chain, several times.
            for corner in near.tolist():
                chain = np.concatenate([chains[corner], rest])
                ways.append(chain[np.append(True, np.any(chain[1:] != chain[:-1], axis=1))])
            found[row] = [np.concatenate([centre[None], way]) for way in ways]
        return found

    def _clear(self, disks: NDArray[np.object_], places: Array) -> Flags:
        """Whether (N,) all legs from disks (N,) to places (N, 2) keep out of the area."""
        if not len(disks):
            return np.zeros(0, dtype=bool)
        parts = [disks, shapely.points(places)]
        hulls = shapely.convex_hull(shapely.union(*parts))
        return np.asarray(~shapely.intersects(self._avoided, hulls))

    def _blocked(self, centre: Array, places: Array, reach_m: float) -> Flags:
        """Whether (N,) no leg from a disk to places (N, 2) keeps out: a point of the middle one is that deep inside."""
        legs = shapely.linestrings(np.stack([np.broadcast_to(centre, places.shape), places], axis=1))
        inside = shapely.intersection(self._avoided, legs)
        deep_m = shapely.distance(shapely.point_on_surface(inside), shapely.boundary(self._avoided))
        return np.asarray(~shapely.is_empty(inside) & (deep_m > reach_m))

    def _tree(self, place: Array) -> tuple[Array, Array]:
        """The length (C,) of the way from each corner to a place, and its corners (C, K, 2), followed by the place."""
        key = (float(place[0]), float(place[1]))
        if key not in self._trees:
            count = len(self._corners)
            apart_m = np.full((count + 1, count + 1), np.inf)
            apart_m[:count, :count] = self._apart_m
            seen = self._sees(self._corners, np.broadcast_to(place, self._corners.shape))
            away_m = np.maximum(np.linalg.norm(self._corners - place, axis=1), 1e-6)  # 0 means no edge
            apart_m[count, :count] = apart_m[:count, count] = np.where(seen, away_m, np.inf)
            graph = csgraph_from_dense(apart_m, null_value=np.inf)
            left_m, following = dijkstra(graph, directed=False, indices=count, return_predecessors=True)
            following = np.where(following < 0, count, following)  # of the place itself, and without a way
            chain = [np.arange(count)]
            while np.any(chain[-1] != count):
                chain.append(following[chain[-1]])
            self._trees[key] = left_m[:count], np.append(self._corners, place[None], axis=0)[np.stack(chain, axis=1)]
        return self._trees[key]

    def _turns(self, starts: Array, reach_m: float = 0.0) -> Flags:
        """Whether (N, C) a way from a start may turn at a corner: both edges lie on one side of the leg.

        With a reach, whether that is certain of all starts so near to these; below 0, whether it is so of one of them.
        """
        legs = self._corners - starts[:, None]
        sides = [legs[..., 0] * edge[:, 1] - legs[..., 1] * edge[:, 0] for edge in (self._before, self._after)]
        least = reach_m - _SIDE
        return np.asarray(((sides[0] > least) & (sides[1] > least)) | ((sides[0] < -least) & (sides[1] < -least)))

    def _sees(self, first: Array, second: Array) -> Flags:
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


def _outer_corners(free: shapely.Geometry) -> tuple[Array, Array, Array]:
    """The corners (C, 2) round which a shortest way may turn, and the directions (C, 2) of their two edges."""
    found = [np.empty((0, 3, 2))]
    for part in shapely.get_parts(shapely.orient_polygons(free, exterior_cw=False)):
        for ring in (part.exterior, *part.interiors):
            corners = np.array(ring.coords)[:-1]
            before, after = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
            before, after = (edge / np.linalg.norm(edge, axis=1)[:, None] for edge in (before, after))
            outer = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > _STRAIGHT
            found.append(np.stack([corners, before, after], axis=1)[outer])
    corners, before, after = np.moveaxis(np.concatenate(found), 1, 0)
    return corners, before, after
