"""Violations between the nodes, of all vehicles on a fine grid: which constraint, by how much, and when most.

Only vehicles near a limit are checked on the fine grid. The verifier later checks everything.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import VELOCITY, Array
from gcs.plan.formation.followers import formation_motion
from gcs.plan.formation.shape import Rows, Shape
from gcs.plan.nlp import margins
from gcs.plan.nlp.margins import Margin
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.trajectory import Trajectory

CHECK_EVERY_S = 0.05  # no coarser than the verifier: a peak of yaw rate can last less than 0.1 s
# Half of the verifier's tolerances, so that its finer grid finds nothing new.
LENGTH_TOLERANCE_M = 0.5e-3
LIMIT_TOLERANCE = 0.5e-3
COURSE_TOLERANCE = 0.5e-2
_BLOCK_S = 10.0
# Larger fleets are first checked every 0.5 s. Vehicles farther than _FAR_M from a limit need no fine grid.
_FEW = 16
_COARSE_S, _FAR_M = 0.5, 0.2
_COARSE_EVERY = round(_COARSE_S / CHECK_EVERY_S)
_DIRECTIONS = 8


@dataclass(frozen=True)
class Violation:
    """One period in which a constraint is violated: by how much where it is worst, and when."""

    name: str
    unit: str
    t_s: float
    by: float
    share: float  # of the limit's own size
    tolerated: float  # in units of the tolerance

    @property
    def by_si(self) -> float:
        """By how much; angles in radians."""
        return float(np.radians(self.by)) if self.unit.startswith("deg") else self.by

    def __str__(self) -> str:
        return f"{self.name} violated by {self.by:.3g} {self.unit} at t = {self.t_s:.1f} s"


def check_between_nodes(problem: Problem, trajectory: Trajectory, shape: Shape) -> tuple[Array, tuple[str, ...]]:
    """The worst instant of each violation, and descriptions of the violations."""
    found = find_violations(problem, trajectory, shape)
    return np.array(sorted({miss.t_s for miss in found})), complaints(found)


def complaints(found: tuple[Violation, ...]) -> tuple[str, ...]:
    """A description of the worst violation of each constraint."""
    worst: dict[str, Violation] = {}
    for miss in found:
        if miss.tolerated > 1.0 and (miss.name not in worst or miss.tolerated > worst[miss.name].tolerated):
            worst[miss.name] = miss
    return tuple(map(str, worst.values()))


def find_violations(problem: Problem, trajectory: Trajectory, shape: Shape) -> tuple[Violation, ...]:
    """All violations of the constraints that exceed their tolerance at some instant."""
    found = []
    for times, checked in _margins(problem, trajectory, shape):
        for margin, tolerance in checked:
            lowest = margin.value.min(axis=0)
            if lowest.min() >= -tolerance:
                continue
            for a, b in _periods(lowest < 0.0):
                at = a + int(np.argmin(lowest[a:b]))
                by = float(-lowest[at])
                found.append(
                    Violation(margin.name, margin.unit, float(times[at]), by, by / margin.scale, by / tolerance)
                )
    return tuple(found)


def _margins(
    problem: Problem, trajectory: Trajectory, shape: Shape
) -> Iterator[tuple[Array, list[tuple[Margin, float]]]]:
    """For each block of time: instants, and the margins there with their tolerances."""
    count = max(int(np.ceil(problem.duration_s / _BLOCK_S)), 1) if problem.vehicles > _FEW else 1
    edges = np.linspace(problem.start_s, problem.end_s, count + 1)
    for low, high in itertools.pairwise(edges):
        times = np.linspace(low, high, int(np.ceil((high - low) / CHECK_EVERY_S)) + 1)
        yield times, _positions(problem, trajectory, shape, times)
        moving = shape.is_moving(times)
        leader = np.array([problem.leader])
        for part, rows in ((times[~moving], leader), (times[moving], _fastest(problem, shape, times[moving]))):
            if len(part):
                yield part, _motions(problem, trajectory, shape, part, rows)
        yield times, _ranges(problem, trajectory, times)
        if problem.follows_course:
            faced = margins.course(
                problem.scenario, trajectory.state(times)[:, VELOCITY], _heading(problem, trajectory, times)
            )
            yield times, [(faced, COURSE_TOLERANCE * faced.scale)]


def _ranges(problem: Problem, trajectory: Trajectory, times: Array) -> list[tuple[Margin, float]]:
    """How far scale, heading and blend are within their ranges."""
    found = []
    for coordinate, value in zip(problem.coordinates, trajectory.coordinates(times).T, strict=True):
        inside = np.minimum(value - coordinate.low, coordinate.high - value)
        size = coordinate.high
        found.append((Margin(coordinate.name, "of its range", inside[None], size), LIMIT_TOLERANCE * size))
    return found


def _heading(problem: Problem, trajectory: Trajectory, times: Array) -> Array:
    """Direction (N,) in which the formation faces, rad."""
    number = [c.free_end for c in problem.coordinates].index(True)
    return np.asarray(trajectory.coordinates(times)[:, number] + problem.course_at_start_rad)


def _positions(problem: Problem, trajectory: Trajectory, shape: Shape, times: Array) -> list[tuple[Margin, float]]:
    scenario = problem.scenario
    rows = _near_a_limit(problem, trajectory, shape, float(times[0]), float(times[-1]))
    if not len(rows):
        return []
    places = trajectory.state(times)[:, :3] + shape.offsets(times, 0, rows)
    found = [margins.clearance(scenario, places), *margins.no_fly(scenario, places, times)]
    height = margins.height(scenario, places)
    checked = [(height, LIMIT_TOLERANCE * height.scale)]
    if problem.has_box:
        found += margins.box(scenario, places)
    return checked + [(margin, LENGTH_TOLERANCE_M) for margin in found]


def _near_a_limit(problem: Problem, trajectory: Trajectory, shape: Shape, start_s: float, end_s: float) -> Rows:
    """Rows of the vehicles to check on the fine grid over a block of time."""
    every_row = np.arange(problem.vehicles)
    if problem.vehicles <= _FEW:
        return every_row
    times = np.linspace(start_s, end_s, int(np.ceil((end_s - start_s) / _COARSE_S)) + 1)
    places = trajectory.state(times)[:, :3] + shape.offsets(times)
    scenario = problem.scenario
    near = np.zeros(problem.vehicles, dtype=bool)
    others = [
        margins.clearance(scenario, places),
        *margins.no_fly(scenario, places, times),
        margins.height(scenario, places),
    ]
    others += margins.box(scenario, places) if problem.has_box else []
    # Between two coarse instants a vehicle comes closer to anything by at most half the distance that it flies.
    reach = 0.5 * np.linalg.norm(np.diff(places, axis=1), axis=2).max(axis=1)
    for margin in others:
        near |= margin.value.min(axis=1) < _FAR_M + reach
    return np.flatnonzero(near)


def _fastest(problem: Problem, shape: Shape, times: Array) -> Rows:
    """Rows with the largest speed or acceleration within the shape in some direction; in a small fleet, all rows."""
    if problem.vehicles <= _FEW or not len(times):
        return np.arange(problem.vehicles)
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = np.stack([np.cos(angle), np.sin(angle)])
    rows = [np.array([problem.leader])]
    for order in (1, 2):
        motion = shape.offsets(times[::_COARSE_EVERY], order)
        rows.append(np.argmax(motion[..., :2] @ directions, axis=0).ravel())
        rows.append(np.argmax(np.abs(motion[..., 2]), axis=0))
        rows.append(np.argmax(np.linalg.norm(motion, axis=2), axis=0))
    return np.unique(np.concatenate(rows))


def _motions(
    problem: Problem, trajectory: Trajectory, shape: Shape, times: Array, rows: Rows
) -> list[tuple[Margin, float]]:
    scenario, vehicle = problem.scenario, trajectory.vehicle
    states, controls = formation_motion(vehicle.state, vehicle.control, shape, problem.quadrotor, times, rows)
    found = [*margins.state_limits(scenario, states), margins.turning(scenario, states, controls)]
    found += margins.acceleration(scenario, states, controls)
    found += margins.shape_motion(scenario, shape.offsets(times, 1, rows), shape.offsets(times, 2, rows))
    return [(margin, LIMIT_TOLERANCE * margin.scale) for margin in found]


def _periods(mask: Array) -> list[tuple[int, int]]:
    """Half-open index ranges in which `mask` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
