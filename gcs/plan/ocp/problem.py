"""The leader's optimal control problem in numbers (Eqs. 15-35, Eq. 51): one flight between two states, SI and NED."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from gcs.physics.quadrotor import Quadrotor, hover_trim
from gcs.physics.states import ATTITUDE, POSITION, RATES, VELOCITY
from gcs.plan.formation.coordinates import Coordinate, coordinates, target_ned_m
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.formation.time_scaling import Budget, budget
from gcs.plan.ocp.representatives import Representatives, representatives
from gcs.plan.ocp.route_points import PassPoint, pass_points
from gcs.plan.trajectory.leg_lines import LegLine, leg_lines
from gcs.scenario.schema.scenario import Scenario, TerminalWeight
from gcs.scenario.values.si import (
    boundary_state,
    heading_ref_deg,
    height_ref_m,
    leader_index,
    offsets_ned_m,
    quadrotor,
    torque_limits,
)
from gcs.types import Array

_SAMPLES, _SAMPLED = 500, 1e-3  # instants of a change of the shape, and what is added for the path between them

_LEAST_S = 1.0  # of flight between holds, for the reference speed
_LEAST_JERK = 0.1  # share of the limit that always remains for the leader


@dataclass(frozen=True)
class Objective:
    """Weights and references of Eq. 35. Each term is divided by its reference, so that weights are comparable."""

    energy_weight: float
    heading_weight: float
    height_weight: float
    terminal_weight: TerminalWeight  # Q(t) of Eq. 33
    speed_ref_mps: float  # constant speed of the straight flight: one unit of energy
    heading_ref_rad: float
    heading_scale_rad: float
    height_ref_m: float
    height_scale_m: float


@dataclass(frozen=True)
class FreeTime:
    """A time of flight that is an unknown of the program, and what it costs."""

    earliest_s: float
    latest_s: float
    weight: float  # cost of `reference_s` seconds
    reference_s: float  # also the time over which energy is a mean

    @property
    def is_fixed(self) -> bool:
        """Whether one time is left."""
        return self.earliest_s == self.latest_s


class Share(Enum):
    """How the rate of a term becomes a cost."""

    MEAN = "integral over the flight, divided by its (reference) time"
    TERMINAL = "mean over the flight, weighted by Q(t) of Eq. 33"
    DURATION = "rate times the time of flight, divided by the scale; counted where the time is free"


@dataclass(frozen=True)
class Flights:
    """All flights that are at least so long, and last between `shortest_s` and `longest_s`."""

    length_m: float
    shortest_s: Array  # (N,)
    longest_s: Array  # (N,)


# rate(problem, x, u, scale): from state x and control u of the leader at one instant (CasADi scalars; SI, NED).
# Behind the 12 states stand value, rate, acceleration and jerk of each coordinate of the shape, and behind those the
# scheduled offset (3) and its rate (3) of each representative.
Rate = Callable[["Problem", Sequence[ca.SX], Sequence[ca.SX], float], "ca.SX | float"]
# bound(problem, flights, scale): a number, or (N,) numbers, that the term's cost is never below.
Bound = Callable[["Problem", Flights, float], "float | Array"]


@dataclass(frozen=True)
class ObjectiveTerm:
    """One row: a term of the objective. Its cost is `weight` times the share of its rate."""

    name: str
    share: Share
    weight: Callable[[Problem], float]  # 0 or more; a term of weight 0 is left out
    scale: Callable[[Problem], float]  # reference: the term is 1 where what it measures is of this size
    rate: Rate
    lower_bound: Bound


@dataclass(frozen=True)
class Tightening:
    """A bound of the leader that is tighter for a while: another vehicle violated a limit in an earlier round."""

    column: int  # of the state, or 12 + that of the control
    start_s: float
    end_s: float
    by: float  # SI, at both ends of the range

    def stretched(self, start_s: float, factor: float) -> Tightening:
        """The same in a flight from `start_s` that is `factor` times as long."""
        begin, end = (start_s + factor * (t - start_s) for t in (self.start_s, self.end_s))
        return replace(self, start_s=begin, end_s=end)


@dataclass(frozen=True)
class HeadingEnds:
    """The heading that a formation turning with its course has where a re-plan takes over, and where it lands."""

    zero_rad: float  # the direction that it is counted from
    start: Array  # (4,) with its rate, acceleration and jerk
    end_rad: float  # at rest


@dataclass(frozen=True)
class Problem:
    """The leader's flight from one state to another. The followers keep their offsets in a shape that may change.

    State and control bounds are those of each single vehicle; `gcs.plan.ocp.bounds` combines them for the leader.
    """

    scenario: Scenario
    quadrotor: Quadrotor
    start_s: float
    end_s: float
    start_state: Array  # (12,)
    end_state: Array  # (12,)
    state_low: Array  # (12,)
    state_high: Array  # (12,)
    control_low: Array  # (4,)
    control_high: Array  # (4,)
    shape: Shape  # scheduled offsets, before coordinates scale, turn and blend them
    objective: Objective
    extra_objectives: tuple[ObjectiveTerm, ...] = ()  # rows beside those of `objectives.TERMS`
    coordinates: tuple[Coordinate, ...] = ()
    clearance_reserve_m: float = 0.0  # added to the least clearance at the nodes
    zone_reserve_m: float = 0.0  # added to the distance from zones at the nodes, some time after the start
    accel_reserve_mps2: float = 0.0  # by how much a follower accelerated more than the leader in an earlier round
    jerk_reserve_mps3: float = 0.0  # by how much a vehicle's jerk exceeded its limit in an earlier round
    turning_reserve_g: float = 0.0  # by how much a vehicle's turning load factor exceeded its limit in earlier rounds
    free_time: FreeTime | None = None  # where given, end_s is a guess
    tightenings: tuple[Tightening, ...] = ()
    spare_disks: int = 0  # so many last zones are disks whose position and radius are parameters
    points: tuple[PassPoint, ...] = ()  # between the legs of the flight
    point_s: tuple[float, ...] = ()  # when the leader arrives at each of them: a guess
    heading: HeadingEnds | None = None  # of a re-plan; else it begins at zero and ends anywhere
    start_thrust_N: float | None = None  # of a flight that begins in the middle of another one: no step of acceleration
    begins: tuple[Array, ...] = ()  # of each coordinate, (4,) with its rate, acceleration and jerk; empty: at rest
    lines: tuple[LegLine, ...] = ()  # that the leader keeps to, one of each leg; empty: it flies freely

    @property
    def duration_s(self) -> float:
        """Length of the flight."""
        return self.end_s - self.start_s

    @property
    def legs_s(self) -> tuple[tuple[float, float], ...]:
        """Begin and end of each leg, by `point_s`; between two legs the leader holds, or no time passes."""
        begins = (self.start_s, *(t_s + point.hold_s for t_s, point in zip(self.point_s, self.points, strict=True)))
        return tuple(zip(begins, (*self.point_s, self.end_s), strict=True))

    def leg_of(self, t_s: Array) -> NDArray[np.intp]:
        """The leg (N,) that is flown at times (N,), by `point_s`; -1 in a hold."""
        begins, ends = np.array(self.legs_s).T
        leg = np.searchsorted(ends[:-1], t_s)
        return np.where(t_s < begins[leg], -1, leg)

    def leg_words(self, number: int) -> str:
        """Number (from 1) and ends of the leg with this index, for messages."""
        stops = ["start", *(point.name for point in self.points), "end"]
        return f"leg {number + 1} ({stops[number]} to {stops[number + 1]})"

    def leg_at(self, t_s: float) -> str:
        """The leg that is flown at a time, in words; empty for a flight without points."""
        if not self.points:
            return ""
        ends = [end_s for _, end_s in self.legs_s]
        return self.leg_words(int(np.searchsorted(ends[:-1], t_s)))

    @property
    def stops_ned_m(self) -> Array:
        """Start, points and end (P + 2, 3) of the leader's flight."""
        places = [point.place_ned_m for point in self.points]
        return np.array([self.start_state[POSITION], *places, self.end_state[POSITION]])

    @property
    def mean_s(self) -> float:
        """Time by which the objective's means divide: that of the flight, or the reference where it is free."""
        return self.duration_s if self.free_time is None else self.free_time.reference_s

    @property
    def control_limits(self) -> tuple[Array, Array]:
        """Eq. 51's control limits (4,), (4,), without the margin for feedback."""
        return control_bounds(self.scenario)

    @cached_property
    def change_budget(self) -> Budget:
        """Speed, acceleration, jerk and snap that the shape's own motion may use."""
        return budget(self.scenario)

    @cached_property
    def jerk_left_mps3(self) -> float | None:
        """The jerk that the leader may have, in m/s^3: the limit, less what the shape's own motion may add."""
        most = self.scenario.limits.jerk_max_mps3
        if most is None:
            return None
        shape = self.change_budget.jerk_mps3 if self.coordinates or self.shape.moving_s else 0.0
        return max(most - shape - self.jerk_reserve_mps3, _LEAST_JERK * most)

    @cached_property
    def target_ned_m(self) -> Array:
        """Shape (V, 3) that a blend ends in."""
        return target_ned_m(self.scenario)

    @cached_property
    def has_heights(self) -> bool:
        """Whether vehicles fly higher or lower than the leader in some shape."""
        return bool(self.shape.basis_ned_m[..., 2].any() or self.target_ned_m[:, 2].any())

    @property
    def follows_ground(self) -> bool:
        """Whether the line of some leg follows the ground."""
        return any(line.ground is not None for line in self.lines)

    @property
    def winds_differ(self) -> bool:
        """Whether vehicles at different heights fly in different winds."""
        return self.quadrotor.wind.has_shear and self.has_heights

    @cached_property
    def representatives(self) -> Representatives | None:
        """Vehicles that stand for all in the energy; None where all fly one velocity through the same air."""
        if self.vehicles == 1 or not (self.coordinates or self.shape.moving_s or self.winds_differ):
            return None
        return representatives(self.shape.basis_ned_m, self.target_ned_m, self.leader)

    @cached_property
    def centre_travel_m(self) -> float:
        """The greatest way of the vehicles' centre from the leader as the shape changes, m; inf if not limited."""
        if self.coordinates:
            return np.inf
        # A smooth function rises and falls between its values at many instants: a little more than those add up to.
        total_m = 0.0
        for start_s, end_s in self.shape.moving_s:
            centre = self.shape.offsets(np.linspace(start_s, end_s, _SAMPLES)).mean(axis=0)
            total_m += float(np.linalg.norm(np.diff(centre, axis=0), axis=1).sum())
        return (1.0 + _SAMPLED) * total_m

    @property
    def follows_course(self) -> bool:
        """Whether the formation turns with the leader's course."""
        return any(c.free_end for c in self.coordinates)

    @property
    def course_at_start_rad(self) -> float:
        """Direction in which the formation faces at its heading's zero: the first course, or yaw of a start at rest."""
        if self.heading is not None:
            return self.heading.zero_rad
        north, east = self.start_state[3:5]
        return float(np.arctan2(east, north) if north or east else self.start_state[8])

    @property
    def has_box(self) -> bool:
        """Whether the x-y box of Eq. 51 applies."""
        return bool(np.all(np.isfinite(self.state_low)))

    @property
    def leader(self) -> int:
        """Row of the leader."""
        return leader_index(self.scenario)

    @property
    def vehicles(self) -> int:
        """Number V of vehicles."""
        return int(self.shape.basis_ned_m.shape[1])


def flight_problem(scenario: Scenario, extra_objectives: tuple[ObjectiveTerm, ...] = ()) -> Problem:
    """The paper's problem (§2.6): from Eq. 15 at t = 0 to Eq. 16 at the scenario's time of flight."""
    low, high = state_bounds(scenario)
    problem = _problem(
        scenario,
        times_s=(0.0, scenario.time.flight_s),
        ends=(boundary_state(scenario, scenario.start), boundary_state(scenario, scenario.end)),
        box=(low, high),
    )
    points = pass_points(scenario)
    problem = replace(problem, coordinates=coordinates(scenario), extra_objectives=extra_objectives, points=points)
    problem = replace(problem, lines=leg_lines(scenario))
    if not points:
        return problem
    length_m = float(np.linalg.norm(np.diff(problem.stops_ned_m, axis=0), axis=1).sum())
    moving_s = problem.duration_s - sum(point.hold_s for point in points)
    return replace(problem, objective=references(scenario, length_m, max(moving_s, _LEAST_S)))


def references(scenario: Scenario, length_m: float, duration_s: float) -> Objective:
    """The scenario's weights and references for a flight whose ends are `length_m` apart."""
    table = scenario.objective
    energy, heading, height = table.weights
    return Objective(
        energy_weight=energy,
        heading_weight=heading,
        height_weight=height,
        terminal_weight=table.terminal_weight,
        speed_ref_mps=max(length_m / duration_s, 0.1),
        heading_ref_rad=float(np.radians(heading_ref_deg(scenario))),
        heading_scale_rad=float(np.radians(table.heading_scale_deg)),
        height_ref_m=height_ref_m(scenario),
        height_scale_m=table.height_scale_m,
    )


def run_up_problem(scenario: Scenario, hover_ned_m: Array) -> Problem:
    """From rest at the leader's hover `hover_ned_m` (3,) to the initial state at T0, outside the x-y box of Eq. 51."""
    low, high = state_bounds(scenario)
    low[:2], high[:2] = -np.inf, np.inf
    end = boundary_state(scenario, scenario.start)
    start = np.zeros(12)
    start[POSITION] = hover_ned_m
    start[8] = end[8]
    _, start[6], start[7] = hover_trim(-float(hover_ned_m[2]), float(end[8]), quadrotor(scenario))
    return _problem(scenario, times_s=(-scenario.ground_phases.run_up_s, 0.0), ends=(start, end), box=(low, high))


def state_bounds(scenario: Scenario) -> tuple[Array, Array]:
    """Eq. 51 as bounds (12,), (12,) of a vehicle's state."""
    limits = scenario.limits
    low, high = np.empty(12), np.empty(12)
    boxes = np.array([limits.north_m, limits.east_m, np.negative(limits.height_m)[::-1]])
    low[POSITION], high[POSITION] = boxes.T
    for part, bound in (
        (VELOCITY, np.array(limits.speed_ned_mps)),
        (ATTITUDE, np.radians(limits.roll_pitch_yaw_deg)),
        (RATES, np.radians(limits.rates_degps)),
    ):
        low[part], high[part] = -bound, bound
    return low, high


def control_bounds(scenario: Scenario, margin: float = 0.0) -> tuple[Array, Array]:
    """Eq. 51's control limits (4,), (4,), moved towards hover by `margin` of their distance to it."""
    limits = scenario.limits
    hover = np.array([quadrotor(scenario).weight_N, 0.0, 0.0, 0.0])
    torque = np.array(torque_limits(limits, scenario.vehicle.arm_m))
    low = np.concatenate([[limits.thrust_N[0]], -torque])
    high = np.concatenate([[limits.thrust_N[1]], torque])
    return hover + (1.0 - margin) * (low - hover), hover + (1.0 - margin) * (high - hover)


def _problem(
    scenario: Scenario, times_s: tuple[float, float], ends: tuple[Array, Array], box: tuple[Array, Array]
) -> Problem:
    """A flight between two times and two states (12,), within a box of states (12,), (12,)."""
    start_s, end_s = times_s
    start, end = ends
    control_low, control_high = control_bounds(scenario, scenario.limits.control_margin)
    length = float(np.linalg.norm((end - start)[POSITION]))
    return Problem(
        scenario=scenario,
        quadrotor=quadrotor(scenario),
        start_s=start_s,
        end_s=end_s,
        start_state=start,
        end_state=end,
        state_low=box[0],
        state_high=box[1],
        control_low=control_low,
        control_high=control_high,
        shape=rigid(offsets_ned_m(scenario), start_s, end_s),
        objective=references(scenario, length, end_s - start_s),
    )
