"""What a scenario's vehicle can do at most, whatever its autopilot is set to.

Knows: thrust surplus, tilt, roll torque. Does not know: autopilots, manoeuvres.
"""

from __future__ import annotations

import math

from gcs.autopilots.navigation.navigator import Ability
from gcs.physics.quadrotor import Quadrotor
from gcs.scenario.schema.scenario import LimitsTable

_SHARE = 0.6  # of what physics allows: feedback needs the rest


def ability_of(vehicle: Quadrotor, limits: LimitsTable) -> Ability:
    """Upwards counts the thrust beyond the weight, sideways the horizontal part of full thrust at constant height.

    A quadrotor accelerates sideways by tilting, so its jerk and snap are bounded by its roll rate and by the roll
    acceleration its rotors can produce: snap <= g * arm * U2 / I.
    """
    g = vehicle.gravity_mps2
    surplus = limits.thrust_N[1] / vehicle.weight_N
    sideways = g * math.sqrt(max(surplus * surplus - 1.0, 0.01))
    tilt = g * math.tan(math.radians(min(limits.roll_pitch_yaw_deg[:2])))
    roll_radps2 = min(
        vehicle.arm_m * limits.torque[0] / vehicle.inertia_kgm2[0],
        vehicle.arm_m * limits.torque[1] / vehicle.inertia_kgm2[1],
    )
    return Ability(
        horizontal_mps2=_SHARE * min(sideways, tilt),
        vertical_mps2=_SHARE * max(g * (surplus - 1.0), 0.1),
        horizontal_mps3=g * math.radians(min(limits.rates_degps[:2])),
        horizontal_mps4=_SHARE * g * roll_radps2,
    )
