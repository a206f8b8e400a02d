"""Mesh refinement: solve, verify between the nodes, refine the mesh, and repeat until nothing is violated.

A constraint that is violated between nodes is enforced where it is violated most. Intervals over which Eq. 1 drifts are
halved.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from gcs.errors import Infeasible, PlanningError
from gcs.physics.quadrotor import hover_trim
from gcs.physics.states import RATES, VELOCITY
from gcs.plan.formation.coordinates import composed
from gcs.plan.formation.followers import formation_motion, rounded_thrust_polynomial
from gcs.plan.formation.shape import Rows, Shape, stretched
from gcs.plan.formation.timeline import Move, in_turn, lay, starts_at_points
from gcs.plan.nlp.instants import instants_at_ends, instants_between, instants_near_zones
from gcs.plan.nlp.ipopt import Solution, solve
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.route_phases import first_mesh
from gcs.plan.nlp.transcription import Program, transcribe
from gcs.plan.nlp.violations import (
    accel_reserve_mps2,
    complaints,
    find_violations,
    jerk_reserve_mps3,
    tightenings,
    turning_reserve_g,
)
from gcs.plan.ocp.problem import Problem
from gcs.plan.ocp.stage_functions import RowReach
from gcs.plan.trajectory.constraint_id import STATES, Form
from gcs.plan.trajectory.integration_windows import STEP_S, WINDOW_S, window_errors
from gcs.plan.trajectory.leg_lines import LegLine
from gcs.plan.trajectory.plan import MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.clearance_floor import clearance_floor_m
from gcs.scenario.environment.no_fly import ZoneName
from gcs.types import Array

DEGREE = 5
LONGEST_S, SHORTEST_S = 9.0, 1.0
MAX_ROUNDS = 8
# Coordinates of the shape move within a few intervals.
LONGEST_MOVING_S = 6.0
_SETTLED = 1e-2  # of the time, where that is free
WINDOW_TOLERANCE_M = 5e-3  # half of the verifier's tolerance
# Added to the clearance at the nodes: then the ground between them rarely needs another solve.
CLEARANCE_RESERVE_M = 0.03
FROM_GUESS, FROM_SOLUTION = RowReach(30.0, 60.0), RowReach(8.0, 25.0)
BETWEEN_RESERVE_M = 5e-3  # added to the distance from zones at instants between nodes
BETWEEN_SHARE = 1e-3  # of a rate's limit, that is kept there in reserve
_RATES = STATES[RATES]
_RESERVED_S = 20.0  # from the start, until when the reserve beside zones grows
_RESERVES = (1.0, 0.8, 0.6, 0.4, 0.2)  # shares of it


@dataclass(frozen=True)
class Warm:
    """The mesh and the solution of a similar problem, from which a flight is solved again."""

    mesh: Mesh
    solution: Solution


@dataclass(frozen=True)
class Optimum:
    """A trajectory that is verified between its nodes, its cost and its refinement history."""

    trajectory: Trajectory  # of the leader
    shape: Shape
    objective: float
    history: tuple[MeshRound, ...]
    moves: tuple[Move, ...] = ()
    point_s: tuple[float, ...] = ()  # when the leader arrives at each point of the route
    last: Warm | None = None  # for a flight of several legs
    lines: tuple[LegLine, ...] = ()  # that the leader keeps to


def optimise(
    problem: Problem,
    guess: Trajectory,
    on_round: Callable[[MeshRound], None] = lambda _: None,
    *,
    near: bool = False,
    warm: Warm | None = None,
    most: int | None = None,
) -> Optimum:
    """The best trajectory near a guess. Raises PlanningError where every mesh leaves violations between its nodes.

    `near`: the guess is the solution of a similar problem. `warm`: it is that solution, on its mesh. `most`: the
    largest number of iterations of each solve.
    """
    problem = replace(problem, clearance_reserve_m=clearance_reserve_m(problem))
    longest_s = LONGEST_S if all(c.free_end for c in problem.coordinates) else LONGEST_MOVING_S
    shortest_s = SHORTEST_S if problem.start_thrust_N is None else 0.5 * SHORTEST_S
    mesh = first_mesh(problem, longest_s, shortest_s, DEGREE) if warm is None else warm.mesh
    if warm is None:
        beside = instants_near_zones(problem, mesh, guess) if problem.has_box else instants_at_ends(mesh)
        mesh = mesh.enforcing_at(beside)
    # A route at constant speed is near a flight; coordinates and legs are guessed less well.
    near = near or not (problem.coordinates or problem.points or problem.shape.moving_s)
    trajectory = guess
    solution = None if warm is None else warm.solution
    history: list[MeshRound] = []
    for _ in range(MAX_ROUNDS):
        reach = FROM_GUESS if solution is None and not problem.follows_course else FROM_SOLUTION
        program = _with_reserve(transcribe(problem, mesh, trajectory, reach=reach), problem)
        solution = solve(program, program.scaled(trajectory), solution, near=near and solution is None, most=most)
        trajectory = program.trajectory(solution.y)
        before, mesh = mesh, program.mesh(solution.y)
        late = float(np.abs(mesh.joints_s - before.joints_s).max()) / problem.duration_s
        if problem.points:
            solution = moved(solution, before, mesh)
        problem = with_times(problem, trajectory.end_s, tuple(mesh.joints_s[mesh.arrivals].tolist()))
        shape = flown_shape(problem, trajectory)
        missed = find_violations(problem, trajectory, shape)
        problems = complaints(missed)
        drifting, drift = drifting_intervals(problem, trajectory, shape)
        history.append(
            MeshRound(
                mesh.intervals,
                program.layout.size,
                len(mesh.extra_s),
                solution.iterations,
                solution.seconds,
                solution.objective,
                (*problems, *drift),
            )
        )
        on_round(history[-1])
        # Q of Eq. 33 depends on the times of the nodes and of the end: where they have moved, solve once more.
        if not problems and not drift and late < _SETTLED:
            last = Warm(mesh, solution) if problem.points else None
            cost, lines = solution.objective, problem.lines
            return Optimum(trajectory, shape, cost, tuple(history), point_s=problem.point_s, last=last, lines=lines)
        problem = replace(
            problem,
            tightenings=(*problem.tightenings, *tightenings(problem, missed)),
            accel_reserve_mps2=problem.accel_reserve_mps2 + accel_reserve_mps2(missed),
            jerk_reserve_mps3=problem.jerk_reserve_mps3 + jerk_reserve_mps3(missed),
            turning_reserve_g=turning_reserve_g(problem.scenario, problem.turning_reserve_g, missed),
        )
        mesh = mesh.split(drifting)
        mesh = mesh.enforcing_at(instants_between(mesh, missed))
    leg = problem.leg_at(max(missed, key=attrgetter("tolerated")).t_s) if missed else ""
    raise PlanningError.because(
        f"{MAX_ROUNDS} refinements of the mesh were not enough: {'; '.join(history[-1].complaints)}"
        + (f", in {leg}" if leg else ""),
        hint="relax this limit a little, or give the flight more time ([time] flight_s)",
        legs=problem.leg_of(np.array([miss.t_s for miss in missed])).tolist() if problem.points and missed else (),
    )


def _with_reserve(program: Program, problem: Problem) -> Program:
    """The program with its reserves beside zones and, between nodes, of rates; the flight may begin as near to a zone
    as it is."""
    between = set(program.layout.mesh.extra_s.tolist())
    g_low, g_high = program.g_low.copy(), program.g_high.copy()
    for row, (constraint, t_s) in enumerate(program.g_ids):
        if isinstance(constraint.of, ZoneName):
            g_low[row] += problem.zone_reserve_m * min((t_s - problem.start_s) / _RESERVED_S, 1.0)
            g_low[row] += BETWEEN_RESERVE_M * (t_s in between)
        elif constraint.kind in _RATES and constraint.form is Form.BOUND:
            g_low[row], g_high[row] = (1.0 - BETWEEN_SHARE) * g_low[row], (1.0 - BETWEEN_SHARE) * g_high[row]
    return replace(program, g_low=g_low, g_high=g_high)


def with_times(problem: Problem, end_s: float, point_s: tuple[float, ...]) -> Problem:
    """The same problem with another end and other times at the points of its route, where changes of shape begin."""
    starts_s = starts_at_points(problem.scenario, point_s)
    timed = replace(with_end(problem, end_s), point_s=point_s)
    if starts_s is None:
        return timed
    try:
        starts_s = in_turn(problem.scenario, starts_s, end_s)
        return replace(timed, shape=lay(problem.scenario, starts_s, problem.start_s, end_s).shape)
    except Infeasible:
        return timed  # the flight may still find times that fit


def with_end(problem: Problem, end_s: float) -> Problem:
    """The same problem with another end; changes of the shape, and points, keep their shares of the time."""
    if end_s == problem.end_s:
        return problem
    factor = (end_s - problem.start_s) / problem.duration_s
    tighter = tuple(t.stretched(problem.start_s, factor) for t in problem.tightenings)
    shape = stretched(problem.shape, problem.start_s, end_s)
    point_s = tuple(problem.start_s + factor * (t_s - problem.start_s) for t_s in problem.point_s)
    return replace(problem, end_s=end_s, shape=shape, tightenings=tighter, point_s=point_s)


def flown_shape(problem: Problem, trajectory: Trajectory) -> Shape:
    """The scheduled shape, transformed by the coordinates in the solution."""
    if not problem.coordinates:
        return problem.shape
    names = [c.name for c in problem.coordinates]
    return composed(problem.shape, problem.target_ned_m, names, trajectory.coordinates)


def clearance_reserve_m(problem: Problem, most_m: float = CLEARANCE_RESERVE_M) -> float:
    """The extra clearance in the program: `most_m`, or less where a vehicle starts or ends too low for that."""
    scenario = problem.scenario
    leader = np.stack([problem.start_state, problem.end_state])[:, None, :3]
    ends = leader + np.stack([problem.shape.at(problem.start_s), problem.shape.at(problem.end_s)])
    north, east, up = ends[..., 0], ends[..., 1], -ends[..., 2]
    for share in _RESERVES:
        kept_m = scenario.limits.clearance_min_m + share * most_m
        if np.all(up >= clearance_floor_m(scenario.terrain, north, east, kept_m)):
            return share * most_m
    return 0.0


def drifting_intervals(
    problem: Problem, trajectory: Trajectory, shape: Shape, *, quick: bool = False
) -> tuple[set[int], tuple[str, ...]]:
    """Intervals that overlap a 5 s window with too much drift, and a description of the largest drift.

    `quick` integrates with steps twice as long.
    """
    step_s = 2.0 * STEP_S if quick else STEP_S
    trajectory = trajectory.vehicle
    joints, end_s = trajectory.joints_s, trajectory.end_s
    end = problem.end_state
    thrust, *lean = hover_trim(-float(end[2]), float(end[8]), problem.quadrotor)
    hover = np.array([thrust, 0.0, 0.0, 0.0])
    # After an end at rest the vehicle hovers; there an error of its final speed accumulates.
    stops = not end[VELOCITY].any() and not end[RATES].any() and np.allclose(end[6:8], lean, rtol=0.0, atol=1e-9)
    windows = window_errors(
        lambda t: trajectory.state(np.minimum(t, end_s))[None],
        lambda t: np.where((t > end_s)[:, None], hover, trajectory.control(np.minimum(t, end_s)))[None],
        np.append(joints, end_s + WINDOW_S) if stops else joints,
        problem.quadrotor,
        step_s=step_s,
    )
    starts_s, error_m = windows.start_s, windows.error_m[0]
    if shape.apart_s(problem.quadrotor.wind):
        offsets = shape.at(problem.start_s)
        outermost = np.unique(
            [np.linalg.norm(offsets, axis=1).argmax(), offsets[:, 2].argmin(), offsets[:, 2].argmax()]
        )
        windows = window_errors(
            lambda t: _motion(trajectory, shape, problem, t, outermost)[0],
            lambda t: _motion(trajectory, shape, problem, t, outermost)[1],
            # A window may begin in the middle of a bend, where the vehicle's speed is off by most.
            np.union1d(rounded_thrust_polynomial(trajectory.control).x, shape.joints_s),
            problem.quadrotor,
            step_s=step_s,
        )
        starts_s = np.append(starts_s, windows.start_s)
        error_m = np.append(error_m, windows.error_m.max(axis=0))
    if error_m.max() <= WINDOW_TOLERANCE_M:
        return set(), ()
    bad = starts_s[error_m > WINDOW_TOLERANCE_M]
    overlap = (joints[1:] > bad[:, None]) & (joints[:-1] < bad[:, None] + WINDOW_S)
    intervals = set(np.flatnonzero(overlap.any(axis=0)).tolist())
    longest = max(np.diff(joints)[list(intervals)])
    # The long intervals cause the drift; halving the short ones beside them would only cost time.
    intervals = {i for i in intervals if joints[i + 1] - joints[i] > 0.5 * longest}
    worst_s = starts_s[error_m.argmax()]
    return intervals, (f"Eq. 1 drifts by {error_m.max() * 1e3:.1f} mm in the {WINDOW_S:g} s from t = {worst_s:.1f} s",)


def _motion(trajectory: Trajectory, shape: Shape, problem: Problem, t_s: Array, rows: Rows) -> tuple[Array, Array]:
    return formation_motion(trajectory.state, trajectory.control, shape, problem.quadrotor, t_s, rows)


def moved(solution: Solution, before: Mesh, after: Mesh) -> Solution:
    """The solution with each multiplier at the time to which its row moved with the joints of the mesh."""
    times = np.interp([t_s for _, t_s in solution.g_multipliers], before.joints_s, after.joints_s).tolist()
    rows = zip(solution.g_multipliers.items(), times, strict=True)
    return replace(solution, g_multipliers={(one, t_s): price for ((one, _), price), t_s in rows})
