"""The ground beside the vertical ways of a flight: from its pad to the end of the take-off, and of its landing.

There a vehicle is near the ground, so it cannot keep the clearance of the flight. As in plans, the distance must be a
quarter of the height above the pad, less 0.25 m, and of the clearance at most: slopes are allowed, a wall is not. The
way from the take-off to the first waypoint belongs to the flight (`flight_checks.check_ground`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.mission.check.between_samples import clearance_along
from gcs.mission.check.findings import Finding, Level, Rule
from gcs.mission.check.flight_checks import LENGTH_TOLERANCE_M
from gcs.mission.check.flight_limits import FlightLimits
from gcs.mission.check.item_checks import found
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.predicted.planned_flight import PredictedFlight, Surroundings
from gcs.physics.quadrotor import Array
from gcs.plan.verification.constraints.ground_clearance import PAD_FREE_M, PAD_SHARE
from gcs.scenario.environment.ground_bounds import Highest

_STEP = 1.05  # of height, from one part of a vertical way to the next
_SUNK_M = 0.5  # home below the ground by rounding, or by a pad that a map leaves out


@dataclass(frozen=True)
class _Column:
    """A vertical way over a place that stands on the ground."""

    what: str
    north_east_m: Array  # (2,)
    foot_m: float  # heights of its lower and its upper end
    top_m: float
    foot_s: float
    top_s: float
    item: int

    def when_s(self, above_m: float) -> float:
        """The time at a height above its foot, at constant speed."""
        return self.foot_s + above_m / (self.top_m - self.foot_m) * (self.top_s - self.foot_s)


def check_pads(
    mission: MissionFile, flight: PredictedFlight, around: Surroundings, limits: FlightLimits
) -> Iterator[Finding]:
    """Errors for ground beside the take-off or the landing, and a warning for a home below the ground."""
    if around.highest is None:
        return
    sunk_m = float(around.height_of_ground_m(flight.ned_m[0], 0.0) + flight.ned_m[0, 2])
    if sunk_m > _SUNK_M:
        message = f"home is {sunk_m:.2f} m below the ground; altitudes above home are too low by as much"
        yield found(mission, Rule.TERRAIN, Level.WARNING, message)
    for column in _columns(flight, around):
        yield from _beside(mission, column, around.highest, limits)


def _columns(flight: PredictedFlight, around: Surroundings) -> Iterator[_Column]:
    """The vertical ways of a flight that leads up from its pad, or down to the ground."""
    last = len(flight.t_s) - 1
    up = int(np.searchsorted(flight.t_s, flight.up_s, side="left"))
    down = int(np.searchsorted(flight.t_s, flight.down_s, side="right")) - 1
    ways = [("pad", 0, min(up, last))]
    if np.isfinite(flight.ends_s):
        ways.append(("landing point", last, down))
    for what, foot, top in ways:
        foot_m = max(-float(flight.ned_m[foot, 2]), float(around.height_of_ground_m(flight.ned_m[foot], 0.0)))
        top_m = -float(flight.ned_m[top, 2])
        if top_m > foot_m:
            times = float(flight.t_s[foot]), float(flight.t_s[top])
            yield _Column(what, flight.ned_m[foot, :2], foot_m, top_m, *times, int(flight.item[max(foot, top)]))


def _beside(mission: MissionFile, column: _Column, highest: Highest, limits: FlightLimits) -> Iterator[Finding]:
    """An error for a part of a vertical way that is too near: those with the highest ground beside them come first."""
    low_m = np.geomspace(PAD_FREE_M, max(column.top_m - column.foot_m, PAD_FREE_M), _parts(column))
    low_m, high_m = low_m[:-1], low_m[1:]
    asked_m = PAD_SHARE * np.minimum(low_m - PAD_FREE_M, limits.clearance_m) - LENGTH_TOLERANCE_M
    near_m = column.north_east_m + np.zeros((len(low_m), 1))
    half_m = np.maximum(asked_m, 0.0)
    over_m = column.foot_m + low_m - highest(near_m - half_m[:, None], near_m + half_m[:, None])
    near = np.flatnonzero((asked_m > 0.0) & (over_m < asked_m))
    for part in near[np.argsort(over_m[near] - asked_m[near])].tolist():
        begin, end = (
            np.array([[*column.north_east_m, -(column.foot_m + float(height_m[part]))]]) for height_m in (low_m, high_m)
        )
        bound = clearance_along(highest, begin, end, float(asked_m[part]), slack=np.zeros(1), duration_s=np.ones(1))
        if bound.verdict != "proved":
            above_m, required_m = float(low_m[part]), float(asked_m[part]) + LENGTH_TOLERANCE_M
            message = (
                f"{max(bound.least, 0.0):.2f} m from the ground beside the {column.what}, {above_m:.1f} m above it; "
                f"at least {required_m:.2f} m required"
            )
            yield found(mission, Rule.TERRAIN, Level.ERROR, message, column.item, column.when_s(above_m))
            return


def _parts(column: _Column) -> int:
    """The number of heights that part a vertical way."""
    ratio = max((column.top_m - column.foot_m) / PAD_FREE_M, 1.0)
    return 2 + int(np.log(ratio) / np.log(_STEP))
