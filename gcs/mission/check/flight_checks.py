"""Checks of predicted flights: separation, ground clearance, ceiling, speed limits, no-fly zones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.check.flight_limits import FlightLimits
from gcs.mission.check.item_checks import found
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.predicted.closest_approach import Closest, closest_approach
from gcs.mission.predicted.planned_flight import PredictedFlight, Surroundings
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.no_fly import outside_m

_STEP_M = 0.5  # between samples of the ground
_SAMPLES_MAX = 400_000  # of a flight; a mistyped degree makes a leg of 100 km
_LENGTH_TOLERANCE_M = 0.01  # rounding by degE7 and float32
_BELOW_HOME_M = 0.5
_SAME_PLACE_M = 0.03  # two places differ by less through rounding alone


@dataclass(frozen=True)
class Lowest:
    """The least clearance of a flight between take-off and landing, and when."""

    clearance_m: float
    t_s: float
    item: int


def check_separation(
    missions: Sequence[MissionFile], flights: Sequence[PredictedFlight], limits: FlightLimits
) -> tuple[Closest | None, list[Finding]]:
    """The nearest two vehicles, and an error if they are below the required separation."""
    closest = closest_approach(flights, math.inf)
    if closest is None or closest.distance_m >= limits.separation_m:
        return closest, []
    first, second = (missions[row] for row in closest.pair)
    item = _item_at(flights[closest.pair[0]], closest.t_s)
    message = (
        f"{closest.distance_m:.2f} m from the vehicle of {second.source}; at least {limits.separation_m:g} m required"
    )
    return closest, [found(first, Rule.SEPARATION, Level.ERROR, message, item, closest.t_s)]


def check_ground(
    mission: MissionFile, flight: PredictedFlight, around: Surroundings, limits: FlightLimits
) -> tuple[Lowest | None, list[Finding]]:
    """The least clearance between take-off and landing, and an error if it is below the limit."""
    track = _track(flight)
    if track is None:
        return None, []
    points, t_s, items = track
    if around.ground is None:
        return None, list(_below_home(mission, flight, points, t_s, items))
    clearance = -points[:, 2] - around.height_of_ground_m(points, 0.0)
    at = int(np.argmin(clearance))
    lowest = Lowest(float(clearance[at]), float(t_s[at]), int(items[at]))
    if lowest.clearance_m >= limits.clearance_m - _LENGTH_TOLERANCE_M:
        return lowest, []
    if lowest.clearance_m < 0:
        message = f"flies into the ground, {-lowest.clearance_m:.2f} m below its surface"
    else:
        message = f"{lowest.clearance_m:.2f} m above the ground; at least {limits.clearance_m:g} m required"
    return lowest, [found(mission, Rule.TERRAIN, Level.ERROR, message, lowest.item, lowest.t_s)]


def check_limits(mission: MissionFile, flight: PredictedFlight, limits: FlightLimits) -> Iterator[Finding]:
    """Errors for violations of ceiling, speed limits and no-fly zones."""
    track = _track(flight)
    if track is None:
        return
    points, t_s, items = track
    if limits.height_max_m is not None:
        at = int(np.argmin(points[:, 2]))
        over_m = -points[at, 2] - limits.height_max_m
        if over_m > _LENGTH_TOLERANCE_M:
            message = f"{over_m:.2f} m above the ceiling of {limits.height_max_m:g} m"
            yield found(mission, Rule.HEIGHT, Level.ERROR, message, int(items[at]), float(t_s[at]))
    yield from _speeds(mission, flight, limits)
    for number, zone in enumerate(limits.no_fly, start=1):
        inside_m = -outside_m(zone, t_s - flight.up_s + limits.leaves_s, points[:, 0], points[:, 1])
        at = int(np.argmax(inside_m))
        if inside_m[at] > limits.tolerance_m + _LENGTH_TOLERANCE_M:
            message = f"{inside_m[at]:.2f} m inside no-fly zone {number}"
            yield found(mission, Rule.AREA, Level.ERROR, message, int(items[at]), float(t_s[at]))


def _speeds(mission: MissionFile, flight: PredictedFlight, limits: FlightLimits) -> Iterator[Finding]:
    if limits.speed_ned_mps is None:
        return
    leg_s = np.diff(flight.t_s)
    far = np.linalg.norm(np.diff(flight.ned_m, axis=0), axis=1) > _SAME_PLACE_M
    moving = far & (leg_s > 0) & (flight.t_s[:-1] >= flight.up_s) & (flight.t_s[1:] <= flight.down_s)
    speeds = np.abs(np.diff(flight.ned_m, axis=0))[moving] / leg_s[moving, None]
    legs = np.flatnonzero(moving)
    for axis, name in enumerate(("north", "east", "vertically")):
        most = limits.speed_ned_mps[axis]
        if len(legs) and speeds[:, axis].max() > most * (1 + limits.overspeed):
            leg = int(np.argmax(speeds[:, axis]))
            message = f"{speeds[leg, axis]:.2f} m/s {name}; limit {most:g} m/s"
            at = legs[leg] + 1
            yield found(mission, Rule.SPEED, Level.ERROR, message, int(flight.item[at]), float(flight.t_s[at]))


def _below_home(
    mission: MissionFile, flight: PredictedFlight, points: Array, t_s: Array, items: Array
) -> Iterator[Finding]:
    """A warning for a flight below its start, where only the ground at home is known."""
    above_m = flight.ned_m[0, 2] - points[:, 2]
    at = int(np.argmin(above_m))
    if above_m[at] < -_BELOW_HOME_M:
        message = f"{-above_m[at]:.1f} m below the start and the ground is unknown; give --terrain SCENARIO to check it"
        yield found(mission, Rule.TERRAIN, Level.WARNING, message, int(items[at]), float(t_s[at]))


def _track(flight: PredictedFlight) -> tuple[Array, Array, Array] | None:
    """Points (N, 3) between take-off and landing, their times and items; None if it does not leave the take-off.

    Points are half a metre apart, or farther where more than `_SAMPLES_MAX` would be needed.
    """
    first = int(np.searchsorted(flight.t_s, flight.up_s, side="left"))
    last = int(np.searchsorted(flight.t_s, flight.down_s, side="right"))
    knots = np.arange(first, last)
    if not len(knots):
        return None
    lengths_m = np.hypot(*np.diff(flight.ned_m[knots, :2], axis=0).T)
    step_m = max(_STEP_M, float(lengths_m.sum()) / _SAMPLES_MAX)
    pieces = np.maximum(np.ceil(lengths_m / step_m).astype(int), 1)
    shares = [knot + np.arange(n) / n for knot, n in zip(knots[:-1].tolist(), pieces.tolist(), strict=True)]
    where = np.concatenate([*shares, [float(knots[-1])]])
    points = np.stack([np.interp(where, knots, flight.ned_m[knots, axis]) for axis in range(3)], axis=-1)
    items = flight.item[np.minimum(np.ceil(where).astype(int), knots[-1])]
    return points, np.interp(where, knots, flight.t_s[knots]), items


def _item_at(flight: PredictedFlight, t_s: float) -> int:
    """Index of the item that the vehicle carries out at `t_s`."""
    knot = min(int(np.searchsorted(flight.t_s, t_s, side="left")), len(flight.t_s) - 1)
    return int(flight.item[knot])
