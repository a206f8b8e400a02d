"""Failures of a vehicle's body: motors, sensors, battery, speed, wind and pushes.

    airframes.fail(row, [Failure(gnss_lost=True), Failure(motor=2, share=0.3)])
    airframes.fail(row, [])

They act until they are replaced. The same failures at the same times give the same flight, bit for bit.
`sim_bridge.faults` decides when, and has the faults of links and missions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from gcs.types import Array
from sim_bridge.dynamics.plant import Mask

ROTORS = 4


class Sensor(IntEnum):
    """The sensors that can get stuck; the value is the column of `Effects.stuck`."""

    GYRO = 0
    ACCELEROMETER = 1
    COMPASS = 2
    BAROMETER = 3
    GNSS = 4


_NONE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """What fails. `fault_spec.make_fault` checks the values."""

    gnss_lost: bool = False  # there is no fix
    offset_ned_m: tuple[float, float, float] = _NONE  # of every fix, as with multipath
    sensor: Sensor | None = None  # repeats its last sample
    motor: int = 0  # 1 to 4, numbered as in Eq. 2: loses this `share` of its thrust; at 1 it stands still
    share: float = 1.0
    remaining: float = 1.0  # the battery has at most this share of its charge left, also when the failure has ended
    speed_mps: float = math.inf  # the ground speed is limited to this, whatever is commanded
    wind_ned_mps: tuple[float, float, float] = _NONE  # added to that of the fleet
    push_ned_mps2: tuple[float, float, float] = _NONE  # evenly over its mass: the accelerometer senses it like drag


@dataclass(slots=True)
class Effects:
    """The combined effect of all failures at one time, as arrays for the physics."""

    motor_strength: Array  # (V, 4) remaining share of the thrust
    gnss_lost: Mask  # (V,)
    gnss_offset_ned_m: Array  # (V, 3)
    stuck: Mask  # (V, 5), columns as in `Sensor`
    speed_max_mps: Array  # (V,)
    wind_ned_mps: Array  # (V, 3) added to the fleet's wind
    push_ned_mps2: Array  # (V, 3)
    remaining: Array  # (V,) maximum share of the charge
    sound: bool = True  # no vehicle has a failure

    @classmethod
    def of(cls, failures: Sequence[Sequence[Failure]]) -> Effects:
        """Return the effects of the failures of each vehicle."""
        vehicles = len(failures)
        effects = cls(
            motor_strength=np.ones((vehicles, ROTORS)),
            gnss_lost=np.zeros(vehicles, dtype=bool),
            gnss_offset_ned_m=np.zeros((vehicles, 3)),
            stuck=np.zeros((vehicles, len(Sensor)), dtype=bool),
            speed_max_mps=np.full(vehicles, math.inf),
            wind_ned_mps=np.zeros((vehicles, 3)),
            push_ned_mps2=np.zeros((vehicles, 3)),
            remaining=np.ones(vehicles),
        )
        for row, failure in ((row, failure) for row, all_of_it in enumerate(failures) for failure in all_of_it):
            effects.sound = False
            effects.gnss_lost[row] |= failure.gnss_lost
            effects.gnss_offset_ned_m[row] += failure.offset_ned_m
            if failure.sensor is not None:
                effects.stuck[row, failure.sensor] = True
            if failure.motor:
                effects.motor_strength[row, failure.motor - 1] *= 1.0 - failure.share
            effects.speed_max_mps[row] = min(effects.speed_max_mps[row], failure.speed_mps)
            effects.wind_ned_mps[row] += failure.wind_ned_mps
            effects.push_ned_mps2[row] += failure.push_ned_mps2
            effects.remaining[row] = min(effects.remaining[row], failure.remaining)
        return effects
