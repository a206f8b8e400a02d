"""The delay of vehicles behind the plan, by least squares along the planned velocities."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from gcs.types import Array, JsonObject

SLOW_MPS = 0.3  # a slower vehicle is neither late nor early


class Lateness:
    """The time shift that best fits reported to planned positions: least squares along the velocity, so far."""

    def __init__(self) -> None:
        self._behind_m2ps = 0.0
        self._squared_m2ps2 = 0.0

    def add(self, flown_m: Array, planned_m: Array, rate_mps: Array) -> None:
        """Add one report, or several; all (..., 3)."""
        squared = np.sum(rate_mps * rate_mps, axis=-1)
        behind = np.sum((planned_m - flown_m) * rate_mps, axis=-1)
        moving = squared > SLOW_MPS**2
        self._behind_m2ps += float(np.sum(behind, where=moving))
        self._squared_m2ps2 += float(np.sum(squared, where=moving))

    @property
    def late_s(self) -> float:
        """The delay behind the plan; NaN for a vehicle that never moved."""
        return self._behind_m2ps / self._squared_m2ps2 if self._squared_m2ps2 else math.nan


def lateness_s(flown_m: Array, planned_m: Array, rate_mps: Array) -> float:
    """The delay behind the plan, s, positive if late, by least squares along the planned velocities.

    All arguments are (N, 3); instants slower than 0.3 m/s do not count; NaN if none is left.
    """
    lateness = Lateness()
    lateness.add(flown_m, planned_m, rate_mps)
    return lateness.late_s


def skew_s(late_s: Iterable[float]) -> float:
    """Return the largest delay less the smallest; NaN without any."""
    known = [late for late in late_s if math.isfinite(late)]
    return max(known) - min(known) if known else math.nan


def lateness_data(late_s: Mapping[int, float]) -> JsonObject:
    """Return the delays of vehicles behind the plan, and their skew, as plain values; None for those unknown."""
    skew = skew_s(late_s.values())
    late = {str(sysid): late if math.isfinite(late) else None for sysid, late in late_s.items()}
    return {"skew_s": skew if math.isfinite(skew) else None, "late_s": late}
