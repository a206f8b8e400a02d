"""A standard particle swarm plans one vehicle's path, as in §4.3: the shortest time, other tracks as obstacles.

Knows: pymoo, a path as a cubic spline through points beside the straight line, and which constraints it has. Does not
know: attitudes, controls or when it should arrive: a path has none of them. What the search sees of the ground is what
our optimiser sees, its smooth envelope; verdicts are given elsewhere, over the exact ground.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.core.problem import Problem
from scipy.interpolate import make_interp_spline

from gcs.physics.quadrotor import Array
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.schema.scenario import Scenario
from tools.paper.speed_model import fastest, path_limits

POINTS = 8  # of a path, between its ends
SAMPLES = 401
PARTICLES = 80
INERTIA, PULL = 0.7298, 1.49618  # Clerc and Kennedy's constriction
STILL, STILL_GENERATIONS = 1e-4, 60  # converged: so many generations without so much gain
MOST_GENERATIONS = 3000
_ASIDE_M = 300.0
_GRID_S = 0.05
_RESERVE_M = 0.03  # ours keeps as much
_ROUNDING = 1e-9  # of a spline: ends on the edge of the box are inside


@dataclass(frozen=True)
class Paths:
    """P paths at S points: places (P, S, 3) north, east, height; times as fast as the speed model allows."""

    places_m: Array
    t_s: Array  # (P, S)
    load_factor: Array  # (P, S)


class Basis:
    """Cubic splines over fixed knots as matrices: from points (P, K + 2, 3) to samples and derivatives."""

    def __init__(self) -> None:
        knots = np.linspace(0.0, 1.0, POINTS + 2)
        spline = make_interp_spline(knots, np.eye(POINTS + 2), k=3, bc_type="natural")
        at = np.linspace(0.0, 1.0, SAMPLES)
        self.matrices = tuple(np.asarray(spline(at, order)) for order in range(3))  # (S, K + 2) each


class Search(Problem):  # type: ignore[misc]  # pymoo has no types
    """Distance aside and height of every point; least time; ground, ceiling, box, turning, earlier tracks."""

    def __init__(self, scenario: Scenario, start_m: Array, goal_m: Array, earlier: list[Array]) -> None:
        low, high = scenario.limits.height_m
        self.scenario, self.earlier = scenario, earlier
        self.ends = np.array([start_m, goal_m])
        self.basis, self.limits = Basis(), path_limits(scenario)
        super().__init__(
            n_var=2 * POINTS,
            n_obj=1,
            n_ieq_constr=5,
            xl=np.r_[np.full(POINTS, -_ASIDE_M), np.full(POINTS, low)],
            xu=np.r_[np.full(POINTS, _ASIDE_M), np.full(POINTS, high)],
        )

    @cached_property
    def line(self) -> tuple[Array, Array]:
        """The straight way's points (K, 2) and the direction (2,) aside."""
        way = self.ends[1, :2] - self.ends[0, :2]
        shares = np.linspace(0.0, 1.0, POINTS + 2)[1:-1, None]
        return self.ends[0, :2] + shares * way, np.array([-way[1], way[0]]) / np.linalg.norm(way)

    def first(self, seed: int) -> Array:
        """Where the particles begin (P, 2 K): anywhere, but for one on the straight way, half as high as it may."""
        low, high = self.xl, self.xu
        places = low + np.random.default_rng(seed).random((PARTICLES, self.n_var)) * (high - low)
        places[0] = 0.5 * (low + high)
        return np.asarray(places)

    def paths(self, x: Array) -> Paths:
        """Of particles (P, 2 K)."""
        along, aside = self.line
        points = np.empty((len(x), POINTS + 2, 3))
        points[:, 0], points[:, -1] = self.ends
        points[:, 1:-1, :2] = along + x[:, :POINTS, None] * aside
        points[:, 1:-1, 2] = x[:, POINTS:]
        places, first, second = (np.matmul(matrix, points) for matrix in self.basis.matrices)  # (P, S, 3)
        t_s, speed = fastest(places, first, second, self.limits)
        cross = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
        level = np.maximum(np.hypot(first[..., 0], first[..., 1]), 1e-6)
        return Paths(places, t_s, speed**2 * cross / level**3 / self.scenario.vehicle.gravity_mps2)

    def violations(self, paths: Paths) -> Array:
        """Mean amount by which each constraint is broken along the path (P, 5)."""
        scenario, places = self.scenario, paths.places_m
        limits = scenario.limits
        ground = ground_envelope_m(scenario.terrain, places[..., 0], places[..., 1])
        box = np.zeros(places.shape[:2])
        for axis, (low, high) in enumerate(self._box):
            np.maximum(box, low - places[..., axis], out=box)
            np.maximum(box, places[..., axis] - high, out=box)
        near = np.zeros(places.shape[:2])
        index = (paths.t_s / _GRID_S).astype(int)
        for track in self.earlier:
            apart = places - track[np.minimum(index, len(track) - 1)]
            gap = np.sqrt(np.einsum("psc,psc->ps", apart, apart))
            np.maximum(near, limits.separation_min_m + _RESERVE_M - gap, out=near)
        broken = (
            limits.clearance_min_m + _RESERVE_M + ground - places[..., 2],
            places[..., 2] - limits.height_m[1],
            box,
            paths.load_factor - limits.load_factor_max,
            near,
        )
        return np.stack([np.maximum(part - _ROUNDING, 0.0).mean(axis=1) for part in broken], axis=1)

    @cached_property
    def _box(self) -> list[tuple[float, float]]:
        """The box of Eq. 51, and this vehicle's ends, which the paper places outside of it."""
        limits = self.scenario.limits
        return [
            (min(low, *self.ends[:, axis]), max(high, *self.ends[:, axis]))
            for axis, (low, high) in enumerate((limits.north_m, limits.east_m))
        ]

    def _evaluate(self, x: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
        paths = self.paths(x)
        out["F"] = paths.t_s[:, -1:]
        out["G"] = self.violations(paths)


@dataclass(frozen=True)
class Found:
    """The best path: places (T, 3) on a grid of 0.05 s from t = 0 until it arrives, and how it was found."""

    track_m: Array
    arrival_s: float
    feasible: bool
    seconds: float
    generations: int


def search(problem: Search, seed: int, limit_s: float = np.inf) -> Found:
    """Run a swarm until it converges or its time, that of the processor, is over."""
    began = time.process_time()
    swarm = PSO(
        pop_size=PARTICLES,
        sampling=problem.first(seed),
        w=INERTIA,
        c1=PULL,
        c2=PULL,
        adaptive=False,
        pertube_best=False,
        save_history=False,
    )
    swarm.setup(problem, seed=seed, termination=("n_gen", MOST_GENERATIONS), verbose=False)
    best, still = (np.inf, np.inf), 0
    while swarm.has_next() and still < STILL_GENERATIONS and time.process_time() - began < limit_s:
        swarm.next()
        now = float(swarm.opt[0].CV[0]), float(swarm.opt[0].F[0])
        better = now[0] < best[0] * (1.0 - STILL) if best[0] > 0.0 else now[1] < best[1] * (1.0 - STILL)
        best, still = (now, 0) if better else (best, still + 1)
    paths = problem.paths(np.array([swarm.opt[0].X]))
    seconds = time.process_time() - began
    arrival_s = float(paths.t_s[0, -1])
    grid = np.append(np.arange(0.0, arrival_s, _GRID_S), arrival_s)
    track = np.stack([np.interp(grid, paths.t_s[0], paths.places_m[0, :, axis]) for axis in range(3)], axis=1)
    return Found(track, arrival_s, best[0] <= 0.0, seconds, int(swarm.n_gen))
