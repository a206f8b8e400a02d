"""One vehicle's motion as polynomials of time, joined end to end.

Knows: how to evaluate state and control at any instant. Does not know: who flies it, whether it is any good.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from gcs.quadrotor import Array


@dataclass(frozen=True)
class Trajectory:
    """State (12) and control (4) of Eq. 1 on [start_s, end_s]; both share their joints."""

    state: PPoly  # coefficients (K+1, M, 12)
    control: PPoly  # coefficients (C+1, M, 4)

    def __post_init__(self) -> None:
        if self.state.c.shape[1:] != (self.intervals, 12) or self.control.c.shape[1:] != (self.intervals, 4):
            raise ValueError("state and control need (degree + 1, M, 12) and (degree + 1, M, 4) on the same joints")
        if not np.array_equal(self.state.x, self.control.x):
            raise ValueError("state and control must join at the same instants")

    @property
    def joints_s(self) -> Array:
        """Instants (M+1,) where one polynomial ends and the next begins."""
        return np.asarray(self.state.x)

    @property
    def intervals(self) -> int:
        """Number M of polynomials."""
        return len(self.state.x) - 1

    @property
    def start_s(self) -> float:
        """First instant."""
        return float(self.state.x[0])

    @property
    def end_s(self) -> float:
        """Last instant."""
        return float(self.state.x[-1])


def joined(parts: list[Trajectory]) -> Trajectory:
    """One trajectory from several that follow each other without a gap."""
    for before, after in zip(parts, parts[1:], strict=False):
        if before.end_s != after.start_s:
            raise ValueError(f"trajectories must join: one ends at {before.end_s} s, the next starts at {after.start_s} s")
    joints = np.concatenate([parts[0].joints_s[:1], *(p.joints_s[1:] for p in parts)])
    return Trajectory(
        PPoly(_stacked([p.state.c for p in parts]), joints), PPoly(_stacked([p.control.c for p in parts]), joints)
    )


def _stacked(coefficients: list[Array]) -> Array:
    """Concatenate along intervals after raising all to the highest degree with leading zeros."""
    top = max(len(c) for c in coefficients)
    return np.concatenate([np.pad(c, ((top - len(c), 0), (0, 0), (0, 0))) for c in coefficients], axis=1)
