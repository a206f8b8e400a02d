"""The plan: phases, the leader's trajectory and the shape; it evaluates every vehicle at any instant."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.physics.quadrotor import Quadrotor, derivative
from gcs.physics.states import POSITION, VELOCITY, NamedStates
from gcs.plan.formation.followers import formation_jerks, formation_motion
from gcs.plan.formation.graph import InformationGraph, information_graph
from gcs.plan.formation.shape import EVERYONE, Rows, Shape
from gcs.plan.formation.timeline import AUTO, Move
from gcs.plan.trajectory.distances import formation_error_m, ground_distances_m, separations_m, zone_distances_m
from gcs.plan.trajectory.leg_lines import NO_LIMITS, LegLimits, LegLine, leg_lines, remaining_lines
from gcs.plan.trajectory.passages import Passage, passages
from gcs.plan.trajectory.phases import Phase, PhaseKind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import autopilots, landing_points_ned_m, leader_index, pads_ned_m, quadrotor, sysids
from gcs.types import Array


@dataclass(frozen=True)
class MeshRound:
    """One solve of the refinement: its cost, and what it still violated between the nodes."""

    intervals: int
    unknowns: int
    watched: int
    iterations: int
    seconds: float
    objective: float
    complaints: tuple[str, ...]


@dataclass(frozen=True)
class Alternative:
    """One route through the map and its result."""

    length_m: float
    objective: float | None  # None: not optimised, or infeasible
    verdict: str  # in words


@dataclass(frozen=True)
class Plan:
    """A formation's whole flight: the leader's trajectory and the offsets of all vehicles. t = 0 is T0."""

    scenario: Scenario
    leader_trajectory: Trajectory
    shape: Shape  # offsets from the leader, on the same span as the leader's trajectory
    phases: tuple[Phase, ...]
    objective: float
    mesh_history: tuple[MeshRound, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    moves: tuple[Move, ...] = ()
    timings_s: dict[str, float] = field(default_factory=dict)
    begin_state: tuple[float, ...] | None = None  # the leader's (12), SI and NED, of a plan that begins in the air
    route_s: tuple[float, ...] = ()  # when the leader is at each route point ahead: the last ones of the route
    leg_limits: tuple[LegLimits, ...] = ()  # of the legs ahead; empty: it was planned with no line kept
    zones_since_s: tuple[float, ...] = ()  # of a plan as flown: from when each of `zones` counts; empty: always
    used_before: tuple[float, ...] = ()  # (V) shares of a full battery used before it begins; empty: not known

    def __post_init__(self) -> None:
        if self.shape.basis_ned_m.shape[1] != len(self.sysids):
            raise ValueError(f"shape needs {len(self.sysids)} vehicles, not {self.shape.basis_ned_m.shape[1]}")
        if self.used_before and len(self.used_before) != len(self.sysids):
            raise ValueError(f"{len(self.sysids)} vehicles have as many batteries, not {len(self.used_before)}")

    @cached_property
    def sysids(self) -> tuple[int, ...]:
        """System ids, in the order of every (V, ...) array."""
        return sysids(self.scenario)

    @cached_property
    def autopilots(self) -> tuple[Autopilot, ...]:
        """The autopilot of each vehicle by the scenario, in the order of every (V, ...) array."""
        return autopilots(self.scenario)

    @cached_property
    def quadrotor(self) -> Quadrotor:
        """The physical constants of the vehicles."""
        return quadrotor(self.scenario)

    @property
    def leader(self) -> int:
        """Row of the leader."""
        return leader_index(self.scenario)

    @cached_property
    def scheduled_moves(self) -> tuple[Move, ...]:
        """The changes that begin at a time or a gate."""
        return tuple(move for move in self.moves if move.trigger != AUTO)

    @cached_property
    def passages(self) -> tuple[Passage, ...]:
        """The route points ahead, with their times. Raises ValueError for more times than points."""
        return passages(self.scenario, self.route_s)

    @cached_property
    def lines(self) -> tuple[LegLine, ...]:
        """The drawn lines of the legs ahead, with what this plan keeps of them and what the scenario says."""
        ahead = len(self.route_s) + 1
        every = leg_lines(self.scenario)
        lines = every[len(every) - ahead :] if self.begin_state is None else remaining_lines(every, ahead)
        limits = (*[NO_LIMITS] * (len(lines) - len(self.leg_limits)), *self.leg_limits)
        return tuple(line.within(kept) for line, kept in zip(lines, limits, strict=True))

    @property
    def t_start_s(self) -> float:
        """Begin of the take-off, s."""
        return self.leader_trajectory.start_s

    @property
    def airborne_s(self) -> float:
        """End of the take-off, s; the plan's begin where it begins in the air."""
        return next((p.end_s for p in self.phases if p.name == PhaseKind.TAKEOFF), self.t_start_s)

    @property
    def landing_s(self) -> float:
        """Begin of the landing, s: then it is ordered."""
        return self.phase(PhaseKind.LANDING).start_s

    @property
    def t_end_s(self) -> float:
        """End of the landing, s."""
        return self.leader_trajectory.end_s

    @property
    def flight_s(self) -> float:
        """Arrival time t_f of the paper's problem, s."""
        return self.scenario.time.flight_s

    @cached_property
    def joints_s(self) -> Array:
        """Instants where polynomials of the leader or of the shape join."""
        return np.union1d(self.leader_trajectory.joints_s, self.shape.joints_s)

    @cached_property
    def pads_ned_m(self) -> Array:
        """Ground points (V, 3) from which the vehicles take off."""
        return pads_ned_m(self.scenario)

    @cached_property
    def landing_points_ned_m(self) -> Array:
        """Ground points (V, 3) on which the vehicles land: below their places when the landing begins."""
        return landing_points_ned_m(self.scenario, self.shape.at(self.phase(PhaseKind.LANDING).start_s))

    def clamped(self, t_s: Array | float) -> Array:
        """Plan times (N,), those before and after the plan moved to its ends; one instant is N = 1."""
        return np.asarray(np.clip(np.atleast_1d(t_s), self.t_start_s, self.t_end_s))

    def phase(self, name: str) -> Phase:
        """The phase of that name."""
        return next(p for p in self.phases if p.name == name)

    def offsets(self, t_s: Array, order: int = 0) -> Array:
        """Offsets from the leader, or their `order`-th time derivative: (V, N, 3)."""
        return self.shape.offsets(t_s, order)

    def states(self, t_s: Array) -> Array:
        """States (V, N, 12) of all vehicles: the leader's, moved by the shape (Eq. 22)."""
        return self.motion(t_s)[0]

    def named_states(self, t_s: Array) -> NamedStates:
        """The same states (V, N, 12), their columns by name."""
        return NamedStates(self.states(t_s))

    def controls(self, t_s: Array) -> Array:
        """Controls (V, N, 4) of all vehicles: the leader's, plus what moves a vehicle within the shape."""
        return self.motion(t_s)[1]

    def motion(self, t_s: Array, rows: slice | Rows = EVERYONE) -> tuple[Array, Array]:
        """States and controls of the vehicles in `rows`: (V, N, 12) and (V, N, 4); one instant is N = 1."""
        leader, t_s = self.leader_trajectory, np.atleast_1d(t_s)
        return formation_motion(leader.state, leader.control, self.shape, self.quadrotor, t_s, rows)

    def accelerations(self, t_s: Array) -> Array:
        """Accelerations (V, N, 3) in NED, by Eq. 1 from states and controls."""
        return derivative(*self.motion(t_s), self.quadrotor)[..., VELOCITY]

    def jerks(self, t_s: Array) -> Array:
        """Jerks (V, N, 3) in NED: the leader's by Eq. 1 from its polynomials, plus those of the shape."""
        leader = self.leader_trajectory
        return formation_jerks(leader.state, leader.control, self.shape, self.quadrotor, t_s)

    def information_graph(self, t_s: float) -> InformationGraph:
        """The graph (Eq. 3) of whose state each vehicle needs when it follows telemetry, for the shape at t_s."""
        return information_graph(self.scenario.formation.topology, self.shape.at(t_s), self.leader)

    def formation_error_m(self, t_s: Array, positions_ned_m: Array) -> Array:
        """Formation error (N,), m, by Definition 1 for positions (V, N, 3) flown at plan times t_s (N,)."""
        return formation_error_m(positions_ned_m, self.offsets(t_s))

    def separations_m(self, t_s: Array, positions_ned_m: Array | None = None) -> Array:
        """Distance (N,) between the nearest two vehicles at plan times (N,), of positions (V, N, 3) or as planned."""
        return separations_m(self._places(t_s, positions_ned_m))

    def zone_distances_m(self, t_s: Array, positions_ned_m: Array | None = None) -> Array:
        """Distance (V, N) to the edge of the nearest no-fly zone: negative inside, infinite without zones."""
        return zone_distances_m(self.scenario, t_s, self._places(t_s, positions_ned_m), self.zones_since_s)

    def ground_distances_m(self, t_s: Array, positions_ned_m: Array | None = None, *, reach_m: float = 50.0) -> Array:
        """Distance (V, N) to the ground in any direction; `reach_m` where it is larger."""
        return ground_distances_m(self.scenario, self._places(t_s, positions_ned_m), reach_m)

    def _places(self, t_s: Array, positions_ned_m: Array | None) -> Array:
        return self.states(t_s)[..., POSITION] if positions_ned_m is None else positions_ned_m

    def __str__(self) -> str:
        begin, end = (self._leader_place(t_s) for t_s in (max(0.0, self.t_start_s), self.flight_s))
        phases = ", ".join(f"{phase.name} {phase.duration_s:g} s" for phase in self.phases)
        vehicles = "1 vehicle" if len(self.sysids) == 1 else f"{len(self.sysids)} vehicles"
        return (
            f"plan {self.scenario.name}: {vehicles}, {self.flight_s:.1f} s of flight, cost {self.objective:.4f}\n"
            f"  leader {self.sysids[self.leader]} from ({begin}) to ({end}) m north, east, up\n"
            f"  t = {self.t_start_s:.1f} to {self.t_end_s:.1f} s: {phases}"
        )

    __repr__ = __str__

    def _leader_place(self, t_s: float) -> str:
        north, east, down = self.leader_trajectory.state(t_s)[POSITION].tolist()
        return ", ".join(f"{round(metres, 1) + 0.0:.1f}" for metres in (north, east, -down))

    @cached_property
    def content(self) -> str:
        """All that a verdict depends on: what is flown, the state that it begins with, and the changes of shape."""
        return f"{self.hash} {self.begin_state} {self.moves} {self.leg_limits or ''} {self.used_before or ''}"

    @cached_property
    def hash(self) -> str:
        """Hex digest over everything that is flown."""
        digest = hashlib.sha256(self.scenario.model_dump_json().encode() + repr(self.phases).encode())
        for part in (self.leader_trajectory.state, self.leader_trajectory.control, self.shape.functions):
            digest.update(np.ascontiguousarray(part.x).tobytes())
            digest.update(np.ascontiguousarray(part.c).tobytes())
        digest.update(np.ascontiguousarray(self.shape.basis_ned_m).tobytes())
        if self.route_s:
            digest.update(repr(self.route_s).encode())
        return digest.hexdigest()
