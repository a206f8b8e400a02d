"""Where the intervals of the transcription lie, and where its constraints are looked at between nodes.

Knows: instants and degrees. Does not know: states, constraints, solvers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gcs.physics.quadrotor import Array


@dataclass(frozen=True)
class Mesh:
    """Intervals that join end to end, each with its own number of Gauss nodes."""

    joints_s: Array  # (M+1,) increasing
    degrees: tuple[int, ...]  # (M,)
    watch_s: Array = field(default_factory=lambda: np.zeros(0))  # (W,) extra instants between the nodes

    def __post_init__(self) -> None:
        if len(self.joints_s) != len(self.degrees) + 1 or np.any(np.diff(self.joints_s) <= 0):
            raise ValueError("a mesh needs increasing joints and one degree per interval")

    @property
    def intervals(self) -> int:
        """Number M of intervals."""
        return len(self.degrees)

    def split(self, intervals: set[int]) -> Mesh:
        """The same mesh with each named interval halved."""
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
            self, joints_s=start_s + by * (self.joints_s - start_s), watch_s=start_s + by * (self.watch_s - start_s)
        )

    def watching(self, instants_s: Array) -> Mesh:
        """The same mesh with path constraints enforced at these instants too."""
        return replace(self, watch_s=np.union1d(self.watch_s, instants_s))


def end_refined(start_s: float, end_s: float, longest_s: float, shortest_s: float, degree: int) -> Mesh:
    """Short intervals where the vehicle starts and stops, growing by half each towards the middle.

    Energy-optimal flight is lively only at its ends: there the step is `shortest_s`, in the middle at most `longest_s`.
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
    """The same growth towards the middle in an even number of intervals, whatever the time; none where it is short."""
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
