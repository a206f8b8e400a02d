"""Solve, look between the nodes, add what was missed, solve again from there: until nothing is missed.

Knows: where to look and what to change in the mesh. Does not know: phases of a flight, files, verdicts.
Constraints broken between nodes are enforced where they are broken most; intervals over which Eq. 1 drifts are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import PlanningError
from gcs.physics.quadrotor import RATES, VELOCITY, Array, hover_trim
from gcs.plan.formation.changes.timeline import Move
from gcs.plan.formation.coordinates import composed
from gcs.plan.formation.followers import formation_motion
from gcs.plan.formation.shape import Rows, Shape, stretched
from gcs.plan.nlp.ipopt import Solution, solve
from gcs.plan.nlp.mesh import end_refined
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.nlp.violations import broken
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.plan import MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.reintegration import STEP_S, WINDOW_S, window_errors
from gcs.scenario.environment.terrain import ground_envelope_m

DEGREE = 5
LONGEST_S, SHORTEST_S = 9.0, 1.0
MAX_ROUNDS = 8
# Shapes that move by themselves do so within a few intervals.
LONGEST_MOVING_S = 6.0
_SETTLED = 1e-2  # of the time, where that is free
WINDOW_TOLERANCE_M = 5e-3  # half of what the verifier tolerates
# Kept from the ground at the nodes: what the smooth ground does between them is then rarely worth another solve.
CLEARANCE_RESERVE_M = 0.03


@dataclass(frozen=True)
class Optimum:
    """A trajectory that holds between its nodes, what it costs and how it was found."""

    trajectory: Trajectory  # of the leader
    shape: Shape
    objective: float
    history: tuple[MeshRound, ...]
    moves: tuple[Move, ...] = ()


def optimise(problem: Problem, guess: Trajectory, on_round: Callable[[MeshRound], None] = lambda _: None) -> Optimum:
    """The best trajectory near a guess; raises PlanningError when no mesh holds between its nodes."""
    problem = replace(problem, clearance_reserve_m=clearance_reserve_m(problem))
    longest_s = LONGEST_MOVING_S if problem.coordinates else LONGEST_S
    mesh = end_refined(problem.start_s, problem.end_s, longest_s, SHORTEST_S, DEGREE)
    trajectory = guess
    solution: Solution | None = None
    history: list[MeshRound] = []
    for _ in range(MAX_ROUNDS):
        program = transcribe(problem, mesh, trajectory)
        solution = solve(program, program.scaled(trajectory), solution)
        trajectory = program.trajectory(solution.y)
        stretch = program.stretch(solution.y)
        mesh = mesh.stretched(stretch)
        problem = lasting(problem, trajectory.end_s)
        shape = flown_shape(problem, trajectory)
        missed, complaints = broken(problem, trajectory, shape)
        drifting, drift = drifting_intervals(problem, trajectory, shape)
        history.append(
            MeshRound(
                mesh.intervals,
                program.layout.size,
                len(mesh.watch_s),
                solution.iterations,
                solution.seconds,
                solution.objective,
                (*complaints, *drift),
            )
        )
        on_round(history[-1])
        # Q of Eq. 33 weighs the end of the flight: where that has moved, it has to be laid anew.
        if not complaints and not drift and abs(stretch - 1.0) < _SETTLED:
            return Optimum(trajectory, shape, solution.objective, tuple(history))
        mesh = mesh.split(drifting).watching(missed)
    raise PlanningError(
        f"no plan: after {MAX_ROUNDS} refinements of the mesh there is still {'; '.join(history[-1].complaints)}",
        hint="loosen the constraint named above a little, or give the flight more time",
    )


def lasting(problem: Problem, end_s: float) -> Problem:
    """The same problem with another guess of its end; the shape's changes keep their shares of the time."""
    if end_s == problem.end_s:
        return problem
    return replace(problem, end_s=end_s, shape=stretched(problem.shape, problem.start_s, end_s))


def flown_shape(problem: Problem, trajectory: Trajectory) -> Shape:
    """The scheduled shape, as the coordinates in the solution bend it."""
    if not problem.coordinates:
        return problem.shape
    names = [c.name for c in problem.coordinates]
    return composed(problem.shape, problem.target_ned_m, names, trajectory.coordinates)


def clearance_reserve_m(problem: Problem, most_m: float = CLEARANCE_RESERVE_M) -> float:
    """`most_m`, or less where a vehicle starts or ends nearer to its limit than that."""
    scenario = problem.scenario
    leader = np.stack([problem.start_state, problem.end_state])[:, None, :3]
    ends = leader + np.stack([problem.shape.at(problem.start_s), problem.shape.at(problem.end_s)])
    ground = ground_envelope_m(scenario.terrain, ends[..., 0], ends[..., 1])
    spare = float((-ends[..., 2] - ground).min()) - scenario.limits.clearance_min_m
    return min(max(spare, 0.0), most_m)


def drifting_intervals(
    problem: Problem, trajectory: Trajectory, shape: Shape, *, quick: bool = False
) -> tuple[set[int], tuple[str, ...]]:
    """Intervals in which a window that drifts too far has its start, and the complaint in words.

    `quick` takes steps twice as long.
    """
    step_s = 2.0 * STEP_S if quick else STEP_S
    trajectory = trajectory.vehicle
    joints, end_s = trajectory.joints_s, trajectory.end_s
    end = problem.end_state
    thrust, *lean = hover_trim(-float(end[2]), float(end[8]), problem.quadrotor)
    hover = np.array([thrust, 0.0, 0.0, 0.0])
    # An end at rest goes on as a hover, in which an error of the last second's speed adds up.
    stops = not end[VELOCITY].any() and not end[RATES].any() and np.allclose(end[6:8], lean, rtol=0.0, atol=1e-9)
    windows = window_errors(
        lambda t: trajectory.state(np.minimum(t, end_s))[None],
        lambda t: np.where((t > end_s)[:, None], hover, trajectory.control(np.minimum(t, end_s)))[None],
        np.append(joints, end_s + WINDOW_S) if stops else joints,
        problem.quadrotor,
        step_s=step_s,
    )
    starts_s, error_m = windows.start_s, windows.error_m[0]
    if shape.moving_s:
        outermost = np.linalg.norm(shape.at(problem.start_s), axis=1).argmax()[None]
        windows = window_errors(
            lambda t: _motion(trajectory, shape, problem, t, outermost)[0],
            lambda t: _motion(trajectory, shape, problem, t, outermost)[1],
            np.union1d(joints, shape.joints_s),
            problem.quadrotor,
            step_s=step_s,
        )
        starts_s, error_m = np.append(starts_s, windows.start_s), np.append(error_m, windows.error_m[0])
    if error_m.max() <= WINDOW_TOLERANCE_M:
        return set(), ()
    bad = starts_s[error_m > WINDOW_TOLERANCE_M]
    intervals = {i for start in bad for i in _overlapping(joints, start, start + WINDOW_S)}
    longest = max(np.diff(joints)[list(intervals)])
    # The long ones are to blame; halving the short ones beside them would only cost time.
    intervals = {i for i in intervals if joints[i + 1] - joints[i] > 0.5 * longest}
    return intervals, (
        f"Eq. 1 drifts {error_m.max() * 1e3:.1f} mm in {WINDOW_S:g} s from {starts_s[error_m.argmax()]:.1f} s",
    )


def _motion(trajectory: Trajectory, shape: Shape, problem: Problem, t_s: Array, rows: Rows) -> tuple[Array, Array]:
    return formation_motion(trajectory.state, trajectory.control, shape, problem.quadrotor, t_s, rows)


def _overlapping(joints: Array, start: float, end: float) -> list[int]:
    return list(np.flatnonzero((joints[1:] > start) & (joints[:-1] < end)))
