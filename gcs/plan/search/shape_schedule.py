"""The flight with its scheduled changes of shape, which begin at a time or at a gate.

The trajectory decides when a gate is crossed, and the change that begins there affects the trajectory. Both are
iterated until they agree. `gcs.plan.formation.timeline` makes the changes.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import Infeasible, PlanningError
from gcs.plan.formation.coordinates import COORDINATE_OF_CHANGE, Coordinate, CoordinateName, composed
from gcs.plan.formation.separation import least_gap
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.timeline import (
    AUTO,
    Move,
    gate_crossing_s,
    in_turn,
    lay,
    made_changes,
    scheduled,
    starts_at_points,
)
from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.mesh_refinement import (
    DEGREE,
    LONGEST_S,
    SHORTEST_S,
    Optimum,
    Warm,
    flown_shape,
    optimise,
    with_end,
    with_times,
)
from gcs.plan.nlp.route_phases import first_mesh
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.initial_guess import facing_along
from gcs.plan.trajectory.plan import MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import ChangeTable
from gcs.types import Array

_LATE_S = 0.05  # tolerance between the crossing of a gate and the start of its change
_TRIES = 8
_EVERY_S = 0.1
_FOR_A_GUESS = 100  # iterations: those that succeed take 20 to 80
_GUESSED = 0.1  # of the flight: accuracy of the first guess of a crossing
_NOTICEABLE = 0.05  # share of a coordinate's unit: smaller departures are not listed
_CHANGES = {name: kind for kind, name in COORDINATE_OF_CHANGE.items()}


def optimise_on_schedule(
    problem: Problem,
    guess: Trajectory,
    on_round: Callable[[MeshRound], None] = lambda _: None,
    *,
    warm: Warm | None = None,
    most: int | None = None,
) -> Optimum:
    """The best flight near a guess, with all changes of shape at their times and gates.

    `warm`: the guess is the solution of a similar problem, on its mesh. `most`: the most iterations of each solve.
    Raises Infeasible for changes that do not fit, PlanningError where gates and flight do not converge.
    """
    scenario = problem.scenario
    changes = scheduled(scenario)
    history: tuple[MeshRound, ...] = ()
    starts = _starts_s(problem, changes, guess)
    # Small overlaps of changes in the guess may vanish in the flight.
    apart = in_turn(scenario, starts, problem.end_s)
    if np.max(np.abs(np.subtract(apart, starts)), initial=0.0) <= _GUESSED * problem.duration_s:
        starts = apart
    near = warm is not None
    for _ in range(_TRIES):
        timeline = lay(scenario, starts, problem.start_s, problem.end_s)
        laid = replace(problem, shape=timeline.shape)
        if problem.follows_course and not near:
            laid, guess, near = with_fixed_turns(laid, guess)
        found = optimise(laid, guess, on_round, near=near, warm=warm, most=most)
        history += found.history
        if problem.points:
            problem = with_times(problem, found.trajectory.end_s, found.point_s)
        crossed = _starts_s(problem, changes, found.trajectory)
        if starts_at_points(scenario, found.point_s) is not None:  # the flight was verified with these times
            starts = in_turn(scenario, crossed, problem.end_s)
            timeline = lay(scenario, starts, problem.start_s, problem.end_s)
        late = float(np.max(np.abs(np.subtract(crossed, starts)), initial=0.0))
        if late <= _LATE_S:
            automatic = automatic_moves(
                with_end(replace(problem, shape=timeline.shape), found.trajectory.end_s).shape,
                problem.target_ned_m,
                problem.coordinates,
                found.trajectory.coordinates,
                problem.change_budget.speed_mps,
            )
            moves = (*timeline.moves, *automatic)
            return replace(found, history=history, moves=tuple(sorted(moves, key=lambda move: move.start_s)))
        # From here on the guess is the solution of a similar problem: no better one is looked for.
        guess, starts, warm, near = found.trajectory, crossed, found.last, near or problem.follows_course
    raise PlanningError.because(
        f"after {_TRIES} iterations the leader crosses a gate {late:.2f} s from the start of its change; "
        f"the limit is {_LATE_S:g} s",
        hint="trigger the change by a time (at_s), or move its gate to where the leader flies straight",
    )


def with_fixed_turns(problem: Problem, guess: Trajectory) -> tuple[Problem, Trajectory, bool]:
    """A better guess for a formation that turns with its course, with its times at points, and whether one was found.

    The leader's best flight while the shape turns as in the guess: its program has no coordinates, so it takes a
    fraction of the time. Then the heading is laid along the course of that flight.
    """
    fixed = replace(problem, coordinates=(), shape=flown_shape(problem, guess), free_time=None)
    mesh = first_mesh(fixed, LONGEST_S, SHORTEST_S, DEGREE)
    try:
        program = transcribe(fixed, mesh, guess.vehicle)
        y = solve(program, program.scaled(guess.vehicle), most=_FOR_A_GUESS, giving_up=True).y
    except PlanningError:
        return problem, guess, False
    flown, flown_mesh = program.trajectory(y), program.mesh(y)
    if problem.points:
        times = tuple(flown_mesh.joints_s[flown_mesh.arrivals].tolist())
        problem = with_times(problem, problem.end_s, times)
    return problem, facing_along(problem, flown, guess), True


def _starts_s(problem: Problem, changes: tuple[ChangeTable, ...], trajectory: Trajectory) -> tuple[float, ...]:
    times = np.arange(problem.start_s, problem.end_s, _EVERY_S)
    places = trajectory.state(times)[:, :3]
    starts = []
    for change, made in zip(changes, made_changes(problem.scenario), strict=True):
        if made.begins_s is not None:
            starts.append(made.begins_s)
            continue
        if change.at_point is not None:
            starts.append(problem.point_s[change.at_point - 1])
            continue
        assert change.gate_m is not None
        crossing = gate_crossing_s(change.gate_m, times, places)
        if crossing is None:
            (n1, e1), (n2, e2) = change.gate_m
            raise Infeasible.because(
                f"the leader never crosses the gate from ({n1:g}, {e1:g}) to ({n2:g}, {e2:g}) "
                f"that begins the change of kind {change.kind}",
                hint="move or widen the gate (gate_m), or trigger the change by a time (at_s)",
            )
        starts.append(crossing)
    return tuple(starts)


def automatic_moves(
    base: Shape, target: Array, coordinates: tuple[Coordinate, ...], values: PPoly, change_speed_mps: float
) -> tuple[Move, ...]:
    """One move for every span over which a coordinate is away from rest."""
    times = np.append(np.arange(values.x[0], values.x[-1], _EVERY_S), values.x[-1])
    at = values(times)
    moves = []
    for number, coordinate in enumerate(coordinates):
        if coordinate.free_end:
            continue
        away = np.abs(at[:, number] - coordinate.rest) / coordinate.unit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], away > _NOTICEABLE, [False]]).astype(int)))
        for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
            furthest = first + int(away[first : last + 1].argmax())
            alone = PPoly(values.c[:, :, number : number + 1], values.x)
            shape = composed(base, target, [coordinate.name], alone)
            there = shape.at(float(times[furthest]))
            travel_m = float(np.linalg.norm(there - base.at(float(times[furthest])), axis=1).max())
            moves.append(
                Move(
                    kind=_CHANGES[coordinate.name],
                    name=_words(coordinate, float(at[furthest, number])),
                    trigger=AUTO,
                    start_s=float(times[first]),
                    end_s=float(times[last]),
                    paper_time_s=2.0 * travel_m / change_speed_mps,
                    limited_by="cost",
                    way="there and back",
                    least_gap_m=least_gap(there)[0] if len(there) > 1 else np.inf,
                )
            )
    return tuple(moves)


def _words(coordinate: Coordinate, value: float) -> str:
    if coordinate.name is CoordinateName.SCALE:
        return f"shrink to {value:.2f}"
    if coordinate.name is CoordinateName.HEADING:
        return f"rotate {np.degrees(value):.0f} deg"
    return f"reshape, {100 * value:.0f} % done"
