"""A few vehicles that stand for all in a mean over the formation, as Gauss nodes stand for an interval.

Where the formation turns, shrinks or leans in sheared wind, every vehicle has a velocity of its own. The energy of each
(Eqs. 30-32) is smooth in its offset. So weights are chosen such that the mean of every polynomial in the offsets, up to
a degree, is exact. A formation of few vehicles is represented by all of them; a thousand cost no more than about forty.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.optimize import nnls

from gcs.plan.formation.coordinates import Coordinate, bent
from gcs.plan.formation.shape import Rows, Shape
from gcs.types import Array

NUMBERS = 6  # of one representative at an instant: base offset (3) and its rate (3)
_MOST = 40  # moments, unless degree 2 has more
_DEGREES = (4, 3, 2)
_RANK = 1e-9  # of the largest singular value
_NO_WEIGHT = 1e-12


@dataclass(frozen=True)
class Representatives:
    """Vehicles whose weighted sum is the mean over the formation."""

    rows: Rows  # (S,), the leader first
    weights: Array  # (S,), of sum 1; the leader's is that of any vehicle
    target_ned_m: Array  # (S, 3) offsets to which a blend leads

    def numbers(self, shape: Shape, t_s: Array) -> Array:
        """Scheduled offsets and their rates (6 S, N) at instants (N,)."""
        parts = [shape.offsets(t_s, order, self.rows) for order in (0, 1)]  # (S, N, 3) each
        return np.ascontiguousarray(np.concatenate(parts, axis=2).transpose(0, 2, 1).reshape(-1, len(t_s)))


def representatives(tables_ned_m: Array, target_ned_m: Array, leader: int) -> Representatives:
    """The few vehicles, with weights, whose mean cost is that of all V.

    It holds where offsets are combinations of the tables (K, V, 3) and of the target (V, 3).
    """
    vehicles = len(target_ned_m)
    every = np.concatenate([*tables_ned_m, target_ned_m], axis=1)  # (V, 3 (K + 1))
    left, sizes, _ = np.linalg.svd(every - every.mean(axis=0), full_matrices=False)
    axes = left[:, sizes > _RANK * max(float(sizes[0]), _RANK)] * np.sqrt(vehicles)
    powers = next(m for d in _DEGREES if len(m := _monomials(axes.shape[1], d)) <= _MOST or d == _DEGREES[-1])
    followers = np.delete(np.arange(vehicles), leader)
    if vehicles <= len(powers) + 1:
        chosen, weights = followers, np.full(len(followers), 1.0 / vehicles)
    else:
        moments = np.array([np.prod(axes**power, axis=1) for power in powers])  # (m, V)
        found, _ = nnls(moments[:, followers], moments.mean(axis=1) - moments[:, leader] / vehicles)
        used = found > _NO_WEIGHT
        chosen, weights = followers[used], found[used]
    rows = np.concatenate([[leader], chosen]).astype(np.intp)
    return Representatives(rows, np.concatenate([[1.0 / vehicles], weights]), target_ned_m[rows])


def motion(
    coordinates: Sequence[Coordinate], chains: Sequence[ca.SX], numbers: Sequence[ca.SX], target_ned_m: Array
) -> tuple[ca.SX, ca.SX]:
    """Offset (3) and its rate (3) of a representative, from the chains of the coordinates and its numbers (symbols)."""
    base, rate = ca.vertcat(*numbers[:3]), ca.vertcat(*numbers[3:])
    if not coordinates:
        return base, rate
    values = ca.vertcat(*chains[::4])
    named = {c.name: chains[4 * i] for i, c in enumerate(coordinates)}
    place = ca.vertcat(*bent(named, list(numbers[:3]), target_ned_m.tolist(), ca))
    speed = ca.jtimes(place, values, ca.vertcat(*chains[1::4])) + ca.jtimes(place, base, rate)
    return place, speed


def _monomials(axes: int, degree: int) -> list[Array]:
    """Exponents (axes,) of all monomials up to a degree."""
    chosen = (c for d in range(degree + 1) for c in itertools.combinations_with_replacement(range(axes), d))
    return [np.bincount(np.array(c, dtype=int), minlength=axes).astype(np.float64) for c in chosen]
