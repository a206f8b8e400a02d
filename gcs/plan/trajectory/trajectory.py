"""The motion of one vehicle as polynomials of time, joined end to end."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from gcs.types import Array


@dataclass(frozen=True)
class Trajectory:
    """State and control of Eq. 1 on [start_s, end_s]; both share their joints.

    While automatic changes are optimised, A chains of four integrators, one for each formation coordinate, follow the
    vehicle's 12 states and 4 controls.
    """

    state: PPoly  # coefficients (K+1, M, 12 + 4 A)
    control: PPoly  # coefficients (C+1, M, 4 + A)

    def __post_init__(self) -> None:
        chains = self.control.c.shape[2] - 4
        if self.state.c.shape[1:] != (self.intervals, 12 + 4 * chains) or self.control.c.shape[1] != self.intervals:
            raise ValueError("state and control need (degree + 1, M, 12) and (degree + 1, M, 4) on the same joints")
        if not np.array_equal(self.state.x, self.control.x):
            raise ValueError("state and control must join at the same instants")

    @property
    def vehicle(self) -> Trajectory:
        """The trajectory of the vehicle alone."""
        joints = self.state.x
        return Trajectory(PPoly(self.state.c[:, :, :12], joints), PPoly(self.control.c[:, :, :4], joints))

    @property
    def coordinates(self) -> PPoly:
        """The formation's coordinates: coefficients (K+1, M, A)."""
        return PPoly(np.ascontiguousarray(self.state.c[:, :, 12::4]), self.state.x)

    @property
    def joints_s(self) -> Array:
        """Instants (M+1,) where polynomials join."""
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
    """One trajectory from several that follow each other without a gap; raises ValueError where there is one."""
    for before, after in itertools.pairwise(parts):
        if before.end_s != after.start_s:
            raise ValueError(f"one trajectory ends at {before.end_s} s, the next starts at {after.start_s} s")
    joints = np.concatenate([parts[0].joints_s[:1], *(p.joints_s[1:] for p in parts)])
    return Trajectory(
        PPoly(_stacked([p.state.c for p in parts]), joints), PPoly(_stacked([p.control.c for p in parts]), joints)
    )


def _stacked(coefficients: list[Array]) -> Array:
    """Concatenate along intervals after raising all to the highest degree with leading zeros."""
    top = max(len(c) for c in coefficients)
    return np.concatenate([np.pad(c, ((top - len(c), 0), (0, 0), (0, 0))) for c in coefficients], axis=1)
