"""The active vehicles at each instant: the few whose constraints can bind there.

They are chosen by their distance to ground and zones, with the leader at its last known place and a little beside it.
So a thousand vehicles cost no more constraints than a few. `violations` checks all vehicles after each solve; the next
choice then includes what this one missed.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.plan.formation.coordinates import bent
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.scenario.environment.clearance_floor import FEET, coarse_floor_m, ground_feet_m, lift_m
from gcs.scenario.environment.convex_pieces import Disk, Piece
from gcs.scenario.environment.no_fly import Zone, displacement_m, pieces, zone_names, zones
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.values.si import ground_needed
from gcs.types import Array

NEAR_GROUND, NEAR_ZONE = 6, 3  # active vehicles of each kind at one instant
# Numbers of one active vehicle: base offset (3), its rate (3), its acceleration (3), offset that it blends to (3). Near
# a no-fly zone, the displacement (2) of the zone; for a spare disk, the position of its centre (2) and its radius. Near
# the ground, the place of the ground's nearest point (2) beside the vehicle's and the height to keep over that point.
SLOT = 15
LINE = 21  # numbers of a drawn line: `LegLine.parameters`
MOVED, RADIUS = slice(12, 14), 14
FOOT, LIFT = slice(12, 14), 14
_ASIDE_M = 8.0  # the next solution may pass so far from the last one
_DIRECTIONS = 4

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class ActiveVehicles:
    """Rows of the active vehicles at T instants, and their motion in the shape."""

    ground: Rows  # (T, G): each vehicle FEET times in turn
    zones: tuple[Rows, ...]  # one (T, D) for every piece of a zone
    moving: Rows  # (T, M)
    moving_used: NDArray[np.bool_]  # (T, M): false where another row is the same constraint
    leaning: NDArray[np.bool_]  # (T, M): whether the row's tilt may differ from the leader's because of its wind
    legs: Rows  # (T,) index of the drawn line that the leader keeps to; -1: none
    parameters: Array  # (T, (G + sum D + M) * SLOT), and where lines are drawn LINE of the leg's


def active_vehicles(problem: Problem, times_s: Array, states: Array) -> ActiveVehicles:
    """The active vehicles at `times_s` (T,), for the last known states (T, nx) there."""
    base = problem.shape.offsets(times_s)
    places = offsets_at(problem, base, states)
    ground = _near_ground(problem, places, states)
    beside = zone_pieces(problem)
    moved = [displacement_m(zone, times_s) for _, zone, _ in beside]
    near = tuple(_near_piece(places, states, piece, away) for (_, _, piece), away in zip(beside, moved, strict=True))
    moving, used = _moving(problem, times_s, base)
    motion = [base, problem.shape.offsets(times_s, 1), problem.shape.offsets(times_s, 2)]
    target = np.broadcast_to(problem.target_ned_m[:, None], base.shape)
    every = np.concatenate([*motion, target, np.zeros((*base.shape[:2], 3))], axis=2)  # (V, T, SLOT)
    rows = np.hstack([ground, *near, moving])
    parameters = every[rows, np.arange(len(times_s))[:, None]]
    first = ground.shape[1]
    parameters[:, :first, FOOT.start :] = _feet(problem, places, states, ground)
    for chosen, away in zip(near, moved, strict=True):
        parameters[:, first : first + chosen.shape[1], MOVED] = away[:, None]
        first += chosen.shape[1]
    leaning = (moving != problem.leader) & problem.winds_differ
    parameters, legs = parameters.reshape(len(times_s), -1), np.full(len(times_s), -1)
    if problem.lines:
        legs = problem.leg_of(times_s)
        drawn = [line.parameters for line in problem.lines]
        parameters = np.hstack([parameters, np.array([*drawn, np.zeros(LINE)])[legs]])
    return ActiveVehicles(ground, near, moving, used, leaning, legs, parameters)


def zone_pieces(problem: Problem) -> list[tuple[ConstraintId, Zone, Piece]]:
    """The pieces of all zones that the flight can reach, each with its constraint and its zone."""
    region = ground_needed(problem.scenario)
    places = np.array(list(itertools.product(region.north_m, region.east_m)))
    found: list[tuple[ConstraintId, Zone, Piece]] = []
    for name, zone in zip(zone_names(problem.scenario), zones(problem.scenario), strict=True):
        every = pieces(zone)
        for part, piece in enumerate(every, start=1):
            # A half-plane may have no place in the region; other pieces count as reached.
            bounded = isinstance(piece, Disk) or piece.corners_m
            if bounded or piece.outside_m(places[:, 0], places[:, 1]).min() < 0.0:
                found.append((ConstraintId(Kind.ZONE, of=name, part=part if len(every) > 1 else 0), zone, piece))
    return found


def offsets_at(problem: Problem, base: Array, states: Array) -> Array:
    """Offsets (V, T, 3): the scheduled ones (V, T, 3), transformed by the coordinates in `states` (T, nx)."""
    if not problem.coordinates:
        return base
    values = {c.name: states[:, 12 + 4 * i] for i, c in enumerate(problem.coordinates)}
    target = problem.target_ned_m[:, None]
    return np.stack(bent(values, tuple(np.moveaxis(base, 2, 0)), tuple(np.moveaxis(target, 2, 0))), axis=-1)


def _near_ground(problem: Problem, places: Array, states: Array) -> Rows:
    if problem.vehicles <= NEAR_GROUND:
        return np.repeat(np.tile(np.arange(problem.vehicles, dtype=np.intp), (len(states), 1)), FEET, axis=1)
    terrain = problem.scenario.terrain
    up = -(places[..., 2] + states[:, 2])
    north, east = (places[..., i] + states[:, i] for i in (0, 1))
    spare = [up - coarse_floor_m(terrain, north, east, _kept_m(problem))]
    for aside in _ASIDE_M * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]):
        north, east = (places[..., i] + states[:, i] + aside[i] for i in (0, 1))
        spare.append(up - ground_envelope_m(terrain, north, east) - _kept_m(problem))
    return np.repeat(_most_urgent(np.stack(spare), NEAR_GROUND), FEET, axis=1)


def _feet(problem: Problem, places: Array, states: Array, ground: Rows) -> Array:
    """The ground's nearest points (T, G, 2) beside the vehicles, and the heights to keep over them: (T, G, 3)."""
    instants, kept_m = np.arange(len(states))[:, None], _kept_m(problem)
    at = places[ground[:, ::FEET], instants] + states[:, None, :3]
    feet = np.moveaxis(ground_feet_m(problem.scenario.terrain, at[..., 0], at[..., 1], kept_m), 0, 2)
    feet = feet.reshape(*ground.shape, 2)
    return np.concatenate([feet, lift_m(feet, kept_m)[..., None]], axis=2)


def _kept_m(problem: Problem) -> float:
    """The distance to the ground that the nodes keep."""
    return problem.scenario.limits.clearance_min_m + problem.clearance_reserve_m


def _near_piece(places: Array, states: Array, piece: Piece, moved_m: Array) -> Rows:
    count = min(len(places), NEAR_ZONE)
    spare = []
    for aside in _ASIDE_M * np.array([[0, 0], [1, 0], [0, 1]]):
        north, east = (places[..., i] + states[:, i] + aside[i] - moved_m[:, i] for i in (0, 1))
        spare.append(piece.outside_m(north, east))
    return _most_urgent(np.stack(spare), count)


def _most_urgent(spare: Array, count: int) -> Rows:
    """Rows (T, count) by `spare` (S, V, T): the least of each of S positions, then the next of the first position."""
    worst = spare.argmin(axis=1)  # (S, T)
    ranked = np.argsort(spare[0], axis=0)[: count + len(spare)]  # (>= count, T)
    chosen = np.empty((spare.shape[2], count), dtype=np.intp)
    for t in range(spare.shape[2]):
        order = dict.fromkeys([*worst[:, t].tolist(), *ranked[:, t].tolist()])
        chosen[t] = list(order)[:count]
    return chosen


def _moving(problem: Problem, times_s: Array, base: Array) -> tuple[Rows, NDArray[np.bool_]]:
    """Rows whose motion differs most from the leader's, after the leader; the leader alone where it stands for all.

    In a wind that grows with height, the highest and the lowest vehicle are among them.
    """
    shape = problem.shape
    if not problem.coordinates and not shape.apart_s(problem.quadrotor.wind):
        leader = np.full((len(times_s), 1), problem.leader, dtype=np.intp)
        return leader, np.ones_like(leader, dtype=bool)
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    if problem.coordinates and problem.has_heights:  # else these are bounds of the leader
        directions = np.hstack([directions, [[0.0, 0.0], [0.0, 0.0], [1.0, -1.0]]])
    if not problem.coordinates and not shape.moving_s:
        directions = directions[:, :0]  # all accelerate alike
    extremes = [base[..., 2].argmin(axis=0), base[..., 2].argmax(axis=0)] if problem.winds_differ else []
    count = min(1 + directions.shape[1] + len(extremes), problem.vehicles)
    # Coordinates move the outermost vehicles most.
    criterion = base if problem.coordinates else shape.offsets(times_s, 2) + shape.offsets(times_s, 1)
    reach = np.einsum("vtk,kd->dvt", criterion, directions)
    worst = np.vstack([*extremes, reach.argmax(axis=1)])  # (extremes and directions, T)
    chosen = np.empty((len(times_s), count), dtype=np.intp)
    every_row = range(problem.vehicles)
    for t in range(len(times_s)):
        order = dict.fromkeys([problem.leader, *worst[:, t].tolist(), *every_row[: 2 * count]])
        chosen[t] = list(order)[:count]
    used = np.ones_like(chosen, dtype=bool)
    if not problem.coordinates:
        rigid = ~np.any(np.abs(shape.offsets(times_s, 1)) + np.abs(shape.offsets(times_s, 2)) > 0, axis=(0, 2))
        used[rigid, 1:] = False
    return chosen, used
