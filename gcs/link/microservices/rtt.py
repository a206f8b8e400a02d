"""How long to wait for an answer before asking again: learned from the answers themselves.

Knows: round trips as they are measured. Does not know: what was asked. After Jacobson and Karn (RFC 6298): the mean
plus four times the mean deviation, and only answers to questions that were put once are measured. Repetitions
wait a little longer, no more: there is one question under way at a time, which makes no queue, and on a radio link
losses are noise.
"""

from __future__ import annotations

_GAIN, _DEVIATION_GAIN = 1 / 8, 1 / 4
_GROWTH, _MOST_GROWTH = 1.1, 1.3


class RttEstimator:
    """The estimate for one vehicle: `first_s` until something was measured, then between the two bounds."""

    def __init__(self, quickest_s: float = 0.03, slowest_s: float = 1.5, first_s: float = 0.5) -> None:
        self._quickest_s, self._slowest_s = quickest_s, slowest_s
        self._wait_s = first_s
        self._mean_s: float | None = None
        self._deviation_s = 0.0

    @property
    def mean_s(self) -> float | None:
        """The smoothed round trip; None before any was measured."""
        return self._mean_s

    def learn(self, sample_s: float) -> None:
        """One answer came after `sample_s`."""
        if self._mean_s is None:
            self._mean_s, self._deviation_s = sample_s, sample_s / 2
        else:
            self._deviation_s += _DEVIATION_GAIN * (abs(sample_s - self._mean_s) - self._deviation_s)
            self._mean_s += _GAIN * (sample_s - self._mean_s)
        self._wait_s = self._mean_s + max(4 * self._deviation_s, self._quickest_s)

    def wait_s(self, repeats: int = 0) -> float:
        """How long to wait after a question that has been put `repeats` times before."""
        grown_s = self._wait_s * min(_GROWTH ** min(repeats, 9), _MOST_GROWTH)
        return min(max(grown_s, self._quickest_s), self._slowest_s)
