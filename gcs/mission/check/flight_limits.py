"""What a mission's flight must hold, as far as it is known.

Knows: which of a scenario's limits can be asked of waypoints. Does not know: missions, where limits come from else.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.mission.predicted.planned_flight import Surroundings
from gcs.physics.quadrotor import Array
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.scenario.si import local_origin

# What models of autopilots fly beyond a speed that was asked for, as a share: who is behind the target catches up.
OVERSPEED = 0.25
SEPARATION_M = 2.0  # where nobody says otherwise: what GNSS can tell apart


@dataclass(frozen=True)
class FlightLimits:
    """Limits in SI; None where there is none."""

    separation_m: float = SEPARATION_M
    clearance_m: float = 0.0  # above the ground, on the way
    height_max_m: float | None = None  # above the origin's height
    speed_ned_mps: tuple[float, float, float] | None = None
    no_fly: tuple[NoFlyZone, ...] = ()
    leaves_s: float = 0.0  # plan time at which take-off ends: when a moving zone is where
    tolerance_m: float = 0.0  # how far waypoints may be from the plan that held these limits
    overspeed: float = 0.01  # share of a speed limit that may be flown beyond it


def limits_of(scenario: Scenario, separation_m: float | None = None) -> FlightLimits:
    """What the flight of a scenario's waypoints must hold: the judge's separation, else the plan's limits.

    Legs are straight where the plan is not, so ground, ceiling and zones are asked for less the mission's tolerance.
    """
    limits, tolerance_m = scenario.limits, scenario.mission.tolerance_m
    return FlightLimits(
        scenario.judge.separation_min_m if separation_m is None else separation_m,
        max(limits.clearance_min_m - tolerance_m, 0.0),
        limits.height_m[1] + tolerance_m,
        limits.speed_ned_mps,
        scenario.no_fly,
        -(
            scenario.ground_phases.hover_s
            + (scenario.ground_phases.run_up_s if any(scenario.start.velocity_mps) else 0)
        ),
        tolerance_m,
    )


def surroundings_of(scenario: Scenario) -> Surroundings:
    """The scenario's frame and ground."""

    def ground(north_m: Array, east_m: Array) -> Array:
        return ground_height_m(scenario.terrain, north_m, east_m)

    return Surroundings(local_origin(scenario), ground)
