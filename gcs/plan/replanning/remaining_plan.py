"""The rest of a plan, cut out of its polynomials or planned anew from any state.

The first begins in the air and ends as the old plan does. The second is solved on a mesh of its own, through the
points of the route that are still ahead.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from gcs.errors import Infeasible, OutOfTime, PlanningError
from gcs.physics.states import POSITION
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.nlp.mesh_refinement import Optimum, optimise
from gcs.plan.ocp.problem import Problem
from gcs.plan.replanning.obstacle_detour import detours
from gcs.plan.replanning.turning import Turning
from gcs.plan.search.infeasibility import check_time
from gcs.plan.search.initial_guess import along
from gcs.plan.search.leg_guess import on_time, routes_through
from gcs.plan.search.open_lines import open_where_blocked
from gcs.plan.search.routes import every_route
from gcs.plan.trajectory.energy import used_until
from gcs.plan.trajectory.leg_lines import remaining_lines
from gcs.plan.trajectory.phases import Phase, PhaseKind
from gcs.plan.trajectory.plan import MeshRound, Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.types import Array

# A point that is this near in time is not flown to again: from a disturbed state it could only be passed by a turn.
_TOO_NEAR_S = 4.0


def trajectory_part(trajectory: Trajectory, start_s: float, end_s: float) -> Trajectory:
    """The trajectory from one instant to another."""
    return Trajectory(_part(trajectory.state, start_s, end_s), _part(trajectory.control, start_s, end_s))


def shape_part(shape: Shape, start_s: float, end_s: float) -> Shape:
    """The shape from one instant to another."""
    return Shape(_part(shape.functions, start_s, end_s), shape.basis_ned_m)


def _part(polynomials: PPoly, start_s: float, end_s: float) -> PPoly:
    joints = np.asarray(polynomials.x)
    first = int(np.clip(np.searchsorted(joints, start_s, side="right") - 1, 0, len(joints) - 2))
    last = int(np.clip(np.searchsorted(joints, end_s, side="left"), first + 1, len(joints) - 1))
    coefficients = np.array(polynomials.c[:, first:last])
    if start_s != joints[first]:
        coefficients[:, 0] = _moved(coefficients[:, 0], start_s - joints[first])
    return PPoly(coefficients, np.concatenate([[start_s], joints[first + 1 : last], [end_s]]))


def _moved(coefficients: Array, by: float) -> Array:
    """The polynomial (K+1, ...), highest power first, with its origin `by` later (repeated Horner's scheme)."""
    moved = coefficients.copy()
    for end in range(len(moved), 1, -1):
        for power in range(1, end):
            moved[power] += by * moved[power - 1]
    return moved


def plan_from_flight(plan: Plan, problem: Problem, found: Optimum, timings_s: dict[str, float]) -> Plan:
    """The plan of the flight that solves `problem`, and of the old plan's hover and landing after it."""
    end_s = plan.phase(PhaseKind.MISSION).end_s
    after = trajectory_part(plan.leader_trajectory, end_s, plan.t_end_s)
    return Plan(
        with_times_of_changes(problem.scenario, plan),
        joined([found.trajectory.vehicle, after]),
        joined_shapes([found.shape, shape_part(plan.shape, end_s, plan.t_end_s)]),
        (Phase(PhaseKind.MISSION, problem.start_s, end_s), *(p for p in plan.phases if p.start_s >= end_s)),
        found.objective,
        found.history,
        (),
        plan.moves,
        timings_s,
        tuple(problem.start_state.tolist()),
        route_s=found.point_s,
        leg_limits=tuple(line.limits for line in found.lines),
        used_before=used_until(plan, problem.start_s),
    )


def with_times_of_changes(scenario: Scenario, plan: Plan) -> Scenario:
    """The scenario with changes at gates and route points begun at their planned times: the track may differ now."""
    starts = iter(move.start_s for move in plan.scheduled_moves)
    changes = []
    for change in scenario.formation.change:
        at_s = None if change.auto else next(starts, None)
        placed = (change.gate_m is not None or change.at_point is not None) and at_s is not None
        update = {"gate_m": None, "at_point": None, "at_s": at_s}
        changes.append(change.model_copy(update=update) if placed else change)
    formation = scenario.formation.model_copy(update={"change": tuple(changes)})
    return scenario.model_copy(update={"formation": formation})


def still_ahead(problem: Problem, t_s: float) -> Problem:
    """The problem without the points that are behind the leader at a time, or too near to fly to from any state."""
    count = sum(arrival_s <= t_s + _TOO_NEAR_S for arrival_s in problem.point_s)
    lines = remaining_lines(problem.lines, len(problem.lines) - count)
    return replace(problem, points=problem.points[count:], point_s=problem.point_s[count:], lines=lines)


def flown_through(
    problem: Problem,
    old: Trajectory,
    zones: tuple[NoFlyZone, ...],
    on_round: Callable[[MeshRound], None],
    turns: Turning | None = None,
) -> Optimum:
    """The flight from the problem's start through its points, around new disks `zones`, near the `old` trajectory.

    `turns`: the formation turns with its course, as it did in the old plan at first. Raises Infeasible, where a disk
    covers a point too, or PlanningError.
    """
    _refuse_covered(problem, zones)
    check_time(problem)
    failures: list[PlanningError] = []
    for timed, guess in _guesses(problem, old, zones, turns):
        try:
            return optimise(open_where_blocked(timed, guess), guess, on_round, near=not zones)
        except OutOfTime:
            raise
        except PlanningError as failure:
            failures.append(failure)
    raise next((f for f in failures if isinstance(f, Infeasible)), failures[-1])


def _guesses(
    problem: Problem, old: Trajectory, zones: tuple[NoFlyZone, ...], turns: Turning | None
) -> Iterator[tuple[Problem, Trajectory]]:
    for guess in detours(problem if turns is None else turns.without_heading(problem), old, zones):
        yield problem, guess if turns is None else turns.on(guess)
    for route in routes_through(problem) if problem.points else every_route(problem):
        timed = on_time(problem, route)
        yield timed, along(timed, route)


def _refuse_covered(problem: Problem, zones: tuple[NoFlyZone, ...]) -> None:
    """Raises Infeasible where a point lies in a new zone, seen from any vehicle at its time."""
    for point, t_s in zip(problem.points, problem.point_s, strict=True):
        places = point.place_ned_m[POSITION] + problem.shape.at(t_s)
        for zone in zones:
            inside_m = -float(outside_m(zone, np.full(len(places), t_s), places[:, 0], places[:, 1]).min())
            if inside_m > point.radius_m:
                raise Infeasible.because(
                    f"{point.name} of the route cannot be passed: a vehicle would be {inside_m:.1f} m inside "
                    "a new no-fly zone",
                    hint="land, return or hold (`gcs attach`); the old plan has not changed",
                )
