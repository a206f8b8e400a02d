"""The navigation error that a flight of a scenario must expect: how far a vehicle is from its planned place (3 sigma).

Two errors add as squares: that of sensors and control, and the distance of waypoints from the plan (`[mission]
tolerance_m`). The first is measured in flights of emulated vehicles. Six flights with GNSS (`missions/field` and the
scenario of `gcs new`, three seeds each) show 2.09 and 2.31 m horizontally and 2.12 and 2.34 m in height; a waypoint
mission shows 2.33 and 2.71 m. Two flights with RTK show 0.04 and 0.03 m. A steady wind adds nothing, declared or not:
in 5 and 8 m/s the figures are those of calm air within 0.01 m. Gusts, which no scenario has (`gcs fly --gusts`), add to
them. With RTK, light ones make it 0.08 m in calm air and 0.11 m in 8 m/s, moderate ones 0.14 and 0.21 m, severe ones
0.27 and 0.40 m.
"""

import math
from dataclasses import dataclass
from types import MappingProxyType

from gcs.scenario.schema.scenario import Scenario, VehicleTable

_LEAST_M = 0.3  # nearer than this two vehicles touch, however small they are
_ROTOR_SHARE = 0.5  # of the arm: the radius of a propeller, where the scenario does not give it


@dataclass(frozen=True)
class PositionSigma:
    """Standard deviations of one vehicle's position."""

    horizontal_m: float  # north, and east
    vertical_m: float


@dataclass(frozen=True)
class NavigationError:
    """Distances from the planned place, 3 sigma: along any one direction of the plane, and in height."""

    horizontal_m: float
    vertical_m: float

    @property
    def of_two_m(self) -> float:
        """What two vehicles may be nearer to each other than planned, 3 sigma: their errors are independent."""
        return math.sqrt(2.0) * self.horizontal_m


SIGMA = MappingProxyType({"rtk": PositionSigma(0.01, 0.015), "gnss": PositionSigma(1.0, 1.5)})
_MEASURED = MappingProxyType({"rtk": NavigationError(0.05, 0.05), "gnss": NavigationError(2.4, 2.8)})


def navigation_error(scenario: Scenario) -> NavigationError:
    """The navigation error of one vehicle of a scenario."""
    flown, beside_m = _MEASURED[scenario.sensors.grade], scenario.mission.tolerance_m
    horizontal_m, vertical_m = (
        round(math.hypot(error, beside_m), 2) for error in (flown.horizontal_m, flown.vertical_m)
    )
    return NavigationError(horizontal_m, vertical_m)


def judged_separation_m(scenario: Scenario) -> float:
    """The least true distance between two vehicles that a flight must keep: `judge.separation_min_m`.

    Where the scenario does not give it, it is the planned one less the navigation error of two vehicles. It is never
    less than the size of a vehicle.
    """
    if scenario.judge.separation_min_m is not None:
        return scenario.judge.separation_min_m
    planned_m = scenario.limits.separation_min_m
    left_m = planned_m - navigation_error(scenario).of_two_m
    return min(planned_m, round(max(left_m, vehicle_size_m(scenario.vehicle), _LEAST_M), 2))


def vehicle_size_m(vehicle: VehicleTable) -> float:
    """The size of a vehicle with its propellers."""
    radius_m = _ROTOR_SHARE * vehicle.arm_m if vehicle.power is None else vehicle.power.rotor_radius_m
    return 2.0 * (vehicle.arm_m + radius_m)


def planned_margin_m(scenario: Scenario) -> float:
    """The distance to no-fly zones that the planner aims for."""
    given_m = scenario.limits.zone_margin_m
    return navigation_error(scenario).horizontal_m if given_m is None else given_m
