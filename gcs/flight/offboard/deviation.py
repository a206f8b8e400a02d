"""A vehicle's deviation from its reference, with a rate that agrees with its reported positions.

A reported velocity may differ from the slope of the reported positions: satellite fixes move the position and not the
velocity. Recorded vehicles differ by 0.2 m/s RMS over 2 s. Two first-order filters join both reports, with position x,
velocity u and correction b of the velocity:

    x' = u + b + 2 w (reported - x)
    b' = w^2 (reported - x)

The rate u + b has no delay above w = RATE_RADPS and no offset below it.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from gcs.flight.offboard.reference_trajectory import Values
from gcs.physics.quadrotor import Array

RATE_RADPS = 3.0
REPORT_MAX_S = 1.0  # the rate of an older report is not used
_SENT_GAP_S = 0.5  # setpoints further apart than this are not continued
_KEPT = 256


class DeviationEstimate:
    """The deviation at the last report, and its rate; reports come with rising times."""

    def __init__(self) -> None:
        self.t_s = math.nan
        self._reported_m, self._reported_mps = np.zeros(3), np.zeros(3)
        self._smooth_m, self._correction_mps = np.zeros(3), np.zeros(3)

    def receive(self, t_s: float, off_m: Array, off_mps: Array) -> None:
        """Take in a deviation (3,) and its reported rate (3,), both of the time `t_s`."""
        step_s = t_s - self.t_s
        if 0.0 < step_s <= REPORT_MAX_S:
            mean_mps = (self._reported_mps + off_mps) / 2 + self._correction_mps
            expected = self._smooth_m + mean_mps * step_s
            missed = off_m - expected
            kept = math.exp(-RATE_RADPS * step_s)
            self._smooth_m = expected + (1.0 - kept * kept) * missed
            self._correction_mps = self._correction_mps + (1.0 - kept) ** 2 / step_s * missed
        else:
            self._smooth_m, self._correction_mps = off_m, np.zeros(3)
        self.t_s, self._reported_m, self._reported_mps = t_s, off_m, off_mps

    def is_fresh(self, t_s: float) -> bool:
        """Whether the last report is not too old to be predicted for `t_s`."""
        return t_s - self.t_s <= REPORT_MAX_S

    def at(self, t_s: float) -> tuple[Array, Array]:
        """Return the deviation predicted for `t_s`, and its rate; of an old report the deviation alone."""
        if not self.is_fresh(t_s):
            return self._reported_m, np.zeros(3)
        rate_mps = self._reported_mps + self._correction_mps
        return self._reported_m + rate_mps * max(t_s - self.t_s, 0.0), rate_mps


class SentSetpoints:
    """The last setpoints that were sent to one vehicle, by the unix time at which it is to be there."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Values]] = deque(maxlen=_KEPT)

    def add(self, unix_s: float, values: Values) -> None:
        """Note a setpoint. One that is not later than those before it replaces them."""
        while self._sent and self._sent[-1][0] >= unix_s:
            self._sent.pop()
        self._sent.append((unix_s, values))

    def at(self, unix_s: float) -> tuple[Array, Array] | None:
        """Return the position and velocity (3,) that were asked for at a time; None when nothing was."""
        for sent_s, values in reversed(self._sent):
            if sent_s <= unix_s:
                ahead_s = unix_s - sent_s
                if ahead_s > _SENT_GAP_S:
                    return None
                position, velocity, acceleration = np.array(values[:9]).reshape(3, 3)
                moved = position + velocity * ahead_s + acceleration * (ahead_s * ahead_s / 2.0)
                return moved, velocity + acceleration * ahead_s
        return None
