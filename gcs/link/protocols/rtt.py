"""The wait for an answer before a request is repeated, estimated from round trips (Jacobson and Karn, RFC 6298).

The wait is the mean round trip plus four times the mean deviation. Only answers to requests that were sent once are
measured. The wait grows little with repetitions: one request at a time makes no queue, and losses on a radio link are
noise.
"""

from __future__ import annotations

from gcs.autopilots.protocol_timers import STANDARD, RoundTripTimers

_GAIN, _DEVIATION_GAIN = 1 / 8, 1 / 4
_GROWTH, _MOST_GROWTH = 1.1, 1.3


class RttEstimator:
    """The estimate for one vehicle: `first_s` before the first measurement, then between the two bounds."""

    def __init__(self, timers: RoundTripTimers = STANDARD.round_trip) -> None:
        self._wait_min_s, self._wait_max_s = timers.least_s, timers.most_s
        self._wait_s = timers.first_s
        self._mean_s: float | None = None
        self._deviation_s = 0.0

    @property
    def mean_s(self) -> float | None:
        """The smoothed round trip; None before the first measurement."""
        return self._mean_s

    def learn(self, sample_s: float) -> None:
        """Add one measured round trip."""
        if self._mean_s is None:
            self._mean_s, self._deviation_s = sample_s, sample_s / 2
        else:
            self._deviation_s += _DEVIATION_GAIN * (abs(sample_s - self._mean_s) - self._deviation_s)
            self._mean_s += _GAIN * (sample_s - self._mean_s)
        self._wait_s = self._mean_s + max(4 * self._deviation_s, self._wait_min_s)

    def wait_s(self, repeats: int = 0) -> float:
        """Return the wait after a request that has been repeated `repeats` times."""
        grown_s = self._wait_s * min(_GROWTH ** min(repeats, 9), _MOST_GROWTH)
        return min(max(grown_s, self._wait_min_s), self._wait_max_s)
