"""Violations between the nodes, of all vehicles on a fine grid: constraint, size and time.

Only vehicles near a limit are checked on the fine grid. The verifier later checks everything.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gcs.physics.states import VELOCITY
from gcs.plan.formation.followers import formation_jerks, formation_motion
from gcs.plan.formation.shape import Rows, Shape
from gcs.plan.ocp import margins
from gcs.plan.ocp.margins import Margin
from gcs.plan.ocp.problem import Problem, Tightening, control_bounds
from gcs.plan.trajectory.constraint_id import ANGLES, COLUMNS, ConstraintId, Kind
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from gcs.util.long_work import report

Evaluate = Callable[[Array], list[tuple[Margin, float]]]

CHECK_EVERY_S = 0.05  # no coarser than the verifier: a peak of yaw rate can last less than 0.1 s
# Half of the verifier's tolerances, so that its finer grid finds nothing new.
LENGTH_TOLERANCE_M = 0.4e-3
LIMIT_TOLERANCE = 0.5e-3
COURSE_TOLERANCE = 0.5e-2
_BLOCK_S = 10.0
# Limits of all vehicles behind which there is an unknown of the leader, and how much tighter and longer than the
# violation its bound becomes.
_LEADING = (Kind.ROLL, Kind.PITCH, Kind.ROLL_RATE, Kind.PITCH_RATE, Kind.U1, Kind.U2, Kind.U3, Kind.U4)
_EXCESS, _BESIDE_S = 1.2, 1.0
# Near a minimum that may violate a limit between two instants, intervals are divided so often, into so many parts.
_LEVELS, _PARTS = 4, 8
_MOST_TURNING = 0.2  # of the turning limit: so much of it is kept in reserve at most
# Larger fleets are first checked every 0.5 s. Vehicles farther than _FAR_M from a limit need no fine grid.
_FEW = 16
_COARSE_S, _FAR_M = 0.5, 0.2
_COARSE_EVERY = round(_COARSE_S / CHECK_EVERY_S)
_DIRECTIONS = 8
_HEIGHTS = 9  # of a large fleet, in a wind that differs with height


@dataclass(frozen=True)
class Violation:
    """One period in which a constraint is violated: by how much where it is worst, and when."""

    constraint: ConstraintId
    unit: str
    t_s: float
    by: float
    share: float  # of the limit's own size
    tolerated: float  # in units of the tolerance
    period_s: tuple[float, float] = (0.0, 0.0)  # begin and end
    beyond_leader: float = 0.0  # by how much more than the leader's own violation

    @property
    def by_si(self) -> float:
        """By how much; angles in radians."""
        return float(np.radians(self.by)) if self.constraint.kind in ANGLES else self.by

    def __str__(self) -> str:
        return f"{self.constraint} violated by {self.by:.3g} {self.unit} at t = {self.t_s:.1f} s"


def complaints(found: tuple[Violation, ...]) -> tuple[str, ...]:
    """A description of the worst violation of each constraint."""
    worst: dict[ConstraintId, Violation] = {}
    for miss in found:
        if miss.tolerated > (worst[miss.constraint].tolerated if miss.constraint in worst else 1.0):
            worst[miss.constraint] = miss
    return tuple(map(str, worst.values()))


def find_violations(problem: Problem, trajectory: Trajectory, shape: Shape) -> tuple[Violation, ...]:
    """All violations of the constraints that exceed their tolerance at some instant."""
    found = []
    for coarse_s, evaluate in _checks(problem, trajectory, shape):
        report("looking between the nodes")
        times, checked = _finely(coarse_s, evaluate)
        for margin, tolerance in checked:
            lowest = margin.value.min(axis=0)
            if lowest.min() >= -tolerance:
                continue
            for a, b in _periods(lowest < 0.0):
                at = a + int(np.argmin(lowest[a:b]))
                by = float(-lowest[at])
                sizes = by, by / margin.scale, by / tolerance
                period_s, leader_by = (float(times[a]), float(times[b - 1])), max(float(-margin.value[0, at]), 0.0)
                constraint, unit, t_s = margin.constraint, margin.unit, float(times[at])
                found.append(Violation(constraint, unit, t_s, *sizes, period_s, by - leader_by))
    return tuple(found)


def tightenings(problem: Problem, found: tuple[Violation, ...]) -> tuple[Tightening, ...]:
    """Bounds of the leader that prevent violations by vehicles that no constraint of the program describes."""
    sizes = control_bounds(problem.scenario)[1]
    made = []
    for miss in found:
        start_s, end_s = miss.period_s[0] - _BESIDE_S, miss.period_s[1] + _BESIDE_S
        kind = miss.constraint.kind
        if kind is Kind.ROTOR_SPEED:
            for u, size in enumerate(sizes.tolist()):
                made.append(Tightening(12 + u, start_s, end_s, _EXCESS * miss.by * size))
        elif kind in _LEADING and miss.beyond_leader > 0.0:
            if problem.winds_differ and kind in (Kind.ROLL, Kind.PITCH, Kind.U1):
                continue  # constraints at more instants prevent it
            by = replace(miss, by=miss.beyond_leader).by_si
            made.append(Tightening(COLUMNS[kind], start_s, end_s, _EXCESS * by))
    return tuple(made)


def accel_reserve_mps2(found: tuple[Violation, ...]) -> float:
    """How much a follower accelerates beyond the leader: in a wind that differs, by the corners of the leader's thrust.

    The constraint of the program is about the leader, whose acceleration all have in a rigid shape.
    """
    beyond = [miss.beyond_leader for miss in found if miss.constraint.kind is Kind.ACCELERATION]
    return _EXCESS * max(beyond, default=0.0)


def jerk_reserve_mps3(found: tuple[Violation, ...]) -> float:
    """By how much the jerk of some vehicle exceeds what the program's constraints leave for it."""
    return _EXCESS * max((miss.by for miss in found if miss.constraint.kind is Kind.JERK), default=0.0)


def turning_reserve_g(scenario: Scenario, before_g: float, found: tuple[Violation, ...]) -> float:
    """How much tighter the turning limit of the program becomes, g.

    Almost at rest a course turns at once: the peak of the load factor moves to between the next nodes, however many
    there are.
    """
    by_g = max((miss.by for miss in found if miss.constraint.kind is Kind.TURNING), default=0.0)
    return min(before_g + _EXCESS * by_g, _MOST_TURNING * scenario.limits.load_factor_max)


def _finely(times: Array, evaluate: Evaluate) -> tuple[Array, list[tuple[Margin, float]]]:
    """Margins at `times`, and between them wherever a margin could be lower than at both neighbours."""
    checked = evaluate(times)
    for _ in range(_LEVELS):
        intervals = np.flatnonzero(_may_hide(times, checked))
        if not len(intervals):
            break
        share = np.arange(1, _PARTS) / _PARTS
        between = (times[intervals, None] + np.diff(times)[intervals, None] * share).ravel()
        order = np.argsort(np.concatenate([times, between]), kind="stable")
        times = np.concatenate([times, between])[order]
        checked = [
            (replace(margin, value=np.concatenate([margin.value, more.value], axis=1)[:, order]), tolerance)
            for (margin, tolerance), (more, _) in zip(checked, evaluate(between), strict=True)
        ]
    return times, checked


def _may_hide(times: Array, checked: list[tuple[Margin, float]]) -> NDArray[np.bool_]:
    """Intervals (N - 1,) in which a margin that is satisfied at both ends may be violated.

    A convex curve lies above the straight lines through the two instants before and the two after, whether its
    minimum is round or a corner.
    """
    steps = np.diff(times)
    hidden = np.zeros(len(steps), dtype=bool)
    if len(times) < 4:
        return hidden
    inner = slice(1, -1)
    for margin, tolerance in checked:
        value = margin.value
        slopes = np.diff(value, axis=1) / steps
        left, right = slopes[:, :-2], slopes[:, 2:]
        low, high = value[:, 1:-2], value[:, 2:-1]
        falls = (left < 0.0) & (right > 0.0)
        gap = np.where(falls, left - right, -1.0)
        after = np.clip((high - low - right * steps[inner]) / gap, 0.0, steps[inner])
        least = np.where(falls, low + left * after, 0.0)
        hidden[inner] |= np.any(falls & (least < -tolerance) & (np.minimum(low, high) >= -tolerance), axis=0)
    return hidden & (steps <= 1.5 * CHECK_EVERY_S)


def _checks(problem: Problem, trajectory: Trajectory, shape: Shape) -> Iterator[tuple[Array, Evaluate]]:
    """For each block of time: instants, and the function that gives margins at instants with their tolerances."""
    count = max(int(np.ceil(problem.duration_s / _BLOCK_S)), 1) if problem.vehicles > _FEW else 1
    edges = np.linspace(problem.start_s, problem.end_s, count + 1)
    for low, high in itertools.pairwise(edges):
        times = np.linspace(low, high, int(np.ceil((high - low) / CHECK_EVERY_S)) + 1)
        rows = _near_a_limit(problem, trajectory, shape, float(low), float(high))
        if len(rows):
            yield times, partial(_positions, problem, trajectory, shape, rows)
        moving = shape.moves_apart(times, problem.quadrotor.wind)
        leader = np.array([problem.leader])
        for part, rows in ((times[~moving], leader), (times[moving], _fastest(problem, shape, times[moving]))):
            if len(part):
                yield part, partial(_motions, problem, trajectory, shape, rows)
        yield times, partial(_ranges, problem, trajectory)
        if problem.follows_course:
            yield times, partial(_facing, problem, trajectory)
        if problem.lines:
            yield times, partial(_beside_lines, problem, trajectory)


def _facing(problem: Problem, trajectory: Trajectory, times: Array) -> list[tuple[Margin, float]]:
    """How well the formation faces along its course."""
    velocities = trajectory.state(times)[:, VELOCITY]
    number = [c.free_end for c in problem.coordinates].index(True)
    heading_rad = trajectory.coordinates(times)[:, number] + problem.course_at_start_rad
    faced = margins.course(problem.scenario, velocities, heading_rad)
    return [(faced, COURSE_TOLERANCE * faced.scale)]


def _beside_lines(problem: Problem, trajectory: Trajectory, times: Array) -> list[tuple[Margin, float]]:
    """How near the leader keeps to the drawn line of each leg; one margin for each limit of each line."""
    states, legs = trajectory.state(times), problem.leg_of(times)
    found = []
    for leg, line in enumerate(problem.lines):
        kinds = (Kind.LEG_CORRIDOR, "m"), (Kind.LEG_HEIGHT, "m"), (Kind.LEG_YAW, "deg")
        for (kind, unit), most, off in zip(kinds, astuple(line.limits), line.off(states), strict=True):
            if np.isfinite(most):
                size = 1.0 if unit == "m" else float(np.degrees(1.0))
                kept = np.where(legs == leg, most - off, most) * size
                margin = Margin(ConstraintId(kind, of=line.number), unit, kept[None], most * size)
                found.append((margin, LENGTH_TOLERANCE_M if unit == "m" else LIMIT_TOLERANCE * margin.scale))
    return found


def _ranges(problem: Problem, trajectory: Trajectory, times: Array) -> list[tuple[Margin, float]]:
    """How far scale, heading and blend are within their ranges."""
    found = []
    for coordinate, value in zip(problem.coordinates, trajectory.coordinates(times).T, strict=True):
        inside = np.minimum(value - coordinate.low, coordinate.high - value)
        size = coordinate.high
        constraint = ConstraintId(Kind.COORDINATE, of=coordinate.name)
        found.append((Margin(constraint, "of its range", inside[None], size), LIMIT_TOLERANCE * size))
    return found


def _positions(
    problem: Problem, trajectory: Trajectory, shape: Shape, rows: Rows, times: Array
) -> list[tuple[Margin, float]]:
    places = trajectory.state(times)[:, :3] + shape.offsets(times, 0, rows)
    return [(margin, LENGTH_TOLERANCE_M) for margin in _of_places(problem, places, times)]


def _of_places(problem: Problem, places: Array, times: Array, within_m: float = margins.NEAR_M) -> list[Margin]:
    """The margins of places (V, N, 3) at times (N,): ground (up to `within_m`), zones, heights and box."""
    scenario = problem.scenario
    found = [margins.clearance(scenario, places, within_m), *margins.no_fly(scenario, places, times)]
    return [*found, margins.height(scenario, places), *(margins.box(scenario, places) if problem.has_box else [])]


def _near_a_limit(problem: Problem, trajectory: Trajectory, shape: Shape, start_s: float, end_s: float) -> Rows:
    """Rows of the vehicles to check on the fine grid over a block of time."""
    every_row = np.arange(problem.vehicles)
    if problem.vehicles <= _FEW:
        return every_row
    times = np.linspace(start_s, end_s, int(np.ceil((end_s - start_s) / _COARSE_S)) + 1)
    places = trajectory.state(times)[:, :3] + shape.offsets(times)
    near = np.zeros(problem.vehicles, dtype=bool)
    # Between two coarse instants a vehicle comes closer to anything by at most half the distance that it flies.
    reach = 0.5 * np.linalg.norm(np.diff(places, axis=1), axis=2).max(axis=1)
    for margin in _of_places(problem, places, times, _FAR_M + float(reach.max())):
        near |= margin.value.min(axis=1) < _FAR_M + reach
    return np.flatnonzero(near)


def _fastest(problem: Problem, shape: Shape, times: Array) -> Rows:
    """The leader's row, then those with the largest motion within the shape in some direction; of a few, all."""
    if problem.vehicles <= _FEW or not len(times):
        return np.roll(np.arange(problem.vehicles), -problem.leader)
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = np.stack([np.cos(angle), np.sin(angle)])
    rows = [np.array([problem.leader])]
    if problem.winds_differ:
        height = shape.offsets(times[::_COARSE_EVERY])[..., 2]
        spread = np.round(np.linspace(0, problem.vehicles - 1, _HEIGHTS)).astype(np.intp)
        rows.append(np.argsort(height, axis=0)[spread].ravel())
    for order in (1, 2):
        motion = shape.offsets(times[::_COARSE_EVERY], order)
        rows.append(np.argmax(motion[..., :2] @ directions, axis=0).ravel())
        rows.append(np.argmax(np.abs(motion[..., 2]), axis=0))
        rows.append(np.argmax(np.linalg.norm(motion, axis=2), axis=0))
    others = np.unique(np.concatenate(rows))
    return np.concatenate([rows[0], others[others != problem.leader]])


def _motions(
    problem: Problem, trajectory: Trajectory, shape: Shape, rows: Rows, times: Array
) -> list[tuple[Margin, float]]:
    scenario, vehicle = problem.scenario, trajectory.vehicle
    states, controls = formation_motion(vehicle.state, vehicle.control, shape, problem.quadrotor, times, rows)
    found = [*margins.state_limits(scenario, states), margins.turning(scenario, states, controls)]
    found += margins.control_limits(scenario, controls)
    found += margins.acceleration(scenario, states, controls)
    if scenario.limits.jerk_max_mps3 is not None:
        jerks = formation_jerks(vehicle.state, vehicle.control, shape, problem.quadrotor, times, rows)
        found += margins.jerk(scenario, jerks)
    found += margins.shape_motion(scenario, shape.offsets(times, 1, rows), shape.offsets(times, 2, rows))
    return [(margin, LIMIT_TOLERANCE * margin.scale) for margin in found]


def _periods(mask: Array) -> list[tuple[int, int]]:
    """Half-open index ranges in which `mask` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
