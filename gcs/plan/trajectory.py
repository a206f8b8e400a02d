"""Motion as polynomials of time, joined end to end: one vehicle's, and a formation's built on its leader's.

Knows: how to evaluate states and controls at any instant. Does not know: how they were found, how good they are.
"""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from gcs.quadrotor import POSITION, VELOCITY, Array, Quadrotor, derivative
from gcs.scenario.model import Scenario
from gcs.scenario.physical import landing_points_ned_m, leader_index, pads_ned_m, quadrotor, sysids


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
    for before, after in itertools.pairwise(parts):
        if before.end_s != after.start_s:
            raise ValueError(f"one trajectory ends at {before.end_s} s, the next starts at {after.start_s} s")
    joints = np.concatenate([parts[0].joints_s[:1], *(p.joints_s[1:] for p in parts)])
    return Trajectory(
        PPoly(_stacked([p.state.c for p in parts]), joints),
        PPoly(_stacked([p.control.c for p in parts]), joints),
    )


def _stacked(coefficients: list[Array]) -> Array:
    """Concatenate along intervals after raising all to the highest degree with leading zeros."""
    top = max(len(c) for c in coefficients)
    return np.concatenate([np.pad(c, ((top - len(c), 0), (0, 0), (0, 0))) for c in coefficients], axis=1)


@dataclass(frozen=True)
class Phase:
    """A named part of the flight."""

    name: str  # takeoff, hover, run-up, mission, arrival-hover, landing
    start_s: float
    end_s: float


@dataclass(frozen=True)
class MeshRound:
    """One solve of the refinement: what it cost and what was still wrong between the nodes."""

    intervals: int
    unknowns: int
    watched: int
    iterations: int
    seconds: float
    objective: float
    complaints: tuple[str, ...]


@dataclass(frozen=True)
class Alternative:
    """One way through the map and what became of it."""

    length_m: float
    objective: float | None  # None: not optimised, or without success
    verdict: str  # in words


@dataclass(frozen=True)
class Plan:
    """A formation's whole flight: the leader's trajectory and everyone's offset from it. t = 0 is T0."""

    scenario: Scenario
    leader_trajectory: Trajectory
    shape: PPoly  # offsets from the leader: coefficients (C+1, P, V, 3), on the same span as the leader's trajectory
    phases: tuple[Phase, ...]
    objective: float
    mesh_history: tuple[MeshRound, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    timings_s: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.shape.c.shape[2:] != (len(self.sysids), 3):
            raise ValueError(f"shape needs offsets (V, 3) = {(len(self.sysids), 3)}, not {self.shape.c.shape[2:]}")

    @cached_property
    def sysids(self) -> tuple[int, ...]:
        """System ids, in the order of every (V, ...) array."""
        return sysids(self.scenario)

    @cached_property
    def quadrotor(self) -> Quadrotor:
        """The vehicle that flies it."""
        return quadrotor(self.scenario)

    @property
    def leader(self) -> int:
        """Row of the leader."""
        return leader_index(self.scenario)

    @property
    def t_start_s(self) -> float:
        """Take-off begins."""
        return self.leader_trajectory.start_s

    @property
    def t_end_s(self) -> float:
        """All have landed."""
        return self.leader_trajectory.end_s

    @property
    def flight_s(self) -> float:
        """Arrival time t_f of the paper's problem."""
        return self.scenario.time.flight_s

    @cached_property
    def joints_s(self) -> Array:
        """Instants where polynomials join, the leader's or the shape's."""
        return np.union1d(self.leader_trajectory.joints_s, self.shape.x)

    @cached_property
    def pads_ned_m(self) -> Array:
        """Ground points (V, 3) the vehicles start from."""
        return pads_ned_m(self.scenario)

    @cached_property
    def landing_points_ned_m(self) -> Array:
        """Ground points (V, 3) the vehicles land on."""
        return landing_points_ned_m(self.scenario)

    def phase(self, name: str) -> Phase:
        """The phase of that name."""
        return next(p for p in self.phases if p.name == name)

    def offsets(self, t_s: Array, order: int = 0) -> Array:
        """Offsets from the leader, or their `order`-th time derivative: (V, N, 3)."""
        return np.moveaxis(self.shape(t_s, nu=order), 0, 1)

    def states(self, t_s: Array) -> Array:
        """States (V, N, 12) of all vehicles: the leader's plus the shape (Eq. 22) and its rate."""
        states = np.repeat(self.leader_trajectory.state(t_s)[None], len(self.sysids), axis=0)
        states[..., POSITION] += self.offsets(t_s)
        states[..., VELOCITY] += self.offsets(t_s, 1)
        return states

    def controls(self, t_s: Array) -> Array:
        """Controls (V, N, 4): the leader's, and the thrust that moves the shape vertically (Eq. 1, third row)."""
        controls = np.repeat(self.leader_trajectory.control(t_s)[None], len(self.sysids), axis=0)
        rate, acceleration = self.offsets(t_s, 1)[..., 2], self.offsets(t_s, 2)[..., 2]
        roll, pitch = self.leader_trajectory.state(t_s)[:, 6:8].T
        force = self.quadrotor.mass_kg * acceleration + self.quadrotor.drag_Nspm[2] * rate
        controls[..., 0] -= force / (np.cos(roll) * np.cos(pitch))
        return controls

    def accelerations(self, t_s: Array) -> Array:
        """Accelerations (V, N, 3) in NED, by Eq. 1 from states and controls."""
        return derivative(self.states(t_s), self.controls(t_s), self.quadrotor)[..., VELOCITY]

    @cached_property
    def hash(self) -> str:
        """Hex digest over everything that is flown."""
        digest = hashlib.sha256(self.scenario.model_dump_json().encode() + repr(self.phases).encode())
        for part in (self.leader_trajectory.state, self.leader_trajectory.control, self.shape):
            digest.update(np.ascontiguousarray(part.x).tobytes())
            digest.update(np.ascontiguousarray(part.c).tobytes())
        return digest.hexdigest()
