"""The least distance of vehicles whose motion is straight at constant speed between knots: exact, for many vehicles.

Flights that are bent between their knots (`PredictedFlight.bent_m`) are that much nearer at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gcs.mission.machine_independent import EQUAL, first_least
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.types import Array

Rows = NDArray[np.intp]

_ALL_PAIRS = 60  # vehicles; of more, a tree finds the near pairs
_ANEW_MAX = 2000  # pairs
_LONGEST_S = 1.0  # of a time interval, for the tree
_ALIKE_S = 0.02  # instants nearer than this are merged in large fleets


@dataclass(frozen=True)
class Closest:
    """The least distance, its time, and its two vehicles (rows of the flights given).

    No two vehicles are nearer than `proved_m`, also where flights are bent between their knots.
    """

    distance_m: float
    t_s: float
    pair: tuple[int, int]
    proved_m: float = -np.inf


def closest_approach(
    flights: Sequence[PredictedFlight], below_m: float = np.inf, required_m: float = -np.inf
) -> Closest | None:
    """The least distance of any two flights while at least one of them is in the air.

    Pairs that stay farther apart than `below_m` may be left out. None for a single vehicle, or if no pair comes nearer.
    Pairs of a large fleet that cannot be proved to be `required_m` apart are computed anew, from all their knots.
    """
    if len(flights) < 2:
        return None
    instants = _instants(flights)
    if len(instants) < 2:
        return None
    fleet = _Fleet.of(flights, instants)
    if len(flights) <= _ALL_PAIRS:
        first, second = np.triu_indices(len(flights), 1)
        found, _ = _nearest(fleet, slice(None), first, second)
        return found
    best: Closest | None = None
    proved_m, unclear = np.inf, set[tuple[int, int]]()
    for piece in range(len(instants) - 1):
        reach_m = fleet.bent_m[:, piece].max()
        limit_m = below_m if best is None else min(below_m, best.distance_m)
        pairs = _near_pairs(fleet.places[:, piece], fleet.places[:, piece + 1], limit_m + 2.0 * reach_m)
        if not len(pairs):
            continue
        found, low_m = _nearest(fleet, slice(piece, piece + 1), pairs[:, 0], pairs[:, 1])
        least_m = below_m if best is None else min(best.distance_m - EQUAL, below_m)
        if found is not None and found.distance_m < least_m:
            best = found
        short = low_m < required_m
        unclear |= set(map(tuple, pairs[short].tolist()))
        proved_m = min(proved_m, float(np.min(low_m[~short], initial=np.inf)))
    if unclear and len(unclear) <= _ANEW_MAX:
        for i, j in sorted(unclear):
            again = closest_approach((flights[i], flights[j]))
            if again is not None:
                proved_m = min(proved_m, again.proved_m)
                if again.distance_m < (np.inf if best is None else best.distance_m):
                    best = Closest(again.distance_m, again.t_s, (i, j))
    elif unclear:
        proved_m = -np.inf
    return None if best is None else replace(best, proved_m=min(proved_m, best.distance_m))


@dataclass(frozen=True)
class _Fleet:
    """Places (V, I, 3) at instants (I,); between them vehicles may be `bent_m` (V, I - 1) beside straight pieces."""

    instants: Array
    places: Array
    bent_m: Array
    airborne: NDArray[np.bool_]  # (V, I - 1)

    @classmethod
    def of(cls, flights: Sequence[PredictedFlight], instants: Array) -> _Fleet:
        ends = np.array([min(f.ends_s, float(f.t_s[-1])) for f in flights])
        starts = np.full(len(flights), np.inf)  # when vehicles first move
        for row, flight in enumerate(flights):
            if len(moved := np.flatnonzero(np.any(flight.ned_m != flight.ned_m[0], axis=1))):
                starts[row] = flight.t_s[moved[0] - 1]
        airborne = (starts[:, None] < instants[1:]) & (ends[:, None] > instants[:-1])
        places = np.stack([_at(f, instants) for f in flights])
        bent_m = np.stack([_bent_m(f, instants, own) for f, own in zip(flights, places, strict=True)])
        return cls(instants, places, bent_m, airborne)


def _bent_m(flight: PredictedFlight, instants: Array, places: Array) -> Array:
    """How far (I - 1,) a flight is from straight pieces between instants: its own bends, and knots left out."""
    found = np.zeros(len(instants) - 1)
    if not len(flight.bent_m):
        return found
    knots = flight.t_s
    # The own pieces that an interval between two instants meets: their largest bend, by a running maximum of few.
    first = np.clip(np.searchsorted(knots, instants[:-1], side="right") - 1, 0, len(knots) - 2)
    last = np.clip(np.searchsorted(knots, instants[1:], side="left") - 1, 0, len(knots) - 2)
    for step in range(int((last - first).max(initial=0)) + 1):
        found = np.maximum(found, flight.bent_m[np.minimum(first + step, last)])
    outside = (instants[1:] <= knots[0]) | (instants[:-1] >= knots[-1])
    found[outside] = 0.0
    missing = np.flatnonzero(~np.isin(knots, instants))
    if len(missing):
        straight = np.stack([np.interp(knots[missing], instants, places[:, axis]) for axis in range(3)], axis=-1)
        away_m = np.linalg.norm(flight.ned_m[missing] - straight, axis=1)
        left_out = np.zeros_like(found)
        where = np.clip(np.searchsorted(instants, knots[missing]) - 1, 0, len(found) - 1)
        np.maximum.at(left_out, where, away_m)
        found = found + left_out
    return found


def least_distance(start: Array, end: Array) -> tuple[Array, Array]:
    """The least length of a vector (..., A) moving evenly from `start` to `end`, and the share at which it is least."""
    change = end - start
    squared = np.maximum(_product(change, change), 1e-30)
    share = np.clip(-_product(start, change) / squared, 0.0, 1.0)
    nearest = start + share[..., None] * change
    return np.sqrt(_product(nearest, nearest)), np.asarray(share)


def _product(a: Array, b: Array) -> Array:
    """The scalar products (...) of vectors (..., A): NumPy's sums over so short an axis take several times as long."""
    found = a[..., 0] * b[..., 0]
    for axis in range(1, a.shape[-1]):
        found = found + a[..., axis] * b[..., axis]
    return np.asarray(found)


def _nearest(fleet: _Fleet, pieces: slice, first: Rows, second: Rows) -> tuple[Closest | None, Array]:
    """The nearest of these pairs (P,) on some pieces, and for each a distance (P,) that it is never below."""
    begins = np.arange(len(fleet.instants) - 1)[pieces]
    between = fleet.places[second][:, begins] - fleet.places[first][:, begins]  # (P, I, 3)
    after = fleet.places[second][:, begins + 1] - fleet.places[first][:, begins + 1]
    distance, share = least_distance(between, after)
    flying = fleet.airborne[first][:, pieces] | fleet.airborne[second][:, pieces]
    distance = np.where(flying, distance, np.inf)
    low_m = (distance - fleet.bent_m[first][:, pieces] - fleet.bent_m[second][:, pieces]).min(axis=1)
    pair, piece = np.unravel_index(first_least(distance), distance.shape)
    least = float(distance.min())
    if not np.isfinite(least):
        return None, low_m
    at = begins[piece]
    t_s = fleet.instants[at] + share[pair, piece] * (fleet.instants[at + 1] - fleet.instants[at])
    return Closest(least, float(t_s), (int(first[pair]), int(second[pair])), float(low_m.min())), low_m


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
