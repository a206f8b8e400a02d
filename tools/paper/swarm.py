"""A standard particle swarm (PSO) that plans the fastest path of one vehicle after another, as in §4.3.

A path is a cubic spline through points beside the straight line, flown at one speed along it. It has no attitude, no
controls and no time of arrival. The search uses the optimiser's smooth envelope of the ground.
"""

import itertools
import time
from typing import Any, NamedTuple

import numpy as np
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.core.problem import Problem
from scipy.interpolate import make_interp_spline

from gcs.scenario.environment.terrain import ground_envelope_m, ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import NED_FROM_UP, heading_ref_deg, offsets_ned_m
from gcs.types import Array

POINTS, SAMPLES, PARTICLES = 8, 401, 80  # of a path between its ends, along it; of a swarm
INERTIA, PULL = 0.7298, 1.49618  # Clerc and Kennedy's constriction
STILL, STILL_GENERATIONS, MOST_GENERATIONS = 1e-4, 60, 3000  # converged: so many generations without so much gain
GRID_S = 0.05
_ASIDE_M, _RESERVE_M = 300.0, 0.03  # ours keeps as much
_ROUNDING = 1e-9  # of a spline: ends on the edge of the box are inside
_LEAST_M, _LEAST_MPS = 1e-9, 1e-3  # a path of one point, or a start at rest


class Search(Problem):  # type: ignore[misc]  # pymoo has no types
    """Distance aside and height of every point; least time; ground, ceiling, box, turning, earlier tracks.

    The speed is limited over ground by the slower axis, whatever the direction, and by half of Eq. 18 each in turns and
    in changes: with a limit for every axis, all paths that never turn back in the slowest take the same time.
    """

    def __init__(self, scenario: Scenario, start_m: Array, goal_m: Array, earlier: list[Array]) -> None:
        limits = scenario.limits
        self.scenario, self.earlier, self.ends = scenario, earlier, np.array([start_m, goal_m])
        most_mps2 = limits.load_factor_max * scenario.vehicle.gravity_mps2
        self.accel_mps2 = min(most_mps2, limits.accel_max_mps2 or most_mps2) / np.sqrt(2.0)
        self.level_mps, self.vertical_mps = min(limits.speed_ned_mps[:2]), limits.speed_ned_mps[2]
        spline = make_interp_spline(np.linspace(0.0, 1.0, POINTS + 2), np.eye(POINTS + 2), k=3, bc_type="natural")
        self.matrices = [np.asarray(spline(np.linspace(0.0, 1.0, SAMPLES), order)) for order in range(3)]
        way = self.ends[1, :2] - self.ends[0, :2]
        self.along = self.ends[0, :2] + np.linspace(0.0, 1.0, POINTS + 2)[1:-1, None] * way
        self.aside = np.array([-way[1], way[0]]) / np.linalg.norm(way)
        box = zip((limits.north_m, limits.east_m), self.ends.T[:2], strict=True)
        self.box = [(min(low, *ends), max(high, *ends)) for (low, high), ends in box]  # the paper's ends are outside
        low, high = (
            np.r_[np.full(POINTS, m), np.full(POINTS, h)]
            for m, h in zip((-_ASIDE_M, _ASIDE_M), limits.height_m, strict=True)
        )
        super().__init__(n_var=2 * POINTS, n_obj=1, n_ieq_constr=5, xl=low, xu=high)

    def paths(self, x: Array) -> tuple[Array, Array, Array]:
        """Of particles (P, 2 K): places (P, S, 3) north, east, height; least times (P, S); load factors (P, S)."""
        points = np.empty((len(x), POINTS + 2, 3))
        points[:, 0], points[:, -1] = self.ends
        points[:, 1:-1, :2] = self.along + x[:, :POINTS, None] * self.aside
        points[:, 1:-1, 2] = x[:, POINTS:]
        places, first, second = (np.matmul(matrix, points) for matrix in self.matrices)  # (P, S, 3)
        t_s, speed = self.fastest(places, first, second)
        cross = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
        level = np.maximum(np.hypot(first[..., 0], first[..., 1]), 1e-6)
        return places, t_s, speed**2 * cross / level**3 / self.scenario.vehicle.gravity_mps2

    def fastest(self, places_m: Array, first: Array, second: Array) -> tuple[Array, Array]:
        """Times (P, S) and speeds (P, S) at the samples of paths (P, S, 3) with two derivatives by any parameter."""
        rate = np.maximum(np.linalg.norm(first, axis=2), _LEAST_M)
        tangent = first / rate[..., None]
        level, climb = np.hypot(tangent[..., 0], tangent[..., 1]), np.abs(tangent[..., 2])
        bend = np.linalg.norm(np.cross(first, second), axis=2) / rate**3
        most = np.minimum(self.level_mps / np.maximum(level, _LEAST_M), self.vertical_mps / np.maximum(climb, _LEAST_M))
        squared = np.minimum(most**2, self.accel_mps2 / np.maximum(bend, _LEAST_M))
        for column, end in ((0, self.scenario.start), (-1, self.scenario.end)):
            squared[:, column] = np.minimum(squared[:, column], float(np.linalg.norm(end.velocity_mps)) ** 2)
        steps_m = np.linalg.norm(np.diff(places_m, axis=1), axis=2)
        along_m = np.concatenate([np.zeros((len(steps_m), 1)), np.cumsum(steps_m, axis=1)], axis=1)
        # v^2 grows by at most 2 a for each metre, forwards from every sample and backwards from every sample.
        gain = 2.0 * self.accel_mps2 * along_m
        squared = gain + np.minimum.accumulate(squared - gain, axis=1)
        squared = np.minimum.accumulate((squared + gain)[:, ::-1], axis=1)[:, ::-1] - gain
        speed = np.sqrt(np.maximum(squared, 0.0))
        took = 2.0 * steps_m / np.maximum(speed[:, 1:] + speed[:, :-1], _LEAST_MPS)
        return np.concatenate([np.zeros((len(took), 1)), np.cumsum(took, axis=1)], axis=1), speed

    def violations(self, places: Array, t_s: Array, load_factor: Array) -> Array:
        """Mean amount by which each constraint is broken along the path (P, 5)."""
        limits = self.scenario.limits
        ground = ground_envelope_m(self.scenario.terrain, places[..., 0], places[..., 1])
        box, near = np.zeros(places.shape[:2]), np.zeros(places.shape[:2])
        for axis, (low, high) in enumerate(self.box):
            box = np.maximum(box, np.maximum(low - places[..., axis], places[..., axis] - high))
        index = (t_s / GRID_S).astype(int)
        for track in self.earlier:
            apart = places - track[np.minimum(index, len(track) - 1)]
            gap = np.sqrt(np.einsum("psc,psc->ps", apart, apart))
            near = np.maximum(near, limits.separation_min_m + _RESERVE_M - gap)
        low_m = limits.clearance_min_m + _RESERVE_M + ground - places[..., 2]
        broken = (low_m, places[..., 2] - limits.height_m[1], box, load_factor - limits.load_factor_max, near)
        return np.stack([np.maximum(part - _ROUNDING, 0.0).mean(axis=1) for part in broken], axis=1)

    def _evaluate(self, x: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
        paths = self.paths(x)
        out["F"], out["G"] = paths[1][:, -1:], self.violations(*paths)


class Found(NamedTuple):
    """The best path: places (T, 3) north, east, height on a grid of 0.05 s until it arrives, and how it was found."""

    track_m: Array
    arrival_s: float
    feasible: bool
    seconds: float


def search(problem: Search, seed: int, generations: int = MOST_GENERATIONS) -> Found:
    """Run a swarm until it converges."""
    began, (low, high) = time.process_time(), problem.bounds()
    start = low + np.random.default_rng(seed).random((PARTICLES, len(low))) * (high - low)
    start[0] = 0.5 * (low + high)  # one on the straight way, half as high as it may
    options = {"adaptive": False, "pertube_best": False, "save_history": False}
    swarm = PSO(pop_size=PARTICLES, sampling=start, w=INERTIA, c1=PULL, c2=PULL, **options)
    swarm.setup(problem, seed=seed, termination=("n_gen", generations), verbose=False)
    best, still = (np.inf, np.inf), 0
    while swarm.has_next() and still < STILL_GENERATIONS:
        swarm.next()
        now = float(swarm.opt[0].CV[0]), float(swarm.opt[0].F[0])
        better = now[0] < best[0] * (1.0 - STILL) if best[0] > 0.0 else now[1] < best[1] * (1.0 - STILL)
        best, still = (now, 0) if better else (best, still + 1)
    places, t_s, _ = problem.paths(np.array([swarm.opt[0].X]))
    seconds, arrival_s = time.process_time() - began, float(t_s[0, -1])
    grid = np.append(np.arange(0.0, arrival_s, GRID_S), arrival_s)
    track = np.stack([np.interp(grid, t_s[0], places[0, :, axis]) for axis in range(3)], axis=1)
    return Found(track, arrival_s, best[0] <= 0.0, seconds)


def fleet(scenario: Scenario, seed: int, generations: int = MOST_GENERATIONS) -> list[Found]:
    """One vehicle after another, with the earlier tracks in its way."""
    found: list[Found] = []
    ends = np.array([scenario.start.position_m, scenario.end.position_m])
    for number, offset in enumerate(offsets_ned_m(scenario) * NED_FROM_UP):
        start_m, goal_m = ends + offset
        problem = Search(scenario, start_m, goal_m, [f.track_m for f in found])
        found.append(search(problem, seed * 1000 + number, generations))
    return found


def together(found: list[Found]) -> Array:
    """Places (V, T, 3) at the same instants; a vehicle that has arrived waits at its end."""
    last = max(len(f.track_m) for f in found)
    return np.stack([f.track_m[np.minimum(np.arange(last), len(f.track_m) - 1)] for f in found])


def slowed_J(scenario: Scenario, found: list[Found]) -> float:
    """Eq. 32 summed over vehicles, each one's way flown at the constant speed that arrives on time."""
    lengths_m = [float(np.linalg.norm(np.diff(f.track_m, axis=0), axis=1).sum()) for f in found]
    return scenario.objective.drag_power_Ns2pm2 * sum(m**3 for m in lengths_m) / scenario.time.flight_s**2


def turn_deg(a_deg: float, b_deg: float) -> float:
    """Angle between two directions."""
    return float(abs((a_deg - b_deg + 180.0) % 360.0 - 180.0))


def row(found: list[Found], scenario: Scenario) -> dict[str, Any]:
    """What a set of tracks amounts to."""
    ends = [f.track_m[-1] - f.track_m[np.linalg.norm(f.track_m - f.track_m[-1], axis=1) > 1.0][-1] for f in found]
    asked, courses_deg = heading_ref_deg(scenario), (np.degrees(np.arctan2(end[1], end[0])) for end in ends)
    grounds = (f.track_m[:, 2] - ground_height_m(scenario.terrain, *f.track_m[:, :2].T) for f in found)
    pairs = itertools.combinations(together(found), 2)
    return {
        "one_s": found[0].seconds,
        "six_s": sum(f.seconds for f in found),
        "feasible": sum(f.feasible for f in found),
        "late_s": max(abs(f.arrival_s - scenario.time.flight_s) for f in found),
        "course_off_deg": max(turn_deg(course, asked) for course in courses_deg),
        "slowed_J": slowed_J(scenario, found),
        "clearance_m": min(float(ground.min()) for ground in grounds),
        "separation_m": min(float(np.linalg.norm(a - b, axis=1).min()) for a, b in pairs),
    }
