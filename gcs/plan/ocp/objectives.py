"""The objective (Eq. 35) as a table: one row for each term, with its lower bound beside its cost.

A new term is one cost rate, one lower bound and one row of TERMS; `objective_sum` iterates over the rows. The search
discards a route when its lower bound is above the cost of a known flight. A bound that is too high would discard the
best route: tests/property/plan/test_objective_bounds.py tests every row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import casadi as ca
import numpy as np

from gcs.physics.quadrotor import Array, Quadrotor
from gcs.plan.formation.coordinates import Coordinate
from gcs.plan.nlp.variables import NX
from gcs.plan.ocp.representatives import NUMBERS, Representatives, motion
from gcs.plan.ocp.route_points import PassPoint
from gcs.scenario.schema.scenario import Scenario, TerminalWeight
from gcs.scenario.si import heading_ref_deg, height_ref_m

TERMINAL_WEIGHTS: dict[TerminalWeight, Callable[[Array, float], Array]] = {
    "1": lambda t, tf: np.ones_like(t),
    "t^2": lambda t, tf: t**2,
    "1/(tf-t+0.5)": lambda t, tf: 1.0 / (tf - t + 0.5),
    "1/(tf-t+0.5)^2": lambda t, tf: 1.0 / (tf - t + 0.5) ** 2,
}
_FACING_WEIGHT = 1.0  # of flying across the direction in which the formation faces
_CALM_YAW = 0.1  # of turning at the full rate: enough to choose one yaw where the other terms leave it open
_CALM = 1e-3  # of full acceleration of the shape: enough to choose the calmer of two motions of equal cost
_STILL = 1e-2  # of the reference speed: smooths |v| at rest, where |v|^3 has no second derivative


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


class Inputs(Protocol):
    """What a term may read: a `Problem`, as far as it does not depend on the terms."""

    @property
    def scenario(self) -> Scenario:
        """The scenario, with all its tables."""

    @property
    def quadrotor(self) -> Quadrotor:
        """The vehicle and the wind."""

    @property
    def objective(self) -> Objective:
        """Weights and references."""

    @property
    def extra_objectives(self) -> tuple[ObjectiveTerm, ...]:
        """Rows given by the caller."""

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """Degrees of freedom of the shape."""

    @property
    def free_time(self) -> FreeTime | None:
        """Bounds and weight of a free time of flight."""

    @property
    def duration_s(self) -> float:
        """Length of the flight; a guess where it is free."""

    @property
    def mean_s(self) -> float:
        """Time by which means divide."""

    @property
    def follows_course(self) -> bool:
        """Whether the formation turns with the leader's course."""

    @property
    def points(self) -> Sequence[PassPoint]:
        """The points between the legs; none between A and B."""

    @property
    def representatives(self) -> Representatives | None:
        """Vehicles that stand for all in the energy; None where all fly one velocity through the same air."""

    @property
    def centre_travel_m(self) -> float:
        """The most that the shape can move the vehicles' centre, seen from the leader; inf where it is not limited."""

    @property
    def course_at_start_rad(self) -> float:
        """Direction in which the formation faces at its heading's zero."""


# rate(problem, x, u, scale): from state x and control u of the leader at one instant (CasADi scalars; SI, NED).
# Behind the 12 states stand value, rate, acceleration and jerk of each coordinate of the shape, and behind those the
# scheduled offset (3) and its rate (3) of each representative.
Rate = Callable[[Inputs, Sequence[Any], Sequence[Any], float], Any]
# bound(problem, flights, scale): a number, or (N,) numbers, that the term's cost is never below.
Bound = Callable[[Inputs, Flights, float], "float | Array"]


@dataclass(frozen=True)
class ObjectiveTerm:
    """One row: a term of the objective. Its cost is `weight` times the share of its rate."""

    name: str
    share: Share
    weight: Callable[[Inputs], float]  # 0 or more; a term of weight 0 is left out
    scale: Callable[[Inputs], float]  # reference: the term is 1 where what it measures is of this size
    rate: Rate
    lower_bound: Bound


def energy_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], speed_ref_mps: float) -> Any:
    """Eqs. 30-32: the power against drag of each vehicle, as a mean over all; it depends on the air's velocity.

    The mean keeps the unit: in a rigid formation, where all vehicles fly one velocity, it is the leader's power.
    """
    sample = problem.representatives
    if sample is None:
        return drag_power(problem, x[3:6], x[2], speed_ref_mps)
    first = NX + 4 * len(problem.coordinates)
    total: Any = 0.0
    for i, (weight, target) in enumerate(zip(sample.weights.tolist(), sample.target_ned_m, strict=True)):
        numbers = x[first + NUMBERS * i : first + NUMBERS * (i + 1)]
        place, speed = motion(problem.coordinates, x[NX:first], numbers, target)
        velocity = [x[3 + axis] + speed[axis] for axis in range(3)]
        total += weight * drag_power(problem, velocity, x[2] + place[2], speed_ref_mps)
    return total


def drag_power(problem: Inputs, velocity: Sequence[Any], down: Any, speed_ref_mps: float) -> Any:
    """Eq. 32 for one vehicle, as a share of that at the reference speed."""
    wind_north, wind_east, _ = problem.quadrotor.wind.at(-down, ca)
    vx, vy, vz = velocity
    speed = ca.sqrt((vx - wind_north) ** 2 + (vy - wind_east) ** 2 + vz**2 + (_STILL * speed_ref_mps) ** 2)
    return (speed / speed_ref_mps) ** 3


def least_energy(problem: Inputs, flights: Flights, speed_ref_mps: float) -> float | Array:
    """Eqs. 30-32 at constant speed in the longest time: the mean of a cube is at least the cube of the mean.

    0 in wind: a tail wind may carry the vehicle. Lengths are the leader's. Where the shape moves, the mean velocity is
    that of the vehicles' centre, whose path is shorter by `centre_travel_m` at most; the leader's own share counts too.
    """
    if not problem.quadrotor.wind.is_still:
        return 0.0

    def constant(length_m: float) -> Array:
        return (length_m / flights.longest_s / speed_ref_mps) ** 3 * flights.longest_s / problem.mean_s

    if problem.representatives is None:
        return constant(flights.length_m)
    centre = constant(max(flights.length_m - problem.centre_travel_m, 0.0))
    return np.maximum(centre, float(problem.representatives.weights[0]) * constant(flights.length_m))


def heading_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], scale_rad: float) -> Any:
    """Eq. 33: yaw off its reference, and sideslip.

    Yaw alone cannot turn a quadrotor's track: to arrive from a direction takes yaw and course. At reference speed the
    angle between the two costs as much as yaw's angle to the reference: (2 v sin(angle / 2))^2; backwards costs most.
    """
    reference = problem.objective
    vx, vy, yaw = x[3], x[4], x[8]
    ground_speed = ca.sqrt(vx**2 + vy**2 + (_STILL * reference.speed_ref_mps) ** 2)
    forward = vx * ca.cos(yaw) + vy * ca.sin(yaw)
    slip = 2.0 * ground_speed * (ground_speed - forward) / (reference.speed_ref_mps * scale_rad) ** 2
    return ((yaw - reference.heading_ref_rad) / scale_rad) ** 2 + slip


def height_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], scale_m: float) -> Any:
    """Eq. 34: height off its reference."""
    return ((-x[2] - problem.objective.height_ref_m) / scale_m) ** 2


def shape_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], scale: float) -> Any:
    """Scale, heading and blend of the shape off their rest values, and a little for their acceleration."""
    total: Any = ca.SX(0)
    for c, coordinate in enumerate(problem.coordinates):
        value, _, acceleration, _ = x[NX + 4 * c : NX + 4 * c + 4]
        total += departure_cost(coordinate, value)
        total += _CALM * (acceleration / coordinate.most[1]) ** 2
    return total


def departure_cost(coordinate: Coordinate, value: Any) -> Any:
    """The cost rate of one coordinate of the shape at `value`, with its weight."""
    return coordinate.weight * ((value - coordinate.rest) / coordinate.unit) ** 2


def facing_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], speed_ref_mps: float) -> Any:
    """Speed across the direction in which the formation faces, where it turns with the leader's course."""
    across, _ = speed_across_and_along(problem, x)
    return (across / speed_ref_mps) ** 2


def yaw_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], scale_radps: float) -> Any:
    """Turning of the leader's yaw, as a share of its limit.

    Q(t) of Eq. 33 is small until the end of a long flight, so that the yaw at a distant point costs nothing.
    """
    return (x[11] / scale_radps) ** 2


def time_rate(problem: Inputs, x: Sequence[Any], u: Sequence[Any], reference_s: float) -> float:
    """The same for every second of flight."""
    return 1.0


def least_time(problem: Inputs, flights: Flights, reference_s: float) -> Array:
    """Cost of the shortest time."""
    return flights.shortest_s / reference_s


def zero(problem: Inputs, flights: Flights, scale: float) -> float:
    """Lower bound of a term that is never negative."""
    return 0.0


TERMS: tuple[ObjectiveTerm, ...] = (
    ObjectiveTerm(
        name="energy (Eqs. 30-32)",
        share=Share.MEAN,
        weight=lambda p: p.objective.energy_weight,
        scale=lambda p: p.objective.speed_ref_mps,
        rate=energy_rate,
        lower_bound=least_energy,
    ),
    ObjectiveTerm(
        name="heading (Eq. 33)",
        share=Share.TERMINAL,
        weight=lambda p: p.objective.heading_weight,
        scale=lambda p: p.objective.heading_scale_rad,
        rate=heading_rate,
        lower_bound=zero,
    ),
    ObjectiveTerm(
        name="height (Eq. 34)",
        share=Share.TERMINAL,
        weight=lambda p: p.objective.height_weight,
        scale=lambda p: p.objective.height_scale_m,
        rate=height_rate,
        lower_bound=zero,
    ),
    ObjectiveTerm(
        name="change of the shape",
        share=Share.MEAN,
        weight=lambda p: 1.0 if p.coordinates else 0.0,
        scale=lambda p: 1.0,  # every coordinate has a unit and a weight of its own
        rate=shape_rate,
        lower_bound=zero,
    ),
    ObjectiveTerm(
        name="facing along the course",
        share=Share.MEAN,
        weight=lambda p: _FACING_WEIGHT if p.follows_course else 0.0,
        scale=lambda p: p.objective.speed_ref_mps,
        rate=facing_rate,
        lower_bound=zero,
    ),
    ObjectiveTerm(
        name="turning of the yaw on a route",
        share=Share.MEAN,
        weight=lambda p: _CALM_YAW if p.points else 0.0,
        scale=lambda p: float(np.radians(p.scenario.limits.rates_degps[2])),
        rate=yaw_rate,
        lower_bound=zero,
    ),
    ObjectiveTerm(
        name="time of flight",
        share=Share.DURATION,
        weight=lambda p: p.free_time.weight if p.free_time else 0.0,
        scale=lambda p: p.free_time.reference_s if p.free_time else 1.0,
        rate=time_rate,
        lower_bound=least_time,
    ),
)


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


def speed_across_and_along(problem: Inputs, x: Sequence[Any]) -> tuple[Any, Any]:
    """The leader's speed across and along the direction in which the formation faces."""
    heading = x[NX + 4 * [c.name for c in problem.coordinates].index("heading")] + problem.course_at_start_rad
    c, s = ca.cos(heading), ca.sin(heading)
    return c * x[4] - s * x[3], c * x[3] + s * x[4]
