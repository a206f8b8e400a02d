"""The mesh of the transcription: intervals, their degrees, and extra instants at which constraints are enforced."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs.types import Array

Numbers = NDArray[np.intp]

HOLD = -1  # instead of the number of a leg: the leader hovers, in an interval without nodes


@dataclass(frozen=True)
class Mesh:
    """Consecutive intervals, each with its own number of Gauss nodes."""

    joints_s: Array  # (M+1,) increasing
    degrees: tuple[int, ...]  # (M,)
    extra_s: Array = field(default_factory=lambda: np.zeros(0))  # (W,) instants between the nodes
    legs: tuple[int, ...] = ()  # (M,) number of each interval's leg, or HOLD; empty: one leg

    def __post_init__(self) -> None:
        if len(self.joints_s) != len(self.degrees) + 1 or np.any(np.diff(self.joints_s) <= 0):
            raise ValueError("a mesh needs increasing joints and one degree per interval")

    @property
    def intervals(self) -> int:
        """Number M of intervals."""
        return len(self.degrees)

    @property
    def leg_of_interval(self) -> Numbers:
        """Number (M,) of each interval's leg, or HOLD."""
        return np.array(self.legs or (0,) * self.intervals)

    @property
    def leg_of_node(self) -> Numbers:
        """Number (N,) of each node's leg; a hold has no nodes."""
        return np.repeat(self.leg_of_interval, self.degrees)

    @property
    def leg_count(self) -> int:
        """Number K of legs."""
        return max(self.legs, default=0) + 1

    @property
    def leg_lengths_s(self) -> Array:
        """How long (K,) each leg takes."""
        legs = self.leg_of_interval
        return np.asarray(
            np.bincount(legs[legs != HOLD], np.diff(self.joints_s)[legs != HOLD], self.leg_count), dtype=np.float64
        )

    @property
    def arrivals(self) -> Numbers:
        """Index (K - 1,) of the joint at which each leg but the last one ends."""
        legs = self.leg_of_interval
        return np.array([np.flatnonzero(legs == leg)[-1] + 1 for leg in range(self.leg_count - 1)], dtype=np.intp)

    def split(self, intervals: set[int]) -> Mesh:
        """The same mesh with these intervals halved, where they are no holds."""
        joints = [self.joints_s[0]]
        degrees: list[int] = []
        legs: list[int] = []
        for i, degree in enumerate(self.degrees):
            low, high = self.joints_s[i], self.joints_s[i + 1]
            cuts = (0.5 * (low + high), high) if i in intervals and degree else (high,)
            joints.extend(cuts)
            degrees.extend([degree] * len(cuts))
            legs.extend(self.legs[i : i + 1] * len(cuts))
        return replace(self, joints_s=np.array(joints), degrees=tuple(degrees), legs=tuple(legs))

    def stretched(self, by: Array, end_s: float | None = None) -> Mesh:
        """The same mesh with legs that are `by` (K,) times as long; holds stay as long as they are.

        `end_s` is the end of several legs where it is known: their sum rounds in the last bits.
        """
        if np.all(by == 1.0):
            return self
        start_s = self.joints_s[0]
        if not self.legs:
            joints, extra = (start_s + by[0] * (times_s - start_s) for times_s in (self.joints_s, self.extra_s))
            return replace(self, joints_s=joints, extra_s=extra)
        factors = np.where(self.leg_of_interval == HOLD, 1.0, by[self.leg_of_interval])
        joints = start_s + np.concatenate([[0.0], np.cumsum(factors * np.diff(self.joints_s))])
        joints[-1] = joints[-1] if end_s is None else end_s
        return replace(self, joints_s=joints, extra_s=np.interp(self.extra_s, self.joints_s, joints))

    def enforcing_at(self, instants_s: Array) -> Mesh:
        """The same mesh with path constraints enforced at these instants as well."""
        return replace(self, extra_s=np.union1d(self.extra_s, instants_s))


def end_refined(start_s: float, end_s: float, longest_s: float, shortest_s: float, degree: int) -> Mesh:
    """A mesh with short intervals at both ends, each half as long again as the one before, towards the middle.

    An energy-optimal flight changes quickly only at its ends. There the step is `shortest_s`; in the middle it is at
    most `longest_s`.
    """
    half = 0.5 * (end_s - start_s)
    steps: list[float] = []
    step = min(shortest_s, half)
    while sum(steps) + step < half:
        steps.append(step)
        step = min(1.5 * step, longest_s)
    steps.append(half - sum(steps))
    if len(steps) > 1 and steps[-1] < 0.5 * steps[-2]:
        last = steps.pop()
        steps[-1] += last
    lengths = np.array(steps + steps[::-1])
    joints = start_s + np.concatenate([[0.0], np.cumsum(lengths)])
    joints[-1] = end_s
    return Mesh(joints, (degree,) * len(lengths))


def counted(start_s: float, end_s: float, intervals: int, shortest_s: float, degree: int) -> Mesh:
    """A mesh of an even number of intervals that grow towards the middle; all equal where the time is short."""
    half, count = 0.5 * (end_s - start_s), intervals // 2
    growing = shortest_s * 1.5 ** np.arange(count)
    lengths = np.full(count, half / count)
    for grown in range(1, count):
        if growing[grown - 1] > lengths[-1]:
            break
        longest = (half - growing[:grown].sum()) / (count - grown)
        lengths = np.append(growing[:grown], np.full(count - grown, longest))
    joints = start_s + np.concatenate([[0.0], np.cumsum(np.append(lengths, lengths[::-1]))])
    joints[-1] = end_s
    return Mesh(joints, (degree,) * (2 * count))
