"""Plan time of a flight by the vehicles' common time. After a standstill the plan goes on with a later T0."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.types import Array

_SAME_S = 1e-3


@dataclass(frozen=True)
class PlanTime:
    """The T0 of each piece of a flight, with the time from which it counts, in order; the first counts from -inf.

    While vehicles were led back to the plan, the plan waited at the time at which the next piece begins.
    """

    pieces: tuple[tuple[float, float], ...]  # (since, T0), unix s
    led_back: tuple[tuple[float, float], ...] = ()  # from a standstill until all were on the plan again, unix s

    @classmethod
    def of(
        cls,
        t0_unix_s: float,
        known: Iterable[tuple[float, float]] = (),
        led_back: tuple[tuple[float, float], ...] = (),
    ) -> PlanTime:
        """The plan time of a flight with this last T0. `known`: common and plan times of events, as they were noted."""
        pieces: list[tuple[float, float]] = []
        for unix_s, t_s in sorted(one for one in known if math.isfinite(one[0] - one[1])):
            if not pieces or unix_s - t_s > pieces[-1][1] + _SAME_S:
                pieces.append((unix_s if pieces else -math.inf, unix_s - t_s))
        if not pieces or abs(pieces[-1][1] - t0_unix_s) > _SAME_S:
            return cls(((-math.inf, t0_unix_s),), led_back)
        return cls((*pieces[:-1], (pieces[-1][0], t0_unix_s)), led_back)

    @property
    def t0_unix_s(self) -> float:
        """The last T0."""
        return self.pieces[-1][1]

    def t_s(self, unix_s: Array) -> Array:
        """Return plan times (N,) of common times (N,); they never run back."""
        since_s, t0_s = np.array(self.pieces).T
        begins_s = np.append((since_s - t0_s)[1:], np.inf)
        waits_s = np.minimum.accumulate(begins_s[::-1])[::-1]
        piece = np.searchsorted(since_s, unix_s, side="right") - 1
        return np.asarray(np.minimum(unix_s - t0_s[piece], waits_s[piece]))

    def off_plan(self, unix_s: Array) -> NDArray[np.bool_]:
        """Return whether, at common times (N,), a standstill had led the vehicles off the plan."""
        off = np.zeros(len(unix_s), dtype=np.bool_)
        for begin_s, end_s in self.led_back:
            off |= (unix_s >= begin_s) & (unix_s < end_s)
        return off
