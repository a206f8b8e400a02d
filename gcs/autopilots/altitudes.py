"""Altitudes of mission items as autopilots keep them, and as they are written so that they are kept.

Knows: ArduPilot's whole centimetres, everybody's single precision. Does not know: what an altitude counts from.
ArduPilot multiplies by 100 in single precision and cuts towards zero. An altitude written with millimetres is kept
up to 1 cm lower, and the legs at both of its ends have other lengths than their times were worked out from: 25 ms
for each 5 mm of a slow leg of 0.2 m/s, which is 0.15 m where the formation flies 6 m/s.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.autopilots.traits import Autopilot

_MILLIMETRES = 3


def kept_alt_m(alt_m: float, firmware: Autopilot) -> float:
    """What the vehicle will hold where `alt_m` is sent; infinite beyond single precision."""
    with np.errstate(over="ignore"):
        single = np.float32(alt_m)
        if firmware is not Autopilot.ARDUPILOT:
            return float(single)
        return float(np.trunc(single * np.float32(100.0))) / 100.0


def written_alt_m(alt_m: float, firmware: Autopilot) -> float:
    """The altitude to write, in whole millimetres, so that what is kept is as near to `alt_m` as can be."""
    if firmware is not Autopilot.ARDUPILOT:
        return round(alt_m, _MILLIMETRES)
    whole = round(alt_m, 2)
    if kept_alt_m(whole, firmware) == whole:
        return whole
    return round(whole + math.copysign(0.001, whole), _MILLIMETRES)  # 2.10 would be kept as 2.09
