"""What a vehicle's manoeuvres may ask of it, derived from its physics.

Knows: thrust surplus, roll torque, the scenario's speed limits. Does not know: manoeuvres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.autopilots.navigation.navigator import UNLIMITED, Ability
from gcs.physics.quadrotor import Quadrotor
from gcs.scenario.schema.scenario import LimitsTable
from gcs.scenario.vehicle_ability import ability_of

# Shares of what physics allows, so that feedback keeps the rest.
_THRUST_SHARE = 0.35
_TILT_SHARE = 0.3
_TORQUE_SHARE = 0.3
_SPEED_SHARE = 0.8


@dataclass(frozen=True)
class MotionLimits:
    """Peaks that a manoeuvre keeps to; `ability` is what the vehicle can do, comfortable or not."""

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
        """The limits of one type of vehicle.

        Upwards counts the thrust beyond the weight, sideways the horizontal part of full thrust at constant
        height. A quadrotor accelerates sideways by tilting, so its jerk and snap are bounded by its roll rate
        and by the roll acceleration its rotors can produce: snap <= g * arm * U2 / I.
        """
        g = vehicle.gravity_mps2
        surplus = limits.thrust_N[1] / vehicle.weight_N
        sideways = g * math.sqrt(max(surplus * surplus - 1.0, 0.01))
        tilt = g * math.tan(math.radians(min(limits.roll_pitch_yaw_deg[:2])))
        roll_radps2 = min(
            vehicle.arm_m * limits.torque[0] / vehicle.inertia_kgm2[0],
            vehicle.arm_m * limits.torque[1] / vehicle.inertia_kgm2[1],
        )
        return cls(
            horizontal_mps=_SPEED_SHARE * min(limits.speed_ned_mps[:2]),
            vertical_mps=_SPEED_SHARE * limits.speed_ned_mps[2],
            horizontal_mps2=min(_TILT_SHARE * min(sideways, tilt), 2.5),
            vertical_mps2=min(max(_THRUST_SHARE * g * (surplus - 1.0), 0.05), 1.5),
            horizontal_mps3=0.5 * g * math.radians(min(limits.rates_degps[:2])),
            horizontal_mps4=_TORQUE_SHARE * g * roll_radps2,
            yaw_radps=_SPEED_SHARE * math.radians(limits.rates_degps[2]),
            ability=ability_of(vehicle, limits),
        )
