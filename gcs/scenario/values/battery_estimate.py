"""The share of its battery that each vehicle of a scenario needs, estimated from the flight's times without a plan."""

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import air_density_kgpm3, induced_power_W
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.own_landing import landing_s
from gcs.scenario.values.si import NED_FROM_UP, offsets_ned_m, quadrotor, route_points

_TURNS = 1.01  # of the power of steady flight: climbs, turns, and the speed that is not the mean
_J_PER_WH = 3600.0


@dataclass(frozen=True)
class BatteryEstimate:
    """What a flight needs of a full battery, and how much of it may be used."""

    share: float  # of a full battery, from take-off to touch-down
    usable: float  # share, without the reserve
    whole_s: float  # from take-off to touch-down

    @property
    def is_enough(self) -> bool:
        """Whether one battery is enough."""
        return self.share <= self.usable

    @property
    def longest_s(self) -> float:
        """The longest flight on one battery from take-off to touch-down, s."""
        return self.whole_s * self.usable / self.share


def battery_estimate(scenario: Scenario) -> BatteryEstimate:
    """The estimate for the vehicle that flies highest; without [vehicle.power] by the table [preflight].

    A quadrotor draws nearly the power of hover whatever it does: what counts is the time, then drag and thin air.
    """
    ground, preflight, power = scenario.ground_phases, scenario.preflight, scenario.vehicle.power
    whole_s = scenario.time.flight_s + ground.takeoff_s + landing_s(scenario) + 2.0 * ground.hover_s
    if any(scenario.start.velocity_mps):
        whole_s += ground.run_up_s
    usable = 1.0 - preflight.reserve
    if power is None:
        return BatteryEstimate(whole_s * preflight.effort / preflight.endurance_s, usable, whole_s)
    stops = np.array(
        [scenario.start.position_m, *(p.position_m for p in route_points(scenario)), scenario.end.position_m]
    )
    mean_mps = float(np.linalg.norm(np.diff(stops, axis=0), axis=1).sum()) / scenario.time.flight_s
    height_m = float(stops[:, 2].max() + (offsets_ned_m(scenario) * NED_FROM_UP)[:, 2].max())
    vehicle = quadrotor(scenario)
    # Into the wind and with it the drag differs; the larger one has the power.
    air_mps = mean_mps + float(np.hypot(*vehicle.wind.at(height_m)[:2]))
    thrust_N = float(np.hypot(vehicle.weight_N, max(vehicle.drag_Nspm[:2]) * air_mps))
    density = float(air_density_kgpm3(scenario.origin.alt_amsl_m + height_m))
    drawn_W = 4.0 * float(induced_power_W(thrust_N / 4.0, power.rotor_radius_m, density)) / power.figure_of_merit
    return BatteryEstimate(_TURNS * drawn_W * whole_s / (power.battery_Wh * _J_PER_WH), usable, whole_s)
