"""The accelerations that a scenario's vehicle can reach at most, whatever its autopilot is set to."""

from __future__ import annotations

import math
from typing import NamedTuple

from gcs.autopilots.waypoint_models.navigator import Ability
from gcs.physics.quadrotor import Quadrotor
from gcs.scenario.schema.scenario import LimitsTable
from gcs.scenario.values.si import torque_limits

_SHARE = 0.6  # of what physics allows: feedback needs the rest


class PhysicalLimits(NamedTuple):
    """What thrust, tilt and rotors allow: the bounds of every manoeuvre."""

    sideways_mps2: float  # the horizontal part of full thrust at constant height, or of the tilt limit
    upwards_mps2: float  # thrust beyond the weight
    tilt_rate_radps: float
    tilt_accel_radps2: float


def physical_limits(vehicle: Quadrotor, limits: LimitsTable) -> PhysicalLimits:
    """The limits of one type of vehicle.

    A quadrotor accelerates sideways by tilting: its jerk is at most g times the tilt rate, its snap g times the tilt
    acceleration that its rotors produce, arm * U2 / I.
    """
    g = vehicle.gravity_mps2
    surplus = limits.thrust_N[1] / vehicle.weight_N
    sideways = g * math.sqrt(max(surplus * surplus - 1.0, 0.01))
    torque = torque_limits(limits, vehicle.arm_m)
    tilt = g * math.tan(math.radians(min(limits.roll_pitch_yaw_deg[:2])))
    return PhysicalLimits(
        sideways_mps2=min(sideways, tilt),
        upwards_mps2=g * (surplus - 1.0),
        tilt_rate_radps=math.radians(min(limits.rates_degps[:2])),
        tilt_accel_radps2=min(
            vehicle.arm_m * torque[0] / vehicle.inertia_kgm2[0],
            vehicle.arm_m * torque[1] / vehicle.inertia_kgm2[1],
        ),
    )


def ability_of(vehicle: Quadrotor, limits: LimitsTable) -> Ability:
    """The share of the physical limits that navigation models may use."""
    g, most = vehicle.gravity_mps2, physical_limits(vehicle, limits)
    return Ability(
        horizontal_mps2=_SHARE * most.sideways_mps2,
        vertical_mps2=_SHARE * max(most.upwards_mps2, 0.1),
        horizontal_mps3=g * most.tilt_rate_radps,
        horizontal_mps4=_SHARE * g * most.tilt_accel_radps2,
    )
