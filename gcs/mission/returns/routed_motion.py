"""The motion of returns that the ground station flies: brake, climb, follow the route around its corners, descend.

It is made of pieces of constant acceleration, so that it is exact between its knots. Many returns are computed at once;
a flight uses the same functions for one.
"""

from dataclasses import dataclass

import numpy as np

from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.types import Array

ACCEL_MPS2 = 1.5  # a fifth of what a tilt of 60 degrees gives: any multicopter is able to
CORNER_M = 0.5  # a corner is cut by this much or less
_SHARP_MPS2 = 3.0  # to brake before a zone: a tilt of 17 degrees
# Ways to brake: deceleration, and sideways motion as a share of what ACCEL_MPS2 allows. The first one that is clear.
_BRAKES = ((ACCEL_MPS2, 0.0), *((ACCEL_MPS2, s * q) for q in (0.25, 0.5, 1.0) for s in (1, -1)))
_SHARP_BRAKES = ((_SHARP_MPS2, 0.0), *((_SHARP_MPS2, s * q) for q in (0.5, 1.0) for s in (1, -1)))


@dataclass(frozen=True)
class PiecewiseMotion:
    """Knots of N motions, between which the acceleration is constant; vehicles rest after the last one.

    `times_s` (N, K) count from the start; `places` and `velocities` are (N, K, 3) in NED.
    """

    times_s: Array
    places: Array
    velocities: Array

    def places_at(self, t_s: Array) -> Array:
        """Positions (N, I, 3) at times (N, I) since the start."""
        count = self.times_s.shape[1]
        rows = zip(self.times_s, t_s, strict=True)
        piece = np.stack([knots.searchsorted(looks, side="right") for knots, looks in rows])
        piece = np.clip(piece, 1, count - 1) - 1 + count * np.arange(len(t_s))[:, None]
        times_s, places, speeds = self.times_s.reshape(-1), self.places.reshape(-1, 3), self.velocities.reshape(-1, 3)
        begin_s, end_s = times_s[piece], times_s[piece + 1]
        passed_s = np.clip(t_s - begin_s, 0.0, end_s - begin_s)
        part = passed_s**2 / np.maximum(2 * (end_s - begin_s), 1e-9)  # of the change of velocity
        return np.asarray(
            places[piece] + speeds[piece] * (passed_s - part)[..., None] + speeds[piece + 1] * part[..., None]
        )


class _Knots:
    """Collects knots of N motions, piece by piece."""

    def __init__(self, places: Array, velocities: Array) -> None:
        self._times, self._places, self._velocities = [np.zeros(len(places))], [places], [velocities]

    def add(self, duration_s: Array, velocities: Array, places: Array | None = None) -> None:
        """A piece that ends with these velocities (N, 3). Its end follows from both velocities if it is not given."""
        if places is None:
            places = self._places[-1] + (self._velocities[-1] + velocities) / 2 * duration_s[:, None]
        self._times.append(self._times[-1] + duration_s)
        self._places.append(places)
        self._velocities.append(velocities)

    def straight(self, ends: Array, directions: Array, speeds: tuple[Array, Array], top_mps: float) -> None:
        """Pieces to `ends` along `directions` (N, 3), from one speed (N,) to another, at `top_mps` or less."""
        first, last = speeds
        length = np.einsum("ij,ij->i", ends - self._places[-1], directions)
        peak = np.minimum(top_mps, np.sqrt(np.maximum(ACCEL_MPS2 * length + (first**2 + last**2) / 2, 0.0)))
        peak = np.maximum(peak, np.maximum(first, last))
        slow = (2 * peak**2 - first**2 - last**2) / (2 * ACCEL_MPS2)
        even_s = np.maximum(length - slow, 0.0) / np.maximum(peak, 1e-9)
        self.add((peak - first) / ACCEL_MPS2, peak[:, None] * directions)
        self.add(even_s, peak[:, None] * directions)
        self.add((peak - last) / ACCEL_MPS2, last[:, None] * directions, ends)

    def motion(self) -> PiecewiseMotion:
        return PiecewiseMotion(*(np.stack(part, axis=1) for part in (self._times, self._places, self._velocities)))


@dataclass(frozen=True)
class Stops:
    """How N vehicles brake: their places and velocities half way, their places at rest, and durations (N,)."""

    places: Array
    velocities: Array
    half_ned_m: Array
    half_ned_mps: Array
    end_ned_m: Array
    duration_s: Array


def stops(places: Array, velocities: Array, t_s: Array, routes: ReturnRoutes) -> Stops:
    """Brake N vehicles, straight on where that enters no zone and keeps inside the fence; else sideways or harder."""
    best = _stop(places, velocities, *_BRAKES[0])
    depth_m = routes.depth_m(_tracks(best), t_s)
    rows = np.flatnonzero(depth_m > 0.0)
    for brake in (*_BRAKES[1:], *_SHARP_BRAKES) if len(rows) else ():
        other = _stop(places[rows], velocities[rows], *brake)
        other_m = routes.depth_m(_tracks(other), t_s[rows])
        better = other_m < depth_m[rows]
        depth_m[rows[better]] = other_m[better]
        for name in ("half_ned_m", "half_ned_mps", "end_ned_m", "duration_s"):
            getattr(best, name)[rows[better]] = getattr(other, name)[better]
        rows = rows[depth_m[rows] > 0.0]
        if not len(rows):
            break
    return best


def routed_motion(
    stop: Stops, ways_m: Array, top_down_m: Array, end_down_m: Array, speeds: ReturnSpeeds
) -> PiecewiseMotion:
    """The motions of N returns: ways (N, W, 2) begin where vehicles stop, at heights top_down_m (N,), and end there.

    They end at `end_down_m` (N,), and do not wait before they descend.
    """
    zero, up = np.zeros(len(ways_m)), np.array([[0.0, 0.0, -1.0]])
    knots = _Knots(stop.places, stop.velocities)
    knots.add(stop.duration_s / 2, stop.half_ned_mps, stop.half_ned_m)
    knots.add(stop.duration_s / 2, np.zeros_like(stop.places), stop.end_ned_m)
    # Ways (N, W, 2) without legs of no length but at their ends
    moved = np.any(ways_m[:, 1:] != ways_m[:, :-1], axis=2)
    order = np.argsort(~np.column_stack([np.ones(len(ways_m), dtype=bool), moved]), axis=1, kind="stable")
    count = 1 + moved.sum(axis=1)
    kept = np.take_along_axis(ways_m, order[..., None], axis=1)
    kept = np.where((np.arange(ways_m.shape[1]) < count[:, None])[..., None], kept, ways_m[:, -1:])
    ways_m = np.asarray(kept[:, : max(2, int(count.max()))])
    tops = np.broadcast_to(top_down_m[:, None, None], (*ways_m.shape[:2], 1))
    points = np.concatenate([ways_m, tops], axis=2)
    knots.straight(points[:, 0], up, (zero, zero), speeds.climb_mps)
    _follow(knots, points, speeds.cruise_mps)
    low = np.column_stack([points[:, -1, :2], np.maximum(end_down_m, top_down_m)])
    knots.straight(low, -up, (zero, zero), speeds.sink_mps)
    return knots.motion()


def _follow(knots: _Knots, points: Array, cruise_mps: float) -> None:
    """Follow ways (N, W, 3) and cut their corners, as fast as `ACCEL_MPS2` allows."""
    legs = np.diff(points, axis=1)
    lengths = np.linalg.norm(legs, axis=2)
    along = legs / np.maximum(lengths, 1e-12)[..., None]
    shorter = np.minimum(lengths[:, :-1], lengths[:, 1:])
    turn = np.linalg.norm(along[:, 1:] - along[:, :-1], axis=2) / 2  # the sine of half the angle
    turn = np.where(shorter > 0.0, np.maximum(turn, 1e-9), 1.0)
    cut = np.minimum(np.minimum(2 * CORNER_M / turn, shorter / 2), cruise_mps**2 * turn / ACCEL_MPS2)
    speed = np.zeros((len(points), points.shape[1]))
    speed[:, 1:-1] = np.minimum(cruise_mps, np.sqrt(ACCEL_MPS2 * cut / turn))
    around = np.zeros_like(speed)
    around[:, 1:-1] = cut
    free = 2 * ACCEL_MPS2 * np.maximum(lengths - around[:, :-1] - around[:, 1:], 0.0)
    for leg in range(lengths.shape[1]):
        speed[:, leg + 1] = np.minimum(speed[:, leg + 1], np.sqrt(speed[:, leg] ** 2 + free[:, leg]))
    for leg in reversed(range(lengths.shape[1])):
        speed[:, leg] = np.minimum(speed[:, leg], np.sqrt(speed[:, leg + 1] ** 2 + free[:, leg]))
    for leg in range(lengths.shape[1]):
        enter, out = speed[:, leg], speed[:, leg + 1]
        knots.straight(
            points[:, leg + 1] - around[:, leg + 1, None] * along[:, leg], along[:, leg], (enter, out), cruise_mps
        )
        if leg + 1 < lengths.shape[1]:
            duration_s = 2 * around[:, leg + 1] / np.maximum(out, 1e-9)
            knots.add(
                np.where(out > 0.0, duration_s, 0.0),
                out[:, None] * along[:, leg + 1],
                points[:, leg + 1] + around[:, leg + 1, None] * along[:, leg + 1],
            )


def _stop(places: Array, velocities: Array, brake_mps2: float, sideways: float) -> Stops:
    duration_s = np.linalg.norm(velocities, axis=1) / brake_mps2
    level_mps = np.linalg.norm(velocities[:, :2], axis=1)
    right = np.column_stack([-velocities[:, 1], velocities[:, 0], np.zeros(len(places))])
    right /= np.maximum(level_mps, 1e-9)[:, None]
    aside = right * (sideways * ACCEL_MPS2 * duration_s**2 / 4)[:, None]
    run = velocities * duration_s[:, None] / 2
    half_mps = velocities / 2 + 2 * aside / np.maximum(duration_s, 1e-9)[:, None]
    half, end = places + 0.75 * run + aside / 2, places + run + aside
    return Stops(places, velocities, half, half_mps, end, duration_s)


def _tracks(stop: Stops) -> Array:
    """Tracks (N, 3, 2) over ground."""
    return np.stack([stop.places[:, :2], stop.half_ned_m[:, :2], stop.end_ned_m[:, :2]], axis=1)
