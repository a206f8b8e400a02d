"""The motion limits of manoeuvres, derived from the vehicle's physics and the scenario's limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.autopilots.navigation.navigator import UNLIMITED, Ability
from gcs.physics.quadrotor import Quadrotor
from gcs.scenario.schema.scenario import LimitsTable
from gcs.scenario.vehicle_ability import ability_of, physical_limits

# Shares of the physical limits; the remainder is for feedback.
_THRUST_SHARE = 0.35
_TILT_SHARE = 0.3
_TORQUE_SHARE = 0.3
_SPEED_SHARE = 0.8


@dataclass(frozen=True)
class MotionLimits:
    """Peak values that a manoeuvre respects; `ability` is the most the vehicle can do, without these shares."""

    horizontal_mps: float
    vertical_mps: float
    horizontal_mps2: float
    vertical_mps2: float
    horizontal_mps3: float
    horizontal_mps4: float
    yaw_radps: float
    ability: Ability = UNLIMITED

    @classmethod
    def of(cls, vehicle: Quadrotor, limits: LimitsTable) -> MotionLimits:
        """Return the limits of one type of vehicle: shares of its physical limits."""
        g, most = vehicle.gravity_mps2, physical_limits(vehicle, limits)
        return cls(
            horizontal_mps=_SPEED_SHARE * min(limits.speed_ned_mps[:2]),
            vertical_mps=_SPEED_SHARE * limits.speed_ned_mps[2],
            horizontal_mps2=min(_TILT_SHARE * most.sideways_mps2, 2.5),
            vertical_mps2=min(max(_THRUST_SHARE * most.upwards_mps2, 0.05), 1.5),
            horizontal_mps3=0.5 * g * most.tilt_rate_radps,
            horizontal_mps4=_TORQUE_SHARE * g * most.tilt_accel_radps2,
            yaw_radps=_SPEED_SHARE * math.radians(limits.rates_degps[2]),
            ability=ability_of(vehicle, limits),
        )
