"""The objective (Eq. 35) as a table: one row for each term, with its lower bound beside its cost.

A new term is one cost rate, one lower bound and one row of TERMS; `objective_sum` iterates over the rows. The search
discards a route when its lower bound is above the cost of a known flight. A bound that is too high would discard the
best route: tests/property/plan/test_objective_bounds.py tests every row.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import casadi as ca
import numpy as np

from gcs.physics.states import NX
from gcs.plan.formation.coordinates import Coordinate, CoordinateName
from gcs.plan.ocp.problem import Flights, ObjectiveTerm, Problem, Share
from gcs.plan.ocp.representatives import NUMBERS, motion
from gcs.scenario.schema.scenario import TerminalWeight
from gcs.types import Array

_Value = TypeVar("_Value", ca.SX, float)
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


def energy_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], speed_ref_mps: float) -> ca.SX:
    """Eqs. 30-32: the power against drag of each vehicle, as a mean over all; it depends on the air's velocity.

    The mean keeps the unit: in a rigid formation, where all vehicles fly one velocity, it is the leader's power.
    """
    sample = problem.representatives
    if sample is None:
        return drag_power(problem, x[3:6], x[2], speed_ref_mps)
    first = NX + 4 * len(problem.coordinates)
    total = ca.SX(0)
    for i, (weight, target) in enumerate(zip(sample.weights.tolist(), sample.target_ned_m, strict=True)):
        numbers = x[first + NUMBERS * i : first + NUMBERS * (i + 1)]
        place, speed = motion(problem.coordinates, x[NX:first], numbers, target)
        velocity = [x[3 + axis] + speed[axis] for axis in range(3)]
        total += weight * drag_power(problem, velocity, x[2] + place[2], speed_ref_mps)
    return total


def drag_power(problem: Problem, velocity: Sequence[ca.SX], down: ca.SX, speed_ref_mps: float) -> ca.SX:
    """Eq. 32 for one vehicle, as a share of that at the reference speed."""
    wind_north, wind_east, _ = problem.quadrotor.wind.at(-down, ca)
    vx, vy, vz = velocity
    speed: ca.SX = ca.sqrt((vx - wind_north) ** 2 + (vy - wind_east) ** 2 + vz**2 + (_STILL * speed_ref_mps) ** 2)
    return (speed / speed_ref_mps) ** 3


def least_energy(problem: Problem, flights: Flights, speed_ref_mps: float) -> float | Array:
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


def heading_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], scale_rad: float) -> ca.SX:
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


def height_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], scale_m: float) -> ca.SX:
    """Eq. 34: height off its reference."""
    return ((-x[2] - problem.objective.height_ref_m) / scale_m) ** 2


def shape_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], scale: float) -> ca.SX:
    """Scale, heading and blend of the shape off their rest values, and a little for their acceleration."""
    total: ca.SX = ca.SX(0)
    for c, coordinate in enumerate(problem.coordinates):
        value, _, acceleration, _ = x[NX + 4 * c : NX + 4 * c + 4]
        total += departure_cost(coordinate, value)
        total += _CALM * (acceleration / coordinate.most[1]) ** 2
    return total


def departure_cost(coordinate: Coordinate, value: _Value) -> _Value:
    """The cost rate of one coordinate of the shape at `value`, with its weight."""
    return coordinate.weight * ((value - coordinate.rest) / coordinate.unit) ** 2


def facing_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], speed_ref_mps: float) -> ca.SX:
    """Speed across the direction in which the formation faces, where it turns with the leader's course."""
    across, _ = speed_across_and_along(problem, x)
    return (across / speed_ref_mps) ** 2


def yaw_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], scale_radps: float) -> ca.SX:
    """Turning of the leader's yaw, as a share of its limit.

    Q(t) of Eq. 33 is small until the end of a long flight, so that the yaw at a distant point costs nothing.
    """
    return (x[11] / scale_radps) ** 2


def time_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], reference_s: float) -> float:
    """The same for every second of flight."""
    return 1.0


def least_time(problem: Problem, flights: Flights, reference_s: float) -> Array:
    """Cost of the shortest time."""
    return flights.shortest_s / reference_s


def zero(problem: Problem, flights: Flights, scale: float) -> float:
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
        name="turning of the yaw",
        share=Share.MEAN,
        weight=lambda p: _CALM_YAW if p.points or p.start_thrust_N is not None else 0.0,
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


def speed_across_and_along(problem: Problem, x: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
    """The leader's speed across and along the direction in which the formation faces."""
    number = [c.name for c in problem.coordinates].index(CoordinateName.HEADING)
    heading = x[NX + 4 * number] + problem.course_at_start_rad
    c, s = ca.cos(heading), ca.sin(heading)
    return c * x[4] - s * x[3], c * x[3] + s * x[4]
