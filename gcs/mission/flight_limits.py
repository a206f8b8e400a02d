"""The limits of a mission's flight, and those of a scenario that apply to waypoints."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs.frames import Origin
from gcs.scenario.environment.ground_bounds import Highest, from_heights, highest_ground
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import KeepIn, NoFlyZone, Scenario
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.scenario.values.si import local_origin
from gcs.types import Array

Ground = Callable[[Array, Array], Array]  # height in m above the origin's height, at metres north and east

# Share by which an autopilot's model may exceed a commanded speed: a vehicle behind its target catches up.
OVERSPEED = 0.25
SEPARATION_M = 2.0  # by default: below this, GNSS does not tell two vehicles apart


@dataclass(frozen=True)
class FlightLimits:
    """Limits in SI; None where there is none."""

    separation_m: float = SEPARATION_M
    clearance_m: float = 0.0  # from the ground in any direction, between take-off and landing
    height_max_m: float | None = None  # above the origin's height
    speed_ned_mps: tuple[float, float, float] | None = None
    no_fly: tuple[NoFlyZone, ...] = ()
    leaves_s: float = 0.0  # plan time at which take-off ends; it fixes the position of moving zones
    tolerance_m: float = 0.0  # waypoints may be this far from the plan that was verified against these limits
    overspeed: float = 0.01  # share by which a speed limit may be exceeded
    zone_margin_m: float = 0.0  # from zones
    keep_in: tuple[KeepIn, ...] = ()
    planned_separation_m: float | None = None  # what the plan keeps, for display
    planned_clearance_m: float | None = None


@dataclass(frozen=True)
class Surroundings:
    """The local frame of all flights, and the ground if it is known.

    `bounded` are upper bounds of the ground over rectangles. Without them it is nowhere steeper than `slope_max`.
    """

    origin: Origin
    ground: Ground | None = None
    bounded: Highest | None = None
    slope_max: float = 1.0

    @property
    def highest(self) -> Highest | None:
        """Upper bounds of the ground over rectangles; None if it is unknown."""
        if self.bounded is not None or self.ground is None:
            return self.bounded
        return from_heights(self.ground, self.slope_max)

    def height_of_ground_m(self, ned_m: Array, otherwise_m: float) -> Array:
        """Heights of the ground under points (..., 3), above the origin's height; `otherwise_m` if it is unknown."""
        if self.ground is None:
            return np.full(ned_m.shape[:-1], otherwise_m)
        return np.asarray(self.ground(ned_m[..., 0], ned_m[..., 1]))


def limits_of(scenario: Scenario, separation_m: float | None = None) -> FlightLimits:
    """The limits of a flight along a scenario's waypoints: the judge's separation, and the plan's other limits.

    Legs are straight where the plan is not, so clearance, ceiling and zones are relaxed by the mission's tolerance.
    """
    limits, tolerance_m, phases = scenario.limits, scenario.mission.tolerance_m, scenario.ground_phases
    return FlightLimits(
        judged_separation_m(scenario) if separation_m is None else separation_m,
        max(limits.clearance_min_m - tolerance_m, 0.0),
        limits.height_m[1] + tolerance_m,
        limits.speed_ned_mps,
        scenario.no_fly,
        -(phases.hover_s + (phases.run_up_s if any(scenario.start.velocity_mps) else 0)),
        tolerance_m,
        zone_margin_m=limits.zone_margin_m or 0.0,
        keep_in=scenario.keep_in,
        planned_separation_m=limits.separation_min_m,
        planned_clearance_m=limits.clearance_min_m,
    )


def surroundings_of(scenario: Scenario) -> Surroundings:
    """The local frame and the ground of a scenario."""

    def ground(north_m: Array, east_m: Array) -> Array:
        return ground_height_m(scenario.terrain, north_m, east_m)

    return Surroundings(local_origin(scenario), ground, highest_ground(scenario.terrain))
