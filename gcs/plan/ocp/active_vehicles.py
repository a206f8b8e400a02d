"""Which vehicles the optimiser watches at which instant: those that can bind there, however many fly along.

Knows: how near every vehicle is to ground and zones where the leader was last seen, and a little beside it. Does not
know: solvers. A thousand vehicles cost no more constraints than a few; what this choice misses, the look at every
vehicle between solves finds, and the next choice has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import Array
from gcs.plan.formation.coordinates import bent
from gcs.plan.ocp.problem import Problem
from gcs.scenario.environment.no_fly import Piece, displacement_m, pieces
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.scenario.schema.scenario import NoFlyZone

NEAR_GROUND, NEAR_ZONE = 6, 3  # vehicles watched at one instant, of each kind
# Numbers that describe one watched vehicle: base offset, its rate, its acceleration, where it blends to; and how far
# the zone that it is watched for has moved. Of a spare disk: where its centre is, and its radius.
SLOT = 15
MOVED, RADIUS = slice(12, 14), 14
_ASIDE_M = 8.0  # the next solution passes that far from the last one
_DIRECTIONS = 4

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class ActiveVehicles:
    """Rows of the watched vehicles at T instants, and their motion in the shape."""

    ground: Rows  # (T, G)
    zones: tuple[Rows, ...]  # one (T, D) for every piece of a no-fly zone
    moving: Rows  # (T, M)
    moving_used: NDArray[np.bool_]  # (T, M): false where another row says the same
    parameters: Array  # (T, (G + sum D + M) * SLOT)


def active_vehicles(problem: Problem, times_s: Array, states: Array) -> ActiveVehicles:
    """Choose for `times_s` (T,), given the last known states (T, nx) there."""
    base = problem.shape.offsets(times_s)
    places = offsets_at(problem, base, states)
    ground = _near_ground(problem, places, states)
    moved = [displacement_m(zone, times_s) for zone, _ in zone_pieces(problem)]
    zones = tuple(
        _near_piece(places, states, piece, away) for (_, piece), away in zip(zone_pieces(problem), moved, strict=True)
    )
    moving, used = _moving(problem, times_s, base)
    motion = [base, problem.shape.offsets(times_s, 1), problem.shape.offsets(times_s, 2)]
    target = np.broadcast_to(problem.target_ned_m[:, None], base.shape)
    every = np.concatenate([*motion, target, np.zeros((*base.shape[:2], 3))], axis=2)  # (V, T, SLOT)
    rows = np.hstack([ground, *zones, moving])
    parameters = every[rows, np.arange(len(times_s))[:, None]]
    first = ground.shape[1]
    for chosen, away in zip(zones, moved, strict=True):
        parameters[:, first : first + chosen.shape[1], MOVED] = away[:, None]
        first += chosen.shape[1]
    return ActiveVehicles(ground, zones, moving, used, parameters.reshape(len(times_s), -1))


def zone_pieces(problem: Problem) -> list[tuple[NoFlyZone, Piece]]:
    """Every piece of every no-fly zone, with its zone."""
    return [(zone, piece) for zone in problem.scenario.no_fly for piece in pieces(zone)]


def offsets_at(problem: Problem, base: Array, states: Array) -> Array:
    """Offsets (V, T, 3) that the coordinates in `states` (T, nx) make of the scheduled ones (V, T, 3)."""
    if not problem.coordinates:
        return base
    values = {c.name: states[:, 12 + 4 * i] for i, c in enumerate(problem.coordinates)}
    target = problem.target_ned_m[:, None]
    return np.stack(bent(values, tuple(np.moveaxis(base, 2, 0)), tuple(np.moveaxis(target, 2, 0))), axis=-1)


def _near_ground(problem: Problem, places: Array, states: Array) -> Rows:
    if problem.vehicles <= NEAR_GROUND:
        return _everyone(problem, len(states))
    terrain = problem.scenario.terrain
    spare = []
    for aside in _ASIDE_M * np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]]):
        north, east = (places[..., i] + states[:, i] + aside[i] for i in (0, 1))
        spare.append(-(places[..., 2] + states[:, 2]) - ground_envelope_m(terrain, north, east))
    return _most_urgent(np.stack(spare), NEAR_GROUND)


def _near_piece(places: Array, states: Array, piece: Piece, moved_m: Array) -> Rows:
    count = min(len(places), NEAR_ZONE)
    spare = []
    for aside in _ASIDE_M * np.array([[0, 0], [1, 0], [0, 1]]):
        north, east = (places[..., i] + states[:, i] + aside[i] - moved_m[:, i] for i in (0, 1))
        spare.append(piece.outside_m(north, east))
    return _most_urgent(np.stack(spare), count)


def _most_urgent(spare: Array, count: int) -> Rows:
    """Rows (T, count) by `spare` (S, V, T): the worst of each of S possibilities, then the next worst of the first."""
    worst = spare.argmin(axis=1)  # (S, T)
    ranked = np.argsort(spare[0], axis=0)[: count + len(spare)]  # (>= count, T)
    chosen = np.empty((spare.shape[2], count), dtype=np.intp)
    for t in range(spare.shape[2]):
        order = dict.fromkeys([*worst[:, t].tolist(), *ranked[:, t].tolist()])
        chosen[t] = list(order)[:count]
    return chosen


def _moving(problem: Problem, times_s: Array, base: Array) -> tuple[Rows, NDArray[np.bool_]]:
    """Vehicles whose own motion differs most from the leader's; the leader first, the only one in a rigid formation."""
    shape = problem.shape
    if not problem.coordinates and not shape.moving_s:
        leader = np.full((len(times_s), 1), problem.leader, dtype=np.intp)
        return leader, np.ones_like(leader, dtype=bool)
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    ways = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    if problem.coordinates and problem.has_heights:  # else the leader's bounds know who is highest
        ways = np.hstack([ways, [[0.0, 0.0], [0.0, 0.0], [1.0, -1.0]]])
    count = min(1 + ways.shape[1], problem.vehicles)
    # Where the shape moves by itself, what is far out moves most.
    criterion = base if problem.coordinates else shape.offsets(times_s, 2) + shape.offsets(times_s, 1)
    reach = np.einsum("vtk,kd->dvt", criterion, ways)
    worst = reach.argmax(axis=1)  # (directions, T)
    chosen = np.empty((len(times_s), count), dtype=np.intp)
    everyone = range(problem.vehicles)
    for t in range(len(times_s)):
        order = dict.fromkeys([problem.leader, *worst[:, t].tolist(), *everyone[: 2 * count]])
        chosen[t] = list(order)[:count]
    used = np.ones_like(chosen, dtype=bool)
    if not problem.coordinates:
        rigid = ~np.any(np.abs(shape.offsets(times_s, 1)) + np.abs(shape.offsets(times_s, 2)) > 0, axis=(0, 2))
        used[rigid, 1:] = False
    return chosen, used


def _everyone(problem: Problem, instants: int) -> Rows:
    return np.tile(np.arange(problem.vehicles, dtype=np.intp), (instants, 1))
