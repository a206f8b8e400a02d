"""Checks of predicted flights: separation, ground clearance, ceiling, speed limits, no-fly zones.

Every check holds at every instant of a flight. What is neither proved nor violated at 1 ms or 1 mm is an error too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.mission.check.between_samples import clearance_along, outside_along, parts_beside
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.check.item_checks import found
from gcs.mission.flight_limits import FlightLimits, Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.predicted.closest_approach import Closest, closest_approach
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.plan.verification.proof.verdict import ProofVerdict
from gcs.scenario.environment.no_fly import ZoneName, zone_names, zones
from gcs.types import Array

LENGTH_TOLERANCE_M = 0.01  # rounding by degE7 and float32
_BELOW_HOME_M = 0.5
_FOOT_M = 0.3048
_SAME_PLACE_M = 0.03  # two places differ by less through rounding alone


@dataclass(frozen=True)
class Lowest:
    """The least clearance of a flight between take-off and landing, and when; at no instant is it below `proved_m`."""

    clearance_m: float
    t_s: float
    item: int
    proved_m: float = -math.inf


@dataclass(frozen=True)
class _Track:
    """The straight pieces of a flight between take-off and landing: begins and ends (N, 3), times, items, bends."""

    begin_m: Array
    end_m: Array
    begin_s: Array
    end_s: Array
    items: NDArray[np.intp]  # (N, 2) of both ends
    bent_m: Array
    fastest_mps: Array

    @classmethod
    def of(cls, flight: PredictedFlight) -> _Track | None:
        """The track; None if the flight does not leave the take-off."""
        first = int(np.searchsorted(flight.t_s, flight.up_s, side="left"))
        last = int(np.searchsorted(flight.t_s, flight.down_s, side="right")) - 1
        if last < first:
            return None
        begin, end = np.arange(first, max(last, first + 1)), np.arange(first + 1, max(last, first + 1) + 1)
        end = np.minimum(end, last)  # one knot alone is a piece of no length
        pieces = np.minimum(begin, len(flight.bent_m) - 1)
        alone = last == first or not len(flight.bent_m)
        items = np.stack([flight.item[begin], flight.item[end]], axis=1).astype(np.intp)
        bent_m = np.zeros(1) if alone else flight.bent_m[pieces]
        fastest_mps = np.zeros((1, 3)) if alone else flight.fastest_mps[pieces]
        ends = flight.ned_m[begin], flight.ned_m[end], flight.t_s[begin], flight.t_s[end]
        return cls(*ends, items, bent_m, fastest_mps)

    @property
    def duration_s(self) -> Array:
        """Durations (N,) of the pieces."""
        return self.end_s - self.begin_s

    def when(self, piece: int, share: float) -> tuple[int, float]:
        """Item and time of a share of a piece."""
        item = int(self.items[piece, int(share > 0.0)])
        return item, float(self.begin_s[piece] + share * self.duration_s[piece])

    @property
    def highest(self) -> tuple[float, int, float]:
        """The greatest height, m, with its item and time."""
        up_m = np.maximum(-self.begin_m[:, 2], -self.end_m[:, 2]) + self.bent_m
        at = int(np.argmax(up_m))
        return float(up_m[at]), *self.when(at, float(self.end_m[at, 2] < self.begin_m[at, 2]))


def check_separation(
    missions: Sequence[MissionFile], flights: Sequence[PredictedFlight], limits: FlightLimits
) -> tuple[Closest | None, list[Finding]]:
    """The nearest two vehicles, and an error if they are below the required separation."""
    closest = closest_approach(flights, math.inf, limits.separation_m)
    if closest is None or closest.proved_m >= limits.separation_m:
        return closest, []
    first, second = (missions[row] for row in closest.pair)
    flight = flights[closest.pair[0]]
    knot = min(int(np.searchsorted(flight.t_s, closest.t_s, side="left")), len(flight.t_s) - 1)
    item = int(flight.item[knot])
    required = f"at least {limits.separation_m:g} m required"
    if closest.distance_m < limits.separation_m:
        message = f"{closest.distance_m:.2f} m from the vehicle of {second.source}; {required}"
    else:
        message = f"proved only {closest.proved_m:.3f} m from the vehicle of {second.source}; {required}"
    return closest, [found(first, Rule.SEPARATION, Level.ERROR, message, item, closest.t_s)]


def check_ground(
    mission: MissionFile, flight: PredictedFlight, around: Surroundings, limits: FlightLimits
) -> tuple[Lowest | None, list[Finding]]:
    """The least clearance between take-off and landing, and an error if it is below the limit."""
    track = _Track.of(flight)
    if track is None:
        return None, []
    if around.highest is None:
        return None, list(_below_home(mission, flight, track))
    required_m = limits.clearance_m - LENGTH_TOLERANCE_M
    bound = clearance_along(
        around.highest, track.begin_m, track.end_m, required_m, slack=track.bent_m, duration_s=track.duration_s
    )
    item, t_s = track.when(bound.piece, bound.share)
    lowest = Lowest(bound.least, t_s, item, bound.proved)
    if bound.verdict is ProofVerdict.PROVED:
        return lowest, []
    if lowest.clearance_m < 0:
        message = f"flies into the ground, {-lowest.clearance_m:.2f} m below its surface"
    elif bound.verdict is ProofVerdict.VIOLATED:
        message = f"{lowest.clearance_m:.2f} m above the ground; at least {limits.clearance_m:g} m required"
    else:
        message = f"proved only {bound.proved:.3f} m above the ground; at least {limits.clearance_m:g} m required"
    return lowest, [found(mission, Rule.TERRAIN, Level.ERROR, message, item, t_s)]


@dataclass(frozen=True)
class ZoneDistance:
    """The least distance of a flight to a zone, and when; at no instant is it below `proved_m`."""

    zone: ZoneName
    distance_m: float
    proved_m: float
    t_s: float


def check_limits(mission: MissionFile, flight: PredictedFlight, limits: FlightLimits) -> Iterator[Finding]:
    """Errors for violations of ceiling and speed limits."""
    track = _Track.of(flight)
    if track is None:
        return
    if limits.height_max_m is not None:
        up_m, item, t_s = track.highest
        over_m = up_m - limits.height_max_m
        if over_m > LENGTH_TOLERANCE_M:
            message = f"{over_m:.2f} m above the ceiling of {limits.height_max_m:g} m"
            if _FOOT_M * up_m <= limits.height_max_m:
                message += f". Is it in feet? {up_m:.0f} ft are {_FOOT_M * up_m:.1f} m"
            yield found(mission, Rule.HEIGHT, Level.ERROR, message, item, t_s)
    yield from _speeds(mission, track, limits)


def highest_m(flight: PredictedFlight) -> tuple[float, float] | None:
    """The greatest height between take-off and landing, and when; None for a flight that does not leave it."""
    track = _Track.of(flight)
    return None if track is None else track.highest[::2]


def check_zones(
    mission: MissionFile, flight: PredictedFlight, limits: FlightLimits
) -> tuple[ZoneDistance | None, list[Finding]]:
    """The zone that a flight passes nearest, and an error for each that it passes too near."""
    track = _Track.of(flight)
    if track is None:
        return None, []
    required_m = limits.zone_margin_m - limits.tolerance_m
    nearest: ZoneDistance | None = None
    findings = []
    for name, zone in zip(zone_names(limits), zones(limits), strict=True):
        shift_s = limits.leaves_s - flight.up_s
        parts = parts_beside(zone, track.begin_m, track.end_m, *(track.begin_s + shift_s, track.end_s + shift_s))
        bound = outside_along(zone, parts, required_m - LENGTH_TOLERANCE_M, slack=track.bent_m[parts.piece])
        piece, share = parts.whole(bound.piece, bound.share)
        item, t_s = track.when(piece, share)
        if nearest is None or bound.least < nearest.distance_m:
            nearest = ZoneDistance(name, bound.least, bound.proved, t_s)
        if bound.verdict is ProofVerdict.PROVED:
            continue
        least_m = bound.proved if bound.verdict is ProofVerdict.UNDECIDED else bound.least
        allowed, forbidden = ("inside", "outside") if name.keep_in else ("outside", "inside")
        if least_m >= 0.0:
            message = f"{least_m:.2f} m from {name.edge}; at least {required_m:g} m required"
        elif bound.verdict is ProofVerdict.UNDECIDED:
            message = f"not proved {allowed} {name}: perhaps {-least_m:.3f} m {forbidden}"
        else:
            message = f"{-least_m:.2f} m {forbidden} {name}"
        findings.append(found(mission, Rule.AREA, Level.ERROR, message, item, t_s))
    return nearest, findings


def _speeds(mission: MissionFile, track: _Track, limits: FlightLimits) -> Iterator[Finding]:
    if limits.speed_ned_mps is None:
        return
    far = np.linalg.norm(track.end_m - track.begin_m, axis=1) > _SAME_PLACE_M
    moving = far & (track.duration_s > 0)
    speeds = np.where(moving[:, None], track.fastest_mps, 0.0)
    for axis, name in enumerate(("north", "east", "vertically")):
        most = limits.speed_ned_mps[axis]
        leg = int(np.argmax(speeds[:, axis]))
        if speeds[leg, axis] > most * (1 + limits.overspeed):
            message = f"{speeds[leg, axis]:.2f} m/s {name}; limit {most:g} m/s"
            yield found(mission, Rule.SPEED, Level.ERROR, message, *track.when(leg, 1.0))


def _below_home(mission: MissionFile, flight: PredictedFlight, track: _Track) -> Iterator[Finding]:
    """A warning for a flight below its start, where only the ground at home is known."""
    above_m = flight.ned_m[0, 2] - np.stack([track.begin_m[:, 2], track.end_m[:, 2]], axis=1)
    piece, end = np.unravel_index(np.argmin(above_m), above_m.shape)
    if above_m[piece, end] < -_BELOW_HOME_M:
        below_m = float(-above_m[piece, end])
        message = f"{below_m:.1f} m below the start and the ground is unknown; give --terrain SCENARIO to check it"
        yield found(mission, Rule.TERRAIN, Level.WARNING, message, *track.when(int(piece), float(end)))
