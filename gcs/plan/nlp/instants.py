"""Instants between the nodes at which a solve enforces path constraints: where a guess passes zones, and where the
solution before exceeded a limit.

A violation moves along the gap between two nodes while it shrinks. So the whole gap is enforced at once.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.variables import VariableLayout
from gcs.plan.nlp.violations import Violation
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.no_fly import outside_m, zones
from gcs.types import Array

# Beside zones: past a corner that the program rounds off by 0.15 m, a vehicle at 5 m/s flies 0.1 m less deep than
# between instants this far apart. The point of contact moves by so much with the next solution.
_ZONE_EVERY_S, _ZONE_BESIDE_S = 0.25, 1.0
# Of other limits: an eighth of a gap leaves a 64th of the excess.
_EVERY_S, _PARTS = 0.05, 8
_END_PARTS = 4
# From the guess, instants are so near that the flight cannot jump over a wall. A gap is beside a zone within some times
# the way that is flown in it.
_JUMP_M, _BESIDE, _BESIDE_M = 2.0, 3.0, 4.0
_ROUNDED = 6  # digits of a second


def instants_near_zones(problem: Problem, mesh: Mesh, guess: Trajectory) -> Array:
    """Instants (W,) between the nodes where a guess passes beside a zone."""
    stops = _stops_s(mesh)
    places = guess.state(stops)[:, :2]
    away_m = np.full(len(stops), np.inf)
    for zone in zones(problem.scenario):
        away_m = np.minimum(away_m, outside_m(zone, stops, places[:, 0], places[:, 1]))
    way_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    near = np.minimum(away_m[1:], away_m[:-1]) < _BESIDE * way_m + _BESIDE_M
    parts = np.maximum(np.ceil(way_m / _JUMP_M), 1.0)
    return _joined(
        _inside(low, high, (high - low) / count)
        for (low, high), count, kept in zip(pairwise(stops), parts, near, strict=True)
        if kept and count > 1
    )


def instants_at_ends(mesh: Mesh) -> Array:
    """Instants (W,) between the nodes of the first and the last interval, in which rates change fastest."""
    stops, first_s, last_s = _stops_s(mesh), mesh.joints_s[1], mesh.joints_s[-2]
    gaps = [(low, high) for low, high in pairwise(stops) if high <= first_s or low >= last_s]
    return _joined([_inside(low, high, (high - low) / _END_PARTS) for low, high in gaps])


def instants_between(mesh: Mesh, missed: Sequence[Violation]) -> Array:
    """Instants (W,) in the gaps between nodes in which a solution violates something."""
    stops = _stops_s(mesh)
    found = []
    for miss in missed:
        is_zone = miss.constraint.kind is Kind.ZONE
        beside_s = _ZONE_BESIDE_S if is_zone else 0.0
        begin_s, end_s = miss.period_s[0] - beside_s, miss.period_s[1] + beside_s
        found.append(np.array([miss.t_s]))
        for low, high in pairwise(stops):
            if low < end_s and high > begin_s:
                found.append(_inside(low, high, _ZONE_EVERY_S if is_zone else max((high - low) / _PARTS, _EVERY_S)))
    return _joined(found)


def _stops_s(mesh: Mesh) -> Array:
    """Instants at which the program has all its rows: nodes, and joints, where states are bounded."""
    return np.union1d(VariableLayout(mesh).node_times_s(), mesh.joints_s)


def _inside(low_s: float, high_s: float, every_s: float) -> Array:
    parts = max(int(np.ceil((high_s - low_s) / every_s - 1e-9)), 2)
    return low_s + (high_s - low_s) * np.arange(1, parts) / parts


def _joined(parts: Iterator[Array] | Sequence[Array]) -> Array:
    """Once each, also those that differ in the last bits."""
    return np.unique(np.round(np.concatenate([np.zeros(0), *parts]), _ROUNDED))
