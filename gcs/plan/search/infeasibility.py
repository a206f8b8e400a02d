"""Why a scenario has no plan, with the time of flight that would make it feasible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible, PlanningError
from gcs.physics.quadrotor import POSITION, VELOCITY
from gcs.plan.formation.shape import rigid
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.initial_guess import along
from gcs.plan.search.routes import Route
from gcs.plan.search.shape_schedule import optimise_on_schedule

_AXES = ("north", "east", "height")
_LONGER = (1.01, 1.03, 1.07, 1.15, 1.3, 1.6, 2.0)


def check_time(problem: Problem) -> None:
    """Raises Infeasible when the straight flight at the speed limits needs more time than there is."""
    times = _least_times_s(problem)
    latest_s = problem.duration_s if problem.free_time is None else problem.free_time.latest_s
    axis = int(np.argmax(times))
    if times[axis] <= latest_s:
        return
    limit = problem.state_high[VELOCITY][axis]
    raise Infeasible(
        f"no plan: {latest_s:g} s are too short; {_AXES[axis]} alone needs t_f ≥ {np.ceil(times[axis]):g} s "
        f"at |v| ≤ {limit:g} m/s, and more to start and stop",
        hint=f"set [time] flight_s to {np.ceil(1.05 * times[axis]):g}, or raise [limits] speed_ned_mps",
    )


def explain_infeasible(problem: Problem, route: Route, failures: list[PlanningError]) -> PlanningError:
    """The most specific of several failures, with the time of flight that is enough, where more time helps."""
    needed_s = _needed_time_s(problem, route)
    last = next((f for f in failures if isinstance(f, Infeasible)), failures[-1])
    if needed_s is None:
        return last
    return Infeasible(
        f"no plan in {problem.duration_s:g} s; it needs t_f ≥ {needed_s:g} s within these limits. "
        f"At {problem.duration_s:g} s: {last.message.removeprefix('no plan: ')}",
        hint=f"set [time] flight_s to {needed_s:g} or more",
    )


def _needed_time_s(problem: Problem, route: Route) -> float | None:
    """A time of flight, in whole seconds, with a plan along this route; None where twice the time is not enough."""
    if problem.free_time is not None:
        return None  # longer times were tried already
    least_s = max(problem.duration_s, float(_least_times_s(problem).max()))
    for factor in _LONGER:
        longer = with_duration(problem, float(np.ceil(least_s * factor)))
        try:
            optimise_on_schedule(longer, along(longer, route))
        except PlanningError:
            continue
        return longer.duration_s
    return None


def with_duration(problem: Problem, duration_s: float) -> Problem:
    """The same problem with another time of flight, and the reference speed for it."""
    speed = problem.objective.speed_ref_mps * problem.duration_s / duration_s
    end_s = problem.start_s + duration_s
    return replace(
        problem,
        end_s=end_s,
        shape=rigid(problem.shape.at(problem.start_s), problem.start_s, end_s),
        objective=replace(problem.objective, speed_ref_mps=speed),
    )


def least_time_s(problem: Problem) -> float:
    """The time that a straight flight at the speed limits needs."""
    return float(_least_times_s(problem).max())


def _least_times_s(problem: Problem) -> np.ndarray:
    """The time (3,) that each axis needs at its speed limit."""
    distance_m = np.abs((problem.end_state - problem.start_state)[POSITION])
    return np.asarray(distance_m / problem.state_high[VELOCITY])
