"""Altitudes of mission items as each autopilot stores them.

ArduPilot multiplies by 100 in single precision and truncates towards zero. An altitude in millimetres is stored up to
1 cm lower, which changes the length of the legs at both ends: 5 mm of a slow leg of 0.2 m/s are 25 ms, and 0.15 m where
the formation flies 6 m/s.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.autopilots.traits import Autopilot

_MILLIMETRES = 3


def kept_alt_m(alt_m: float, firmware: Autopilot) -> float:
    """Return the altitude that the vehicle stores when `alt_m` is sent; infinite beyond single precision."""
    decimals = firmware.traits.missions.altitude_decimals
    with np.errstate(over="ignore"):
        single = np.float32(alt_m)
        if decimals is None:
            return float(single)
        steps_pm = 10.0**decimals
        return float(np.trunc(single * np.float32(steps_pm))) / steps_pm


def written_alt_m(alt_m: float, firmware: Autopilot) -> float:
    """Return the altitude to write, in whole millimetres, for which the vehicle stores the value nearest to `alt_m`."""
    decimals = firmware.traits.missions.altitude_decimals
    if decimals is None:
        return round(alt_m, _MILLIMETRES)
    whole = round(alt_m, decimals)
    if kept_alt_m(whole, firmware) == whole:
        return whole
    return round(whole + math.copysign(0.001, whole), _MILLIMETRES)  # 2.10 would be stored as 2.09
