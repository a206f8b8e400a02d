"""Solve, look between the nodes, add what was missed, solve again from there: until nothing is missed.

Knows: where to look and what to change in the mesh. Does not know: phases of a flight, files, verdicts.
Constraints broken between nodes are enforced where they are broken most; intervals over which Eq. 1 drifts are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import PlanningError
from gcs.plan import margins
from gcs.plan.mesh import end_refined
from gcs.plan.problem import Problem
from gcs.plan.solve import Solution, solve
from gcs.plan.trajectory import MeshRound, Trajectory
from gcs.plan.transcription import transcribe
from gcs.plan.windows import WINDOW_S, window_errors
from gcs.quadrotor import POSITION, Array
from gcs.scenario.terrain import ground_envelope_m

DEGREE = 5
LONGEST_S, SHORTEST_S = 9.0, 1.0
MAX_ROUNDS = 8
LOOK_EVERY_S = 0.05  # no coarser than the verifier: a yaw rate can peak and pass within 0.1 s
# Half of what the verifier tolerates, so that its own finer grid finds nothing new.
CLEARANCE_TOLERANCE_M = 0.5e-3
LIMIT_TOLERANCE = 0.5e-3
WINDOW_TOLERANCE_M = 5e-3
# Kept from the ground at the nodes: what the smooth ground does between them is then rarely worth another solve.
CLEARANCE_RESERVE_M = 0.03


@dataclass(frozen=True)
class Optimum:
    """A trajectory that holds between its nodes, what it costs and how it was found."""

    trajectory: Trajectory
    objective: float
    history: tuple[MeshRound, ...]


def optimise(problem: Problem, guess: Trajectory, on_round: Callable[[MeshRound], None] = lambda _: None) -> Optimum:
    """The best trajectory near a guess; raises PlanningError when no mesh holds between its nodes."""
    problem = replace(problem, clearance_reserve_m=_clearance_reserve_m(problem))
    mesh = end_refined(problem.start_s, problem.end_s, LONGEST_S, SHORTEST_S, DEGREE)
    trajectory = guess
    solution: Solution | None = None
    history: list[MeshRound] = []
    for _ in range(MAX_ROUNDS):
        program = transcribe(problem, mesh)
        solution = solve(program, program.scaled(trajectory), solution)
        trajectory = program.trajectory(solution.y)
        missed, complaints = _broken_constraints(problem, trajectory)
        drifting, drift = _drifting_intervals(problem, trajectory)
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
        if not complaints and not drift:
            return Optimum(trajectory, solution.objective, tuple(history))
        mesh = mesh.split(drifting).watching(missed)
    raise PlanningError(
        f"no plan: after {MAX_ROUNDS} refinements of the mesh there is still {'; '.join(history[-1].complaints)}",
        hint="loosen the constraint named above a little, or give the flight more time",
    )


def _clearance_reserve_m(problem: Problem) -> float:
    """CLEARANCE_RESERVE_M, or less where a vehicle starts or ends nearer to its limit than that."""
    scenario = problem.scenario
    ends = np.stack([problem.start_state, problem.end_state])[:, None, :3] + problem.offsets_ned_m
    ground = ground_envelope_m(scenario.terrain, ends[..., 0], ends[..., 1])
    spare = float((-ends[..., 2] - ground).min()) - scenario.limits.clearance_min_m
    return min(max(spare, 0.0), CLEARANCE_RESERVE_M)


def _broken_constraints(problem: Problem, trajectory: Trajectory) -> tuple[Array, tuple[str, ...]]:
    """Worst instant of every stretch over which a constraint is broken, and the complaints in words."""
    count = int(np.ceil(problem.duration_s / LOOK_EVERY_S))
    times = np.linspace(problem.start_s, problem.end_s, count + 1)
    state, control = trajectory.state(times), trajectory.control(times)
    states = np.repeat(state[None], len(problem.offsets_ned_m), axis=0)
    states[..., POSITION] += problem.offsets_ned_m[:, None]
    controls = np.broadcast_to(control, (*states.shape[:2], 4))
    scenario = problem.scenario
    found = [(margins.clearance(scenario, states), CLEARANCE_TOLERANCE_M)]
    found += [(m, CLEARANCE_TOLERANCE_M) for m in margins.no_fly(scenario, states)]
    found += [(m, LIMIT_TOLERANCE * m.scale) for m in margins.state_limits(scenario, states[:1])]
    turning = margins.turning(scenario, states[:1], controls[:1])
    found.append((turning, LIMIT_TOLERANCE * turning.scale))
    if np.all(np.isfinite(problem.state_low)):
        found += [(m, CLEARANCE_TOLERANCE_M) for m in margins.box(scenario, states)]
    instants: list[float] = []
    complaints: list[str] = []
    for margin, tolerance in found:
        lowest = margin.value.min(axis=0)
        if lowest.min() >= -tolerance:
            continue
        complaints.append(
            f"{margin.name} broken by {-lowest.min():.3g} {margin.unit} at {times[lowest.argmin()]:.1f} s"
        )
        instants += [float(times[a + np.argmin(lowest[a:b])]) for a, b in _stretches(lowest < 0.0)]
    return np.array(sorted(set(instants))), tuple(complaints)


def _stretches(mask: Array) -> list[tuple[int, int]]:
    """Half-open index ranges over which `mask` holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _drifting_intervals(problem: Problem, trajectory: Trajectory) -> tuple[set[int], tuple[str, ...]]:
    """Intervals in which a window that drifts too far has its start, and the complaint in words."""
    joints, end_s = trajectory.joints_s, trajectory.end_s
    hover = np.array([problem.quadrotor.weight_N, 0.0, 0.0, 0.0])
    # An end at rest goes on as a hover, in which an error of the last second's speed adds up.
    stops = not np.delete(problem.end_state[3:], 5).any()
    windows = window_errors(
        lambda t: trajectory.state(np.minimum(t, end_s))[None],
        lambda t: np.where((t > end_s)[:, None], hover, trajectory.control(np.minimum(t, end_s)))[None],
        np.append(joints, end_s + WINDOW_S) if stops else joints,
        problem.quadrotor,
    )
    error = windows.error_m[0]
    if error.max() <= WINDOW_TOLERANCE_M:
        return set(), ()
    bad = windows.start_s[error > WINDOW_TOLERANCE_M]
    intervals = {i for start in bad for i in _overlapping(joints, start, start + WINDOW_S)}
    longest = max(np.diff(joints)[list(intervals)])
    # The long ones are to blame; halving the short ones beside them would only cost time.
    intervals = {i for i in intervals if joints[i + 1] - joints[i] > 0.5 * longest}
    return intervals, (
        f"Eq. 1 drifts {error.max() * 1e3:.1f} mm in {WINDOW_S:g} s from {windows.start_s[error.argmax()]:.1f} s",
    )


def _overlapping(joints: Array, start: float, end: float) -> list[int]:
    return list(np.flatnonzero((joints[1:] > start) & (joints[:-1] < end)))
