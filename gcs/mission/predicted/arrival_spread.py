"""How early and how late a vehicle may be, by what its autopilot may do where its reaction is open.

The flights of `Navigator.reactions` are its ends: one in which every open slow-down is made, one in which none is. The
legs after it take as long in both, so whatever the autopilot does at each, the vehicle is between the two.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from gcs.autopilots.traits import Autopilot, titles
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.types import Array

_NONE_S = 0.05  # knots of a flight are 0.1 s apart: a smaller difference is rounding


@dataclass(frozen=True)
class ArrivalSpread:
    """Times (R,) at which a flight completes its items, and how much earlier (negative) or later it may be there."""

    t_s: Array
    early_s: Array
    late_s: Array

    @property
    def widest_s(self) -> float:
        """The largest time by which the vehicle may be early or late."""
        return max(float(self.late_s.max(initial=0.0)), -float(self.early_s.min(initial=0.0)))

    def at(self, t_s: Array, shift_s: float = 0.0) -> tuple[Array, Array]:
        """How early and late (M,) the vehicle may be on its way at t_s (M,): as at the end of the item it is flying.

        `shift_s` moves the flight's time 0.
        """
        row = np.minimum(np.searchsorted(self.t_s + shift_s, t_s), len(self.t_s) - 1)
        return self.early_s[row], self.late_s[row]


def spread_in_words(widest_s: float, autopilots: Iterable[Autopilot]) -> str:
    """The spread of a fleet's arrival times, for reports: open reactions, and half of what two vehicles differ by."""
    every = tuple(autopilots)
    may_s = widest_s + 0.5 * max(known.traits.apart_s for known in every)
    if may_s < _NONE_S:
        return f"no arrival time rests on a reaction of {titles(every)} that may go both ways"
    return f"arrival times may spread by ±{may_s:.1f} s by what {titles(every)} may do"


def arrival_spread(flight: PredictedFlight, others: Sequence[PredictedFlight]) -> ArrivalSpread:
    """The spread of a flight, from flights of the same mission."""
    ends = [_completed_s(one) for one in chain([flight], others)]
    count = min(len(one) for one in ends)
    apart_s = np.array([one[:count] - ends[0][:count] for one in ends])
    apart_s[np.abs(apart_s) < _NONE_S] = 0.0
    return ArrivalSpread(ends[0][:count], apart_s.min(axis=0), apart_s.max(axis=0))


def _completed_s(flight: PredictedFlight) -> Array:
    # The knot at which the next item begins is always kept; the one before it may be far ahead on a straight leg.
    ends = np.append(np.flatnonzero(np.diff(flight.item)) + 1, len(flight.item) - 1)
    return np.asarray(flight.t_s[ends])
