"""Routes: shortest paths past high ground and no-fly zones, one for each side on which these can be passed.

A grid holds the least height of the leader at each place (ground envelope, no-fly zones, box); Dijkstra's algorithm
finds paths below the ceiling. The optimiser starts from these routes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra

from gcs.errors import Infeasible
from gcs.plan.ocp.bounds import leader_state_bounds
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.formation_poses import Pose, floor_m, from_zones_m, poses
from gcs.scenario.environment.no_fly import zones
from gcs.types import Array

CELLS = 120  # along the longer side of the map
FINER = 4  # so much finer is the map of zones
MAX_ROUTES = 4
_TRIES = 8
_AVOID = 1.6  # cost factor near a route that is found, so that the next one differs
_AVOID_CELLS = 3
_SAME_ROUTE = 0.03  # of their length: routes closer than this are the same
_INSTANTS = 201  # at which bounds are evaluated
# Steps to the 16 nearest directions: 8 neighbours alone make paths up to 8 % too long.
_STEPS = [(a, b) for a in range(-2, 3) for b in range(-2, 3) if np.gcd(a, b) == 1]


@dataclass(frozen=True)
class Map:
    """The leader's feasible places: least height (A, B) in each cell, infinite in a no-fly zone."""

    north_m: Array  # (A,)
    east_m: Array  # (B,)
    floor_m: Array  # (A, B) least height of the leader
    ceiling_m: float
    closed: NDArray[np.bool_] | None = None  # (FINER (A - 1) + 1, ...): where zones are, FINER times as fine

    @property
    def free(self) -> NDArray[np.bool_]:
        """Cells the formation can pass under the ceiling."""
        return np.asarray(self.floor_m <= self.ceiling_m)

    def part(self, rows: slice, columns: slice) -> Map:
        """The map of some of its rows and columns."""
        finer = tuple(slice(FINER * part.start, FINER * (part.stop - 1) + 1) for part in (rows, columns))
        closed = None if self.closed is None else self.closed[finer]
        return Map(self.north_m[rows], self.east_m[columns], self.floor_m[rows, columns], self.ceiling_m, closed)

    def cell(self, place: Array) -> tuple[int, int]:
        """Nearest cell of a place (north, east)."""
        return int(np.abs(self.north_m - place[0]).argmin()), int(np.abs(self.east_m - place[1]).argmin())


@dataclass(frozen=True)
class Route:
    """A route in the plane without needless corners."""

    points_m: Array  # (P, 2) north, east
    sides: tuple[int, ...]  # homotopy class: turns about each obstacle, relative to the straight line
    ends: tuple[int, ...] = ()  # which of its points end a leg, but for the last

    @property
    def length_m(self) -> float:
        """Length in the plane."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())

    @property
    def legs(self) -> tuple[Route, ...]:
        """The routes of the legs, without their sides."""
        cuts = [0, *self.ends, len(self.points_m) - 1]
        return tuple(Route(self.points_m[a : b + 1], ()) for a, b in itertools.pairwise(cuts))

    def place(self, share: Array) -> Array:
        """Points (N, 2) at shares (N,) of the length."""
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1))])
        if along[-1] == 0.0:
            return np.repeat(self.points_m[:1], len(share), axis=0)
        at = share * along[-1]
        return np.column_stack([np.interp(at, along, self.points_m[:, axis]) for axis in (0, 1)])


def survey(problem: Problem, *, at_rest: bool = False) -> Map:
    """The leader's map: terrain, clearance and no-fly zones of all vehicles, in the best pose at each place.

    `at_rest`: coordinates stay at rest; a formation that turns with the course must be feasible in all headings.
    """
    ends = problem.stops_ned_m[:, :2]
    loosest = leader_state_bounds(problem, np.linspace(problem.start_s, problem.end_s, _INSTANTS))
    low, high = loosest[0].min(axis=0), loosest[1].max(axis=0)
    ceiling_m = float(-low[2])
    low, high = low[:2], high[:2]
    # Without a box (the run-up) the map is a margin around the straight route.
    margin_m = 0.25 * float(np.linalg.norm(ends[-1] - ends[0])) + 10.0
    low = np.where(np.isfinite(low), low, ends.min(axis=0) - margin_m)
    high = np.where(np.isfinite(high), high, ends.max(axis=0) + margin_m)
    step = float((high - low).max()) / CELLS
    north, east = (np.linspace(a, b, max(int(np.ceil((b - a) / step)) + 1, 2)) for a, b in zip(low, high, strict=True))
    grid_n, grid_e = np.meshgrid(north, east, indexing="ij")
    floors = [floor_m(problem, pose.offsets_ned_m, grid_n, grid_e) for pose in _poses(problem, at_rest=at_rest)]
    floor = np.max(floors, axis=0) if at_rest and problem.follows_course else np.min(floors, axis=0)
    closed = _closed(problem, north, east, at_rest=at_rest) if zones(problem.scenario) else None
    return Map(north, east, np.asarray(floor), ceiling_m, closed)


def _closed(problem: Problem, north: Array, east: Array, *, at_rest: bool) -> NDArray[np.bool_]:
    """Mask of places in zones, FINER times as fine as the map: a zone may be thinner than a cell."""
    grids = np.meshgrid(north, east, indexing="ij")
    finer = [np.interp(np.arange(FINER * (len(x) - 1) + 1) / FINER, np.arange(len(x)), x) for x in (north, east)]
    nearest = [np.minimum(np.arange(len(x)) + FINER // 2, len(x) - 1) // FINER for x in finer]
    beside_m = 1.5 * float(np.hypot(north[1] - north[0], east[1] - east[0]))
    masks = []
    for pose in _poses(problem, at_rest=at_rest):
        away_m = from_zones_m(problem, pose.offsets_ned_m, *grids)[np.ix_(*nearest)]
        mask = away_m < 0.0
        unsure = np.nonzero(np.abs(away_m) < beside_m)
        places = [x[index] for x, index in zip(finer, unsure, strict=True)]
        mask[unsure] = from_zones_m(problem, pose.offsets_ned_m, *places) < 0.0
        masks.append(mask)
    every = at_rest and problem.follows_course
    return np.asarray(np.any(masks, axis=0) if every else np.all(masks, axis=0))


def _poses(problem: Problem, *, at_rest: bool) -> list[Pose]:
    """Poses with each coordinate at rest, else also at an end of its range: poses in between need no less room."""

    def is_chosen(pose: Pose) -> bool:
        ends = ((c, () if at_rest else (c.low, c.high)) for c in problem.coordinates)
        return all(c.free_end or pose.values[c.name] in (c.rest, *more) for c, more in ends)

    return [pose for pose in poses(problem) if is_chosen(pose)]


def every_route(problem: Problem) -> tuple[Route, ...]:
    """Routes for the rigid formation, and routes that need a change of shape; shortest first.

    Raises Infeasible when there is none.
    """
    return routes_between(problem, survey(problem), survey(problem, at_rest=True) if problem.coordinates else None)


def routes_between(problem: Problem, area: Map, at_rest: Map | None) -> tuple[Route, ...]:
    """Routes from start to end in a map, and, shortest first, those of the formation with its coordinates at rest.

    Raises Infeasible when there is none.
    """
    routes = list(find_routes(problem, area))
    if at_rest is not None:
        try:
            rigid = find_routes(problem, at_rest)
        except Infeasible:
            rigid = ()
        share = np.linspace(0.0, 1.0, _INSTANTS)
        obstacles = _centres(area, ~area.free)
        rigid = tuple(replace(route, sides=_sides(route.points_m, obstacles)) for route in rigid)
        for route in rigid:
            apart = [np.linalg.norm(route.place(share) - known.place(share), axis=1).max() for known in routes]
            if min(apart) > _SAME_ROUTE * route.length_m:
                routes.append(route)
    return tuple(sorted(routes, key=lambda route: route.length_m))


def is_clear(problem: Problem, area: Map) -> bool:
    """Whether the straight line from start to end is free, at heights no larger than the lower end's."""
    a, b = (np.array(area.cell(state[:2])) for state in (problem.start_state, problem.end_state))
    level_m = min(-float(problem.start_state[2]), -float(problem.end_state[2]))
    return _sees(np.asarray(area.floor_m <= min(level_m, area.ceiling_m)), a, b) and not _crosses(area.closed, a, b)


def find_routes(problem: Problem, area: Map) -> tuple[Route, ...]:
    """Up to MAX_ROUTES routes, shortest first, that pass obstacles on different sides.

    Raises Infeasible when there is none, with the lowest ceiling that would allow one.
    """
    start, end = area.cell(problem.start_state[:2]), area.cell(problem.end_state[:2])
    free = area.free.copy()
    free[start] = free[end] = True  # cells are coarse; the ends are checked exactly elsewhere
    labels, _ = ndimage.label(free, structure=np.ones((3, 3)))
    if labels[start] != labels[end]:
        raise _no_route(area, start, end)
    found = _on_all_sides(problem, area, free, start, end)
    if not found and area.closed is not None:  # through a gap that only the coarser cells show
        found = _on_all_sides(problem, replace(area, closed=None), free, start, end)
    return found


def _on_all_sides(
    problem: Problem, area: Map, free: NDArray[np.bool_], start: tuple[int, int], end: tuple[int, int]
) -> tuple[Route, ...]:
    if area.closed is not None:
        closed = area.closed.copy()
        for place in (start, end):
            closed[tuple(slice(max(FINER * (i - 1), 0), FINER * (i + 1) + 1) for i in place)] = False
        area = replace(area, closed=closed)
    obstacles = _centres(area, ~free)
    ends = (problem.start_state[:2], problem.end_state[:2])
    cost_factor = np.ones_like(area.floor_m)
    routes: dict[tuple[int, ...], Route] = {}
    for _ in range(_TRIES):
        cells = _shortest(area, free, cost_factor, start, end)
        if cells is None:
            break
        points = _without_corners(area, free, cells)
        points[0], points[-1] = ends
        route = Route(points, _sides(points, obstacles))
        known = routes.get(route.sides)
        if known is None or route.length_m < known.length_m:
            routes[route.sides] = route
        if len(routes) == MAX_ROUTES:
            break
        near = np.zeros_like(free)
        near[tuple(cells.T)] = True
        cost_factor[ndimage.binary_dilation(near, iterations=_AVOID_CELLS)] *= _AVOID
    return tuple(sorted(routes.values(), key=lambda r: r.length_m))


def _no_route(area: Map, start: tuple[int, int], end: tuple[int, int]) -> Infeasible:
    """The error, with the lowest ceiling at which both ends are connected."""
    finite = area.floor_m[np.isfinite(area.floor_m)]
    low, high = area.ceiling_m, float(finite.max())

    def connected(ceiling_m: float) -> bool:
        labels, _ = ndimage.label(area.floor_m <= ceiling_m, structure=np.ones((3, 3)))
        return bool(labels[start] == labels[end] != 0)

    if not connected(high):
        return Infeasible.because(
            "no-fly zones block all routes from start to end",
            hint="move or shrink a zone ([[no_fly]]), or widen the area ([limits] north_m, east_m; [[keep_in]])",
        )
    while high - low > 0.05:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if connected(middle) else (middle, high)
    return Infeasible.because(
        f"there is no route under the ceiling of {area.ceiling_m:g} m; the lowest pass needs {high:.1f} m",
        hint=f"raise [limits] height_m to [.., {np.ceil(high):g}] or more",
    )


def _shortest(
    area: Map, free: NDArray[np.bool_], cost_factor: Array, start: tuple[int, int], end: tuple[int, int]
) -> NDArray[np.intp] | None:
    """Cells (P, 2) of the cheapest path, or None. A metre of climb or descent costs as much as a metre ahead."""
    shape = free.shape
    index = np.arange(free.size).reshape(shape)
    height = np.where(np.isfinite(area.floor_m), np.maximum(area.floor_m, 0.0), 0.0)  # an end may lie in a no-fly zone
    sources, targets, costs = [], [], []
    steps = np.array([area.north_m[1] - area.north_m[0], area.east_m[1] - area.east_m[0]])
    for a, b in _STEPS:
        here = (slice(max(0, -a), shape[0] - max(0, a)), slice(max(0, -b), shape[1] - max(0, b)))
        there = (slice(max(0, a), shape[0] - max(0, -a)), slice(max(0, b), shape[1] - max(0, -b)))
        passable = free[here] & free[there]
        if area.closed is not None:
            passable &= ~_steps_cross(area.closed, here, (a, b))
        step_m = float(np.hypot(*(np.array([a, b]) * steps)))
        cost = step_m * 0.5 * (cost_factor[here] + cost_factor[there]) + np.abs(height[there] - height[here])
        sources.append(index[here][passable])
        targets.append(index[there][passable])
        costs.append(cost[passable])
    graph = sparse.csr_matrix(
        (np.concatenate(costs), (np.concatenate(sources), np.concatenate(targets))), shape=(free.size, free.size)
    )
    goal, origin = int(index[end]), int(index[start])
    _, before = dijkstra(graph, indices=origin, return_predecessors=True)
    path = [goal]
    while path[-1] != origin:
        if before[path[-1]] < 0:
            return None
        path.append(int(before[path[-1]]))
    return np.column_stack(np.unravel_index(path[::-1], shape))


def _without_corners(area: Map, free: NDArray[np.bool_], cells: NDArray[np.intp]) -> Array:
    """Points (P, 2) of the same path without needless corners."""
    kept = [0]
    while kept[-1] < len(cells) - 1:
        ahead = range(len(cells) - 1, kept[-1], -1)
        here = cells[kept[-1]]
        kept.append(next(i for i in ahead if i == kept[-1] + 1 or _is_straight(area, free, here, cells[i])))
    corners = cells[kept]
    return np.column_stack([area.north_m[corners[:, 0]], area.east_m[corners[:, 1]]])


def _is_straight(area: Map, free: NDArray[np.bool_], a: NDArray[np.intp], b: NDArray[np.intp]) -> bool:
    return _sees(free, a, b) and not _crosses(area.closed, a, b)


def _crosses(closed: NDArray[np.bool_] | None, a: NDArray[np.intp], b: NDArray[np.intp]) -> bool:
    """Whether the straight line between two cells crosses a zone."""
    return closed is not None and not _sees(~closed, FINER * a, FINER * b)


def _steps_cross(closed: NDArray[np.bool_], here: tuple[slice, slice], step: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of the cells `here` from which a step crosses a zone."""
    parts = FINER * max(map(abs, step))
    rows, columns = (np.arange(part.start, part.stop) * FINER for part in here)
    crossed = np.zeros((len(rows), len(columns)), dtype=bool)
    for part in range(1, parts):
        ahead = [round(FINER * way * part / parts) for way in step]
        crossed |= closed[np.ix_(rows + ahead[0], columns + ahead[1])]
    return crossed


def _sees(free: NDArray[np.bool_], a: NDArray[np.intp], b: NDArray[np.intp]) -> bool:
    """Whether the straight line between two cells crosses free cells only."""
    count = 2 * int(np.abs(b - a).max()) + 1
    line = np.rint(np.linspace(a, b, count)).astype(int)
    return bool(free[line[:, 0], line[:, 1]].all())


def _centres(area: Map, blocked: NDArray[np.bool_]) -> Array:
    """Centres (O, 2) of the separate obstacles, without those at the rim, behind which no route passes."""
    labels, count = ndimage.label(blocked, structure=np.ones((3, 3)))
    rim = set(np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])).tolist())
    inner = [i for i in range(1, count + 1) if i not in rim]
    if not inner:
        return np.zeros((0, 2))
    cells = np.array(ndimage.center_of_mass(blocked, labels, inner))
    steps = np.array([area.north_m[1] - area.north_m[0], area.east_m[1] - area.east_m[0]])
    return np.asarray(np.array([area.north_m[0], area.east_m[0]]) + cells * steps)


def _sides(points: Array, obstacles: Array) -> tuple[int, ...]:
    """For each obstacle, the turns about it, relative to the straight line."""
    sides = []
    for centre in obstacles:
        bearing = np.unwrap(np.arctan2(*(points - centre).T[::-1]))
        straight = np.linspace(points[0], points[-1], 200) - centre
        direct = np.unwrap(np.arctan2(*straight.T[::-1]))
        sides.append(round(float((bearing[-1] - bearing[0]) - (direct[-1] - direct[0])) / (2 * np.pi)))
    return tuple(sides)
