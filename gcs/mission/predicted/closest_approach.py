"""The least distance of vehicles whose motion is straight at constant speed between knots: exact, for many vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gcs.mission.machine_independent import EQUAL, first_least
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.physics.quadrotor import Array

Rows = NDArray[np.intp]

_ALL_PAIRS = 60  # vehicles; of more, a tree finds the near pairs
_LONGEST_S = 1.0  # of a time interval, for the tree
_ALIKE_S = 0.02  # instants nearer than this are merged in large fleets


@dataclass(frozen=True)
class Closest:
    """The least distance, its time, and its two vehicles (rows of the flights given)."""

    distance_m: float
    t_s: float
    pair: tuple[int, int]


def closest_approach(flights: Sequence[PredictedFlight], below_m: float = np.inf) -> Closest | None:
    """The least distance of any two flights while at least one of them is in the air.

    Pairs that stay farther apart than `below_m` may be left out. None for a single vehicle, or if no pair comes nearer.
    """
    if len(flights) < 2:
        return None
    ends = np.array([min(f.ends_s, float(f.t_s[-1])) for f in flights])
    starts = np.array([_lift_off_s(f) for f in flights])
    instants = _instants(flights)
    if len(instants) < 2:
        return None
    places = np.stack([_at(f, instants) for f in flights])  # (V, I, 3)
    airborne = (starts[:, None] < instants[1:]) & (ends[:, None] > instants[:-1])  # (V, I - 1)
    if len(flights) <= _ALL_PAIRS:
        first, second = np.triu_indices(len(flights), 1)
        return _nearest(places, instants, airborne, first, second, None)
    best: Closest | None = None
    for piece in range(len(instants) - 1):
        limit = below_m if best is None else min(below_m, best.distance_m - EQUAL)
        pairs = _near_pairs(places[:, piece], places[:, piece + 1], limit)
        if len(pairs):
            found = _nearest(
                places[:, piece : piece + 2],
                instants[piece : piece + 2],
                airborne[:, piece : piece + 1],
                pairs[:, 0],
                pairs[:, 1],
                limit,
            )
            best = found or best
    return best


def least_distance(start: Array, end: Array) -> tuple[Array, Array]:
    """The least length of a vector (..., 3) moving evenly from `start` to `end`, and the share at which it is least."""
    change = end - start
    squared = np.maximum(np.sum(change * change, axis=-1), 1e-30)
    share = np.clip(-np.sum(start * change, axis=-1) / squared, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[..., None] * change, axis=-1)), np.asarray(share)


def _nearest(
    places: Array, instants: Array, airborne: NDArray[np.bool_], first: Rows, second: Rows, below_m: float | None
) -> Closest | None:
    between = places[second] - places[first]  # (P, I, 3)
    distance, share = least_distance(between[:, :-1], between[:, 1:])
    distance = np.where(airborne[first] | airborne[second], distance, np.inf)
    pair, piece = np.unravel_index(first_least(distance), distance.shape)
    least = float(distance.min())
    if not np.isfinite(least) or (below_m is not None and least >= below_m):
        return None
    t_s = instants[piece] + share[pair, piece] * (instants[piece + 1] - instants[piece])
    return Closest(least, float(t_s), (int(first[pair]), int(second[pair])))


def _near_pairs(start: Array, end: Array, limit_m: float) -> Rows:
    """Pairs (P, 2) that may come within the limit while all move evenly from start to end (V, 3)."""
    if not np.isfinite(limit_m):
        distance, _ = KDTree(start).query(start, k=2)
        limit_m = float(distance[:, 1].min())
    moved = end - start
    own = np.linalg.norm(moved - moved.mean(axis=0), axis=1).max()
    # Only motion relative to the others can bring a vehicle nearer to them.
    return np.asarray(KDTree(start).query_pairs(limit_m + 2.0 * own + 1e-9, output_type="ndarray"))


def _instants(flights: Sequence[PredictedFlight]) -> Array:
    """All knots of all flights, in order."""
    instants = np.unique(np.concatenate([f.t_s for f in flights]))
    if len(flights) <= _ALL_PAIRS or len(instants) < 2:
        return instants
    kept = instants[np.append(True, np.diff(np.floor(instants / _ALIKE_S)) > 0)]
    kept = np.union1d(kept, instants[[0, -1]])
    steps = np.ceil(np.diff(kept) / _LONGEST_S).astype(int)
    parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(kept[:-1], kept[1:], steps, strict=True)]
    return np.concatenate([*parts, kept[-1:]])


def _at(flight: PredictedFlight, t_s: Array) -> Array:
    """Positions (I, 3) at instants."""
    return np.stack([np.interp(t_s, flight.t_s, flight.ned_m[:, axis]) for axis in range(3)], axis=-1)


def _lift_off_s(flight: PredictedFlight) -> float:
    """The time at which the vehicle first moves."""
    moved = np.flatnonzero(np.any(flight.ned_m != flight.ned_m[0], axis=1))
    return float(flight.t_s[moved[0] - 1]) if len(moved) else np.inf
