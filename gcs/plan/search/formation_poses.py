"""Poses: the shapes that the formation may have at a place, on a coarse grid of its coordinates.

They do not depend on time. The search for routes uses the best pose at every place; the initial guess uses the cheapest
one that is feasible there. A few representative vehicles stand for the whole formation.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from gcs.plan.formation.coordinates import Coordinate, CoordinateName, bent
from gcs.plan.formation.shape import Rows
from gcs.plan.formation.timeline import stops_ned_m
from gcs.plan.ocp.objectives import departure_cost
from gcs.plan.ocp.problem import Problem
from gcs.scenario.environment.clearance_floor import coarse_floor_m
from gcs.scenario.environment.no_fly import outside_m, zones
from gcs.types import Array
from gcs.util.long_work import report

REPRESENTATIVES = 24
_STEPS = {CoordinateName.SCALE: 5, CoordinateName.HEADING: 5, CoordinateName.BLEND: 3}
_HEADINGS = 8  # of a formation that turns with the leader's course


@dataclass(frozen=True)
class Pose:
    """One shape of the formation."""

    values: dict[CoordinateName, float]
    offsets_ned_m: Array  # (R, 3) of the representatives
    cost: float  # cost rate of this pose


def poses(problem: Problem, t_s: float | None = None) -> list[Pose]:
    """All poses, the cheapest first: at one instant, or of all shapes of the schedule."""
    bases = stops_ned_m(problem.scenario) if t_s is None else (problem.shape.at(t_s),)
    made = []
    for base in bases:
        rows = representatives(base)
        for values in itertools.product(*(_grid(c) for c in problem.coordinates)):
            chosen = {c.name: v for c, v in zip(problem.coordinates, values, strict=True)}
            cost = sum(departure_cost(c, v) for c, v in zip(problem.coordinates, values, strict=True))
            offsets = np.stack(bent(chosen, tuple(base[rows].T), tuple(problem.target_ned_m[rows].T)), axis=-1)
            made.append(Pose(chosen, offsets, cost))
    return sorted(made, key=lambda pose: pose.cost)


def representatives(offsets_ned_m: Array) -> Rows:
    """Rows of at most REPRESENTATIVES vehicles spread over the shape: each is the farthest from those before it."""
    count = len(offsets_ned_m)
    if count <= REPRESENTATIVES:
        return np.arange(count)
    rows = [int(np.linalg.norm(offsets_ned_m, axis=1).argmin())]
    distance = np.full(count, np.inf)
    while len(rows) < REPRESENTATIVES:
        distance = np.minimum(distance, np.linalg.norm(offsets_ned_m - offsets_ned_m[rows[-1]], axis=1))
        rows.append(int(distance.argmax()))
    return np.array(rows)


def floor_m(problem: Problem, offsets_ned_m: Array, north_m: Array, east_m: Array) -> Array:
    """Least height (...) of the leader at places (...): infinite where a vehicle would be in a zone."""
    scenario = problem.scenario
    floor = np.full(np.shape(north_m), -np.inf)
    for offset_n, offset_e, offset_d in offsets_ned_m:
        report("mapping the room of every vehicle between zones, ground and ceiling")
        least = coarse_floor_m(scenario.terrain, north_m + offset_n, east_m + offset_e, scenario.limits.clearance_min_m)
        floor = np.maximum(floor, least + offset_d)
    return np.where(from_zones_m(problem, offsets_ned_m, north_m, east_m) < 0.0, np.inf, floor)


def from_zones_m(problem: Problem, offsets_ned_m: Array, north_m: Array, east_m: Array) -> Array:
    """How far (...) all vehicles are outside of all zones with the leader at places (...): negative inside of one."""
    when_s = _passed_s(problem, north_m, east_m)
    least = np.full(np.shape(north_m), np.inf)
    for zone in zones(problem.scenario):
        for offset_n, offset_e, _ in offsets_ned_m:
            least = np.minimum(least, outside_m(zone, when_s, north_m + offset_n, east_m + offset_e))
    return least


def _passed_s(problem: Problem, north_m: Array, east_m: Array) -> Array:
    """Times (...) at which the leader passes places (...), estimated at constant speed before there is a route."""
    to_m = np.hypot(north_m - problem.start_state[0], east_m - problem.start_state[1])
    from_m = np.hypot(north_m - problem.end_state[0], east_m - problem.end_state[1])
    return np.asarray(problem.start_s + problem.duration_s * to_m / np.maximum(to_m + from_m, 1e-9))


def _grid(coordinate: Coordinate) -> Array:
    if coordinate.free_end:
        return np.linspace(0.0, 2.0 * np.pi, _HEADINGS, endpoint=False)
    grid = np.linspace(coordinate.low, coordinate.high, _STEPS[coordinate.name])
    return np.unique(np.append(grid, coordinate.rest))
