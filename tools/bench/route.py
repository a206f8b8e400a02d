"""The common problem of several legs: Simulation 1's leader through points, one phase a leg, with free durations.

Knows: numbers read from a file. Does not know: Skein, for the reason that leader.py gives, and no solver.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tools.bench.contender import Result
from tools.bench.leader import Leader


@dataclass
class RouteResult(Result):
    """A solution whose intervals follow one another over all legs."""

    joints_s: list[float] = field(default_factory=list)  # ends of all intervals
    points_s: list[float] = field(default_factory=list)  # arrival at each point


class Legs(Leader):
    """The leader's flight through points: at each of them a phase ends and the next one begins."""

    def __init__(self, numbers: dict[str, Any]) -> None:
        super().__init__(numbers)
        self.points = np.array(numbers["points_ned_m"]) / self.state_unit[:3]  # (P, 3)
        self.stretch_low, self.stretch_high = numbers["stretch"]  # bounds of a leg's duration, over that of the guess
        legs = np.array(numbers["leg_of_interval"])
        self.count = int(legs[-1]) + 1
        self.intervals = [np.flatnonzero(legs == leg).tolist() for leg in range(self.count)]
        # (K + 1,) in the guess: start, points, end
        self.ends_s = np.array([self.joints_s[0], *(self.joints_s[own[-1] + 1] for own in self.intervals)])

    def degrees_of(self, leg: int) -> list[int]:
        """Nodes of each interval of a leg."""
        return [self.degrees[i] for i in self.intervals[leg]]

    def shares_of(self, leg: int) -> list[float]:
        """Length of each interval of a leg, as a share of the leg."""
        own = self.intervals[leg]
        lengths = np.diff(self.joints_s)[own]
        return [float(share) for share in lengths / lengths.sum()]

    def duration_of(self, leg: int) -> tuple[float, float]:
        """Least and largest duration of a leg, in seconds."""
        guess_s = float(self.ends_s[leg + 1] - self.ends_s[leg])
        return self.stretch_low * guess_s, self.stretch_high * guess_s

    def box_of(self, leg: int, *, end: bool) -> tuple[Any, Any]:
        """Bounds (12,), (12,) of the state at the start or the end of a leg."""
        stop = leg + end
        if stop in (0, self.count):
            fixed = self.x_end if stop else self.x_start
            return fixed, fixed
        low, high = self.x_low.copy(), self.x_high.copy()
        low[:3] = high[:3] = self.points[stop - 1]
        return low, high

    def guess_of(self, leg: int) -> tuple[Any, Any, Any]:
        """Instants (G,), x (G, 12) and u (G, 4) of the guess of one leg."""
        start_s, end_s = self.ends_s[leg : leg + 2]
        inner = self.guess_s[(self.guess_s > start_s) & (self.guess_s < end_s)]
        times_s = np.array([start_s, *inner, end_s])
        return (times_s, *self.guess(times_s))

    def joints_of(self, ends_s: Any) -> list[float]:
        """Ends of all intervals, where the legs end at `ends_s` (K + 1,)."""
        joints = [float(ends_s[0])]
        for leg in range(self.count):
            joints += (ends_s[leg] + np.cumsum(self.shares_of(leg)) * (ends_s[leg + 1] - ends_s[leg])).tolist()
        return joints
