"""The mesh of the transcription: intervals, their degrees, and extra instants at which constraints are enforced."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gcs.physics.quadrotor import Array


@dataclass(frozen=True)
class Mesh:
    """Consecutive intervals, each with its own number of Gauss nodes."""

    joints_s: Array  # (M+1,) increasing
    degrees: tuple[int, ...]  # (M,)
    extra_s: Array = field(default_factory=lambda: np.zeros(0))  # (W,) instants between the nodes

    def __post_init__(self) -> None:
        if len(self.joints_s) != len(self.degrees) + 1 or np.any(np.diff(self.joints_s) <= 0):
            raise ValueError("a mesh needs increasing joints and one degree per interval")

    @property
    def intervals(self) -> int:
        """Number M of intervals."""
        return len(self.degrees)

    def split(self, intervals: set[int]) -> Mesh:
        """The same mesh with these intervals halved."""
        joints = [self.joints_s[0]]
        degrees: list[int] = []
        for i, degree in enumerate(self.degrees):
            low, high = self.joints_s[i], self.joints_s[i + 1]
            cuts = (0.5 * (low + high), high) if i in intervals else (high,)
            joints.extend(cuts)
            degrees.extend([degree] * len(cuts))
        return replace(self, joints_s=np.array(joints), degrees=tuple(degrees))

    def stretched(self, by: float) -> Mesh:
        """The same mesh over a flight that is `by` times as long."""
        if by == 1.0:
            return self
        start_s = self.joints_s[0]
        return replace(
            self, joints_s=start_s + by * (self.joints_s - start_s), extra_s=start_s + by * (self.extra_s - start_s)
        )

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
