"""Interval arithmetic: the range of a formula over ranges of its inputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.types import Array


@dataclass(frozen=True, eq=False)
class NumberSpan:
    """All numbers from `low` to `high`, of any shape. Rounding is not bounded: it is below a nanometre here."""

    low: Array
    high: Array

    def __getitem__(self, index: Any) -> NumberSpan:
        return NumberSpan(self.low[index], self.high[index])

    def __add__(self, other: NumberSpan) -> NumberSpan:
        return NumberSpan(self.low + other.low, self.high + other.high)

    def __sub__(self, other: NumberSpan) -> NumberSpan:
        return NumberSpan(self.low - other.high, self.high - other.low)

    def __mul__(self, other: NumberSpan | float) -> NumberSpan:
        ends = [one * two for one in (self.low, self.high) for two in _ends(other)]
        return NumberSpan(np.minimum.reduce(ends), np.maximum.reduce(ends))

    __rmul__ = __mul__

    def __truediv__(self, other: NumberSpan) -> NumberSpan:
        """By spans above 0."""
        return self * NumberSpan(1.0 / other.high, 1.0 / other.low)

    def __rtruediv__(self, other: float) -> NumberSpan:
        return NumberSpan(other / self.high, other / self.low)

    def root(self) -> NumberSpan:
        """The square roots; 0 of what is below 0."""
        return NumberSpan(np.sqrt(np.maximum(self.low, 0.0)), np.sqrt(np.maximum(self.high, 0.0)))

    def least(self, other: NumberSpan | Array | float) -> NumberSpan:
        """The smaller of each two."""
        low, high = _ends(other)
        return NumberSpan(np.minimum(self.low, low), np.minimum(self.high, high))

    def most(self, other: NumberSpan | Array | float) -> NumberSpan:
        """The larger of each two."""
        low, high = _ends(other)
        return NumberSpan(np.maximum(self.low, low), np.maximum(self.high, high))

    def within(self, other: NumberSpan) -> NumberSpan:
        """The numbers that are in both spans."""
        return NumberSpan(np.maximum(self.low, other.low), np.minimum(self.high, other.high))


def spanned(middle: Array, off: Array | float) -> NumberSpan:
    """All numbers that are so far from a middle, at most."""
    return NumberSpan(middle - off, middle + off)


def _ends(value: NumberSpan | Array | float) -> tuple[Any, Any]:
    return (value.low, value.high) if isinstance(value, NumberSpan) else (value, value)
