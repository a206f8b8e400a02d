"""The legs of a drawn route as phases of the program: first mesh, durations, and rows about the points between them."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse

from gcs.physics.quadrotor import Quadrotor, hover_trim
from gcs.physics.states import NX, POSITION, RATES, VELOCITY
from gcs.plan.formation.timeline import made_changes
from gcs.plan.nlp.assembly import LegConstants, PointFunctions, dm
from gcs.plan.nlp.mesh import HOLD, Mesh, end_refined
from gcs.plan.nlp.variables import VariableLayout
from gcs.plan.ocp.objective_sum import duration_cost
from gcs.plan.ocp.problem import Problem
from gcs.plan.ocp.route_points import PassPoint
from gcs.plan.trajectory.constraint_id import ConstraintId, Form, Kind
from gcs.types import Array

_LEG_S = 7.0  # longest interval of a leg
_GROWTH = 1.5


def first_mesh(problem: Problem, longest_s: float, shortest_s: float, degree: int) -> Mesh:
    """The mesh on which a flight is solved first; intervals are `longest_s` at most, `shortest_s` at its ends."""
    if not problem.points:
        return end_refined(problem.start_s, problem.end_s, longest_s, shortest_s, degree)
    joints: list[float] = [problem.start_s]
    degrees: list[int] = []
    legs: list[int] = []
    stops = [point.hold_s > 0.0 for point in problem.points]
    ends = [not state[VELOCITY].any() for state in (problem.start_state, problem.end_state)]
    rests = list(zip([ends[0], *stops], [*stops, ends[1]], strict=True))
    for leg, (start_s, end_s) in enumerate(problem.legs_s):
        if leg and problem.points[leg - 1].hold_s:
            joints.append(start_s)
            degrees.append(0)
            legs.append(HOLD)
        lengths = _lengths(end_s - start_s, min(longest_s, _LEG_S), shortest_s, rests[leg])
        joints += [*(start_s + np.cumsum(lengths[:-1])).tolist(), end_s]
        degrees += [degree] * len(lengths)
        legs += [leg] * len(lengths)
    return Mesh(np.array(joints), tuple(degrees), legs=tuple(legs))


def _lengths(duration_s: float, longest_s: float, shortest_s: float, rests: tuple[bool, bool]) -> Array:
    """Lengths of a leg's intervals: equal, but growing from `shortest_s` where the leader is at rest."""
    growing: list[float] = []
    step = shortest_s
    while step < longest_s:
        growing.append(step)
        step *= _GROWTH
    ramps = [np.array(growing if rest else []) for rest in rests]
    most_s = 0.4 * duration_s if all(rests) else 0.7 * duration_s
    ramps = [ramp[np.cumsum(ramp) <= most_s] for ramp in ramps]
    middle_s = duration_s - sum(float(ramp.sum()) for ramp in ramps)
    count = max(int(np.ceil(middle_s / longest_s)), 1)
    return np.concatenate([ramps[0], np.full(count, middle_s / count), ramps[1][::-1]])


_SPARE_S = 0.02  # between two changes
_SHORTER, _LONGER = 0.05, 20.0  # a leg's duration over that of its guess


@dataclass(frozen=True)
class LegTimes:
    """Bounds (K,), (K,) and ids of the legs' stretches, and rows (R, K) with bounds (R,), (R,), ids and times."""

    low: Array
    high: Array
    ids: tuple[ConstraintId, ...]
    rows: Array
    rows_low: Array
    rows_high: Array
    row_ids: tuple[tuple[ConstraintId, float], ...]


def leg_times(problem: Problem, mesh: Mesh) -> LegTimes | None:
    """The unknown durations of a flight; None where its time is given and it has one leg."""
    time = problem.free_time
    if not problem.points:
        if time is None:
            return None
        low, high = (np.array([t_s / problem.duration_s]) for t_s in (time.earliest_s, time.latest_s))
        return LegTimes(low, high, (ConstraintId(Kind.FLIGHT_TIME, Form.BOUND),), *_NO_ROWS)
    # Rows are the time in the air until a point, over the duration: of the legs before it, without the holds.
    lengths = mesh.leg_lengths_s / problem.duration_s
    count = len(lengths)
    held_s = np.cumsum([0.0, *(point.hold_s for point in problem.points)])
    low_s = [point.earliest_s - problem.start_s for point in problem.points]
    high_s = [point.latest_s - problem.start_s for point in problem.points]
    low_s.append(problem.duration_s if time is None else time.earliest_s)
    high_s.append(problem.duration_s if time is None else time.latest_s)
    ids = [ConstraintId(Kind.POINT_TIME, Form.ROW, point.name) for point in problem.points]
    ids.append(ConstraintId(Kind.FLIGHT_TIME))
    low, high = ((np.array(t_s) - held_s) / problem.duration_s for t_s in (low_s, high_s))
    bounded = np.isfinite(low) | np.isfinite(high)
    before = np.tril(np.ones((count, count))) * lengths
    times_s = [*problem.point_s, problem.end_s]
    changes = _changes(problem)
    spans = [before[last] - before[first] for _, first, last, _ in changes]
    return LegTimes(
        np.full(count, _SHORTER),
        np.full(count, _LONGER),
        tuple(ConstraintId(Kind.LEG_DURATION, Form.BOUND, leg) for leg in range(1, count + 1)),
        np.vstack([before[bounded], *spans]),
        np.append(low[bounded], [(s - held_s[b] + held_s[a]) / problem.duration_s for _, a, b, s in changes]),
        np.append(high[bounded], np.full(len(changes), np.inf)),
        (
            *((ids[row], times_s[row]) for row in np.flatnonzero(bounded)),
            *((ConstraintId(Kind.CHANGE_TIMES, Form.ROW, number), times_s[b]) for number, _, b, _ in changes),
        ),
    )


def _changes(problem: Problem) -> list[tuple[int, int, int, float]]:
    """Changes of shape that begin at a point: number, leg that ends there, leg that ends with the next one or the end.

    The last one is the time, s, that the legs between last at least.
    """
    if not all(point.name.number == n for n, point in enumerate(problem.points, start=1)):
        return []  # of a re-plan, whose changes have times
    made = made_changes(problem.scenario)
    begins = [m.change.at_point for m in made]
    ends = [*begins, len(problem.points) + 1][1:]
    return [
        (number, begin - 1, end - 1, m.duration_s + _SPARE_S)
        for number, (m, begin, end) in enumerate(zip(made, begins, ends, strict=True), start=1)
        if begin is not None and end is not None
    ]


def leg_constants(problem: Problem, mesh: Mesh, times: LegTimes) -> LegConstants:
    """The legs as the program is assembled with them."""
    cost = 0.0 if problem.free_time is None else duration_cost(problem)
    shares = mesh.leg_lengths_s / problem.duration_s if problem.points else np.ones(1)
    return LegConstants(cost * shares, mesh.leg_of_node, mesh.leg_of_interval, times.rows)


_NO_ROWS = np.zeros((0, 1)), np.zeros(0), np.zeros(0), ()


_MOTION = 6  # position and velocity


@dataclass(frozen=True)
class PointRows:
    """The functions of the rows, their bounds (R,), (R,), ids and times."""

    functions: PointFunctions
    low: Array
    high: Array
    ids: tuple[tuple[ConstraintId, float], ...]


def point_rows(problem: Problem, layout: VariableLayout, unit: Array, shift: Array) -> PointRows | None:
    """The rows of all points with a radius or a speed; None where there are none."""
    rows: list[ca.SX] = []
    ids: list[tuple[ConstraintId, float]] = []
    high: list[float] = []
    columns: list[int] = []
    symbols: list[ca.SX] = []
    for point, joint in zip(problem.points, layout.mesh.arrivals.tolist(), strict=True):
        if not point.radius_m and point.speed_mps is None:
            continue
        motion = ca.SX.sym(f"motion{point.name.number}", _MOTION)
        symbols.append(motion)
        columns += range(layout.joint(joint), layout.joint(joint) + _MOTION)
        t_s = float(layout.mesh.joints_s[joint])
        if point.radius_m:
            away = motion[:3] - ca.DM(point.place_ned_m)
            rows.append(1.0 - ca.dot(away, away) / point.radius_m**2)
            ids.append((ConstraintId(Kind.POINT_DISTANCE, Form.ROW, point.name), t_s))
            high.append(np.inf)
        if point.speed_mps is not None:
            rows.append(ca.dot(motion[3:], motion[3:]) / point.speed_mps**2 - 1.0)
            ids.append((ConstraintId(Kind.POINT_SPEED, Form.ROW, point.name), t_s))
            high.append(0.0)
    if not rows:
        return None
    every, values = ca.vertcat(*symbols), ca.vertcat(*rows)
    multipliers = ca.SX.sym("multipliers", len(rows))
    pick = sparse.csc_matrix((unit[columns], (np.arange(len(columns)), columns)), shape=(len(columns), layout.size))
    functions = PointFunctions(
        dm(pick),
        ca.DM(shift[columns]),
        ca.Function("points", [every], [values]),
        ca.Function("points_jacobian", [every], [ca.jacobian(values, every)]),
        ca.Function("points_hessian", [every, multipliers], [ca.hessian(ca.dot(multipliers, values), every)[0]]),
        len(rows),
    )
    return PointRows(functions, np.zeros(len(rows)), np.array(high), tuple(ids))


def fix_at_point(
    point: PassPoint, joint: int, quadrotor: Quadrotor, states: tuple[Array, Array], controls: tuple[Array, Array]
) -> None:
    """Equal bounds, low and high, of the state and control at a joint, for what a point of the route fixes there."""
    for bound in states:
        if not point.radius_m:
            bound[joint, POSITION] = point.place_ned_m
        if point.hover_state is not None:
            bound[joint, VELOCITY] = 0.0
            bound[joint, 6:8] = point.hover_state[6:8]
            bound[joint, RATES] = 0.0
            for derivative in (1, 2, 3):  # of each coordinate of the shape; its value stays free
                bound[joint, NX + derivative :: 4] = 0.0
        if point.yaw_ned_rad is not None:
            bound[joint, 8] = point.yaw_ned_rad
    if point.hover_state is None:
        return
    thrust, *_ = hover_trim(-float(point.place_ned_m[2]), float(point.hover_state[8]), quadrotor)
    for bound in controls:
        for end in (joint, joint + 1):
            bound[end] = 0.0
            bound[end, 0] = thrust
