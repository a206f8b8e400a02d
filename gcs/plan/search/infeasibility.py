"""Diagnoses why a scenario has no plan, with the values that would make it feasible."""

import math
from bisect import bisect_left
from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible, PlanningError
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.coordinates import coordinates
from gcs.plan.formation.schedule_fit import ScheduleMisfit, check_schedule
from gcs.plan.formation.shape import rigid
from gcs.plan.ocp.margins import COURSE_SPEED_MPS
from gcs.plan.ocp.problem import Problem
from gcs.plan.search.initial_guess import along
from gcs.plan.search.leg_guess import check_legs, least_legs_s, on_time
from gcs.plan.search.routes import Route
from gcs.plan.search.shape_schedule import optimise_on_schedule
from gcs.scenario.schema.fields import FLIGHT_MAX_S
from gcs.scenario.schema.scenario import Scenario

_AXES = ("north", "east", "height")
_FASTER = 20.0  # times a speed of a change: what would need more does not help
_LONGER = (1.01, 1.03, 1.07, 1.15, 1.3, 1.6, 2.0)


def check_time(problem: Problem) -> None:
    """Raises Infeasible where no optimiser is needed to see that there is too little time.

    That is: for the straight flight at the speed limits, for all scheduled changes of shape, or for the turn of a
    formation that flies along its course.
    """
    if problem.points:
        check_legs(problem)
    else:
        _check_speed(problem)
    if problem.free_time is None:
        check_schedule(problem.scenario, problem.end_s)
        if not problem.points:
            _check_turn(problem)


def _check_speed(problem: Problem) -> None:
    times = np.abs((problem.end_state - problem.start_state)[POSITION]) / problem.state_high[VELOCITY]
    latest_s = problem.duration_s if problem.free_time is None else problem.free_time.latest_s
    axis = int(np.argmax(times))
    if times[axis] <= latest_s:
        return
    limit = problem.state_high[VELOCITY][axis]
    raise Infeasible.because(
        f"{latest_s:g} s are too short; {_AXES[axis]} alone needs t_f ≥ {np.ceil(times[axis]):g} s "
        f"at |v| ≤ {limit:g} m/s, and more to start and stop",
        hint=f"set [time] flight_s to {np.ceil(1.05 * times[axis]):g}, or raise [limits] speed_ned_mps",
    )


def _check_turn(problem: Problem) -> None:
    """Raises Infeasible where a formation with `frame = "course"` cannot turn to its way in time.

    It flies at most 1 m/s in any other direction than it faces. So its way towards the end is bounded by what remains
    of the speed limits across the tolerated angle, while it turns at its largest rate.
    """
    if not problem.follows_course:
        return
    scenario = problem.scenario
    way = (problem.end_state - problem.start_state)[:2]
    length_m = float(np.linalg.norm(way))
    away_rad = float(np.arctan2(way[1], way[0])) - problem.course_at_start_rad
    away_rad = abs(float(np.angle(np.exp(1j * away_rad))))

    def fits(scenario: Scenario, away_rad: float, duration_s: float) -> bool:
        """Whether it covers the distance in `duration_s`, where its speed is limited until it faces the end."""
        fastest_mps = float(np.abs(way / max(length_m, 1e-9)) @ np.array(scenario.limits.speed_ned_mps[:2]))
        t_s = np.linspace(0.0, duration_s, 2001)
        turned_rad = next(c.most[0] for c in coordinates(scenario) if c.free_end) * t_s
        off_rad = np.maximum(away_rad - math.radians(scenario.formation.course_tolerance_deg) - turned_rad, 0.0)
        speed_mps = np.maximum(fastest_mps * np.cos(off_rad), COURSE_SPEED_MPS)
        reach_m = float(speed_mps[:-1].sum() * (t_s[1] - t_s[0])) * (1.0 + 1e-3) + fastest_mps * float(t_s[1])
        return reach_m >= length_m

    if fits(scenario, away_rad, problem.duration_s):
        return
    needed_s = next(
        (s for s in range(math.ceil(problem.duration_s), FLIGHT_MAX_S) if fits(scenario, away_rad, float(s))), None
    )
    remedies = []
    if not any(scenario.start.velocity_mps) and fits(scenario, 0.0, problem.duration_s):
        remedies.append(
            f"start.roll_pitch_yaw_deg[2] to {np.degrees(np.arctan2(way[1], way[0])):.0f}, the direction of the end"
        )
    faster = (_with_faster_changes(scenario, k) for k in np.geomspace(1.05, _FASTER, 60).tolist())
    if (least := next((one for one in faster if fits(one, away_rad, problem.duration_s)), None)) is not None:
        quick = least.formation
        remedies.append(
            f"formation.change_speed_mps to {quick.change_speed_mps:g} and formation.change_accel_mps2 to "
            f"{quick.change_accel_mps2:g} or more"
        )
    if needed_s is not None:
        remedies.append(f"time.flight_s to {needed_s} or more")
    rate_degps = float(np.degrees(next(c.most[0] for c in problem.coordinates if c.free_end)))
    raise Infeasible(
        f'no plan in {problem.duration_s:g} s: with frame = "course" the formation faces '
        f"{np.degrees(problem.course_at_start_rad):.0f} degrees at the start, the end is {np.degrees(away_rad):.0f} "
        f"degrees beside that, and it turns at most {rate_degps:.2g} degrees/s",
        hint=f"set {', or '.join(remedies)}" if remedies else 'remove formation.frame = "course"',
    )


def _with_faster_changes(scenario: Scenario, factor: float) -> Scenario:
    formation = scenario.formation
    update = {
        "change_speed_mps": math.ceil(10.0 * factor * formation.change_speed_mps) / 10.0,
        "change_accel_mps2": math.ceil(10.0 * factor**2 * formation.change_accel_mps2) / 10.0,
    }
    return scenario.model_copy(update={"formation": formation.model_copy(update=update)})


def explain_infeasible(problem: Problem, route: Route, failures: list[PlanningError]) -> PlanningError:
    """The most specific of several failures, with the time of flight that is enough, where more time helps."""
    if all(isinstance(failure, ScheduleMisfit) for failure in failures):
        return failures[-1]  # it says which time is enough
    needed_s = _needed_time_s(problem, route)
    last = next((f for f in failures if isinstance(f, Infeasible)), failures[-1])
    if needed_s is None:
        return last
    return Infeasible(
        f"no plan in {problem.duration_s:g} s; it needs t_f ≥ {needed_s:g} s within these limits. "
        f"At {problem.duration_s:g} s: {last.reason}",
        hint=f"set [time] flight_s to {needed_s:g} or more",
    )


def _needed_time_s(problem: Problem, route: Route) -> float | None:
    """A time of flight, in whole seconds, with a plan along this route; None where twice the time is not enough."""
    if problem.free_time is not None:
        return None  # longer times were tried already
    least_s = max(problem.duration_s, least_legs_s(problem))
    times_s = [float(np.ceil(least_s * factor)) for factor in _LONGER]

    def is_enough(duration_s: float) -> bool:
        timed = on_time(with_duration(problem, duration_s), route)
        try:
            optimise_on_schedule(timed, along(timed, route))
        except PlanningError:
            return False
        return True

    # A time that is not enough takes far longer to solve than one that is; halving the list solves few of them.
    found = bisect_left(times_s, True, key=is_enough)
    return times_s[found] if found < len(times_s) else None


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
