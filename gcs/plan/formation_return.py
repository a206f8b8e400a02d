"""Returns of a whole formation: from any instant of a plan home, as an ordinary plan that begins in the air.

The formation flies to its hover over the pads by the planner's method: over the terrain, round zones, in its shape of
that instant or in that of the start, whichever fits first. Each attempt is verified; the first that passes is the
return.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from gcs.errors import Infeasible, OutOfTime, PlanningError, UsageError
from gcs.physics.states import POSITION
from gcs.plan.formation.coordinates import CoordinateName
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.formation.shape import stretched_polynomials as stretched
from gcs.plan.formation.timeline import Move, lay, made_changes, stops_ned_m
from gcs.plan.nlp.mesh_refinement import Optimum, optimise
from gcs.plan.ocp.problem import HeadingEnds, Problem, Tightening, flight_problem
from gcs.plan.planner import leader_to_ground, shape_to_ground
from gcs.plan.replanning.obstacle_detour import detours
from gcs.plan.replanning.remaining_plan import shape_part, trajectory_part, with_times_of_changes
from gcs.plan.search.initial_guess import along
from gcs.plan.search.routes import Route, find_routes, survey
from gcs.plan.search.shape_schedule import automatic_moves, with_fixed_turns
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.energy import used_until
from gcs.plan.trajectory.phases import Phase, PhaseKind, phases_of
from gcs.plan.trajectory.plan import MeshRound, Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.plan.trajectory.zone_margin import kept_margin, without_margin
from gcs.plan.verification.constraints.allowed_shapes import AllowedShapes
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.formation_table import ChangeTable
from gcs.scenario.schema.scenario import Boundary, Scenario
from gcs.scenario.values.si import NED_FROM_UP, hover_start_ned_m, leader_index, offsets_ned_m
from gcs.types import Array
from gcs.util.long_work import report

_CRUISE = 0.75  # share of the speed limit; less in later attempts
_TURN_S = 14.0  # to brake, turn round and stop
_SLOWER = (1.0, 1.4, 2.0)  # times of flight, in units of the first
_SETTLED_S = 1.0  # between the end of a change under way, or the start, and the next change
_ROUTES = 3
_CALMER, _OF_SPARE = 0.4, 0.8  # shares of the limits of tilt and rates, and of what the start leaves of them
_OF_LOAD = 0.7  # share of the tilt of the largest load factor
_ZONE_RESERVE_M = 0.05
_STENCIL_S = 0.1  # between the instants from which the rates of automatic changes are taken
_STENCIL = np.arange(-4, 5)
_LATEST = 1e-3  # s before the landing
_SAMPLES = 400
_SAME_M = 1e-6


class _Attempt(NamedTuple):
    """One way home: the scenario, its changes of shape, and the optimiser's problem and guess."""

    scenario: Scenario
    moves: tuple[Move, ...]
    problem: Problem
    guess: Trajectory
    near: bool


def plan_return(
    plan: Plan, t_s: float, near: Plan | None = None, on_round: Callable[[MeshRound], None] = lambda _: None
) -> Plan:
    """The verified plan of a return of the whole formation: from `t_s`, s after T0, to its pads.

    It begins with the plan's state and shape at `t_s`; the leader flies to where it hovered after take-off. Changes of
    shape that have begun are completed, later ones are left out, and at the end the formation has its shape of the
    start, so that it lands on the pads, each vehicle on any of them as after a change of shape. `used_before` has what
    the plan took from the batteries until `t_s`; with [vehicle.power] the verdict includes what is left of them.
    `near`: the return from a nearby instant, from which this one is found sooner.

    Raises UsageError for an instant before the end of the take-off or after the begin of the landing, PlanningError
    with the reason where no attempt is verified.
    """
    if not plan.airborne_s <= t_s <= plan.landing_s - _LATEST:
        raise UsageError(
            f"t = {t_s:g} s: a return may begin from {plan.airborne_s:g} s to {plan.landing_s:g} s, in the air",
            hint="before and after that the formation is above its pads or landing: land",
        )
    began = time.perf_counter()
    failures: list[PlanningError] = []
    for number, attempt in enumerate(_attempts(plan, float(t_s), near)):
        report(lambda number=number: f"planning the return from t = {t_s:g} s, attempt {number + 1}")  # type: ignore[misc]
        try:
            made = _flown(plan, attempt, on_round, began)
        except OutOfTime as over:
            raise _in_words(t_s, over) from over
        except PlanningError as failure:
            failures.append(failure)
            continue
        found = verify(made)
        if found.ok:
            return made
        reason = PlanningError.because(f"it fails verification: {found.failures[0]}", hint=_HINT)
        if all(check.constraint.kind is Kind.BATTERY for check in found.failures):
            raise _in_words(t_s, reason)  # a slower one takes more
        failures.append(reason)
    raise _in_words(t_s, next((f for f in failures if isinstance(f, Infeasible)), failures[-1]))


_HINT = "land there, or let the vehicles return one by one"


def _in_words(t_s: float, failure: PlanningError) -> PlanningError:
    return type(failure)(f"no return of the formation from t = {t_s:g} s: {failure.reason}", hint=_HINT)


def _attempts(plan: Plan, t_s: float, near: Plan | None) -> Iterator[_Attempt]:
    """Ways home, the quickest first: near a known return, then along routes, at ever lower speeds."""
    for slower in _SLOWER:
        for inflated in _zones_of(plan):
            late_too = _changes_after(plan, t_s)
            for late in (False, True) if late_too else (False,):
                yield from _in_time(plan, inflated, t_s, slower, late=late, near=near if slower == 1.0 else None)


def _zones_of(plan: Plan) -> tuple[Scenario, ...]:
    """The scenario with zones as attempts avoid them: as the plan does, and as near as a plan may pass them."""
    kept, bare = kept_margin(plan), without_margin(plan.scenario)
    return (kept,) if (kept.no_fly, kept.keep_in) == (bare.no_fly, bare.keep_in) else (kept, bare)


def _in_time(
    plan: Plan, inflated: Scenario, t_s: float, slower: float, *, late: bool, near: Plan | None
) -> Iterator[_Attempt]:
    """Attempts with one share of the speed and one time of the change to the shape of the start."""
    straight = _problem(plan, inflated, t_s, t_s + _duration_s(plan, t_s, 0.0, slower), late=late)
    if near is not None and not straight[2].coordinates:
        old, length_m = _joined(near, straight[2].start_state[POSITION])
        end_s = round(t_s + _duration_s(plan, t_s, length_m, slower), 1)
        scenario, moves, problem = _problem(plan, inflated, t_s, end_s, late=late)
        known = Trajectory(*(stretched(part, problem.start_s, problem.end_s) for part in (old.state, old.control)))
        for guess in detours(problem, known, ()):
            yield _Attempt(scenario, moves, problem, guess, near=True)
    for route in _routes(plan, straight[2], t_s):
        end_s = round(t_s + _duration_s(plan, t_s, route.length_m, slower), 1)
        scenario, moves, problem = _problem(plan, inflated, t_s, end_s, late=late)
        yield _Attempt(scenario, moves, problem, along(problem, route), near=False)


def _joined(near: Plan, place_ned_m: Array) -> tuple[Trajectory, float]:
    """What is left of a known return from the point of its track nearest to a place, and the length of the way, m."""
    mission = near.phase(PhaseKind.MISSION)
    times = np.linspace(mission.start_s, mission.end_s, _SAMPLES)
    track = near.leader_trajectory.state(times)[:, :2]
    away_m = np.linalg.norm(track - place_ned_m[:2], axis=1)
    first = int(np.argmin(away_m[: -_SAMPLES // 4]))
    length_m = float(away_m[first] + np.linalg.norm(np.diff(track[first:], axis=0), axis=1).sum())
    return trajectory_part(near.leader_trajectory, float(times[first]), mission.end_s), length_m


def _routes(plan: Plan, problem: Problem, t_s: float) -> list[Route]:
    """Routes home on the map, the shortest first; the flown track last."""
    try:
        found = list(find_routes(problem, survey(problem)))[:_ROUTES]
    except Infeasible:
        found = []
    flown_s = np.linspace(t_s, plan.airborne_s, 100)
    flown = plan.leader_trajectory.state(flown_s)[:, :2]
    flown[-1] = problem.end_state[:2]
    return [*found, Route(flown, ())]


def _duration_s(plan: Plan, t_s: float, length_m: float, slower: float) -> float:
    """A time of flight that a formation can keep, with what its changes of shape take."""
    limits = plan.scenario.limits
    home, now = _home_ned_m(plan.scenario), plan.leader_trajectory.state(t_s)[POSITION]
    level_s = max(length_m, float(np.linalg.norm(home[:2] - now[:2]))) / min(limits.speed_ned_mps[:2])
    climb_s = 2.0 * abs(float(home[2] - now[2])) / limits.speed_ned_mps[2]
    changed_s = 1.2 * _changing_s(plan, t_s)
    wanted_s = slower * (max(level_s / _CRUISE, changed_s) + climb_s + _TURN_S)
    return max(wanted_s, _SETTLED_S - t_s)  # a scenario's flight ends after T0


def _home_ned_m(scenario: Scenario) -> Array:
    """The leader's place (3,) over its pad."""
    return np.asarray(hover_start_ned_m(scenario)[leader_index(scenario)])


def _begun(plan: Plan, t_s: float) -> list[ChangeTable]:
    """The changes of the scenario that have begun at `t_s`, at their planned times, and those that need none."""
    scheduled = iter(plan.scheduled_moves)
    changes = with_times_of_changes(plan.scenario, plan).formation.change
    return [change for change in changes if change.auto or next(scheduled).start_s <= t_s]


def _still_s(plan: Plan, t_s: float) -> float:
    """When the scheduled change that is under way at `t_s` ends; `t_s` where none is."""
    return max((move.end_s for move in plan.scheduled_moves if move.start_s <= t_s), default=t_s)


def _with_changes(scenario: Scenario, changes: list[ChangeTable]) -> Scenario:
    formation = scenario.formation.model_copy(update={"change": tuple(changes)})
    return scenario.model_copy(update={"formation": formation})


def _changes_after(plan: Plan, t_s: float) -> bool:
    """Whether the shape that the formation has after `t_s` is another one than that of the start."""
    stops = stops_ned_m(_with_changes(plan.scenario, _begun(plan, t_s)))
    return bool(np.abs(stops[-1] - offsets_ned_m(plan.scenario)).max() > _SAME_M)


def _changing_s(plan: Plan, t_s: float) -> float:
    """How long the formation changes its shape after `t_s`, s."""
    left_s = max(_still_s(plan, t_s) - t_s, 0.0)
    if not _changes_after(plan, t_s):
        return left_s
    begun = [*_begun(plan, t_s), ChangeTable(kind="reshape", to="start", at_s=0.0)]
    return left_s + _SETTLED_S + _last_change_s(_with_changes(plan.scenario, begun))


def _last_change_s(scenario: Scenario) -> float:
    return made_changes(scenario)[-1].duration_s


def _problem(
    plan: Plan, inflated: Scenario, t_s: float, end_s: float, *, late: bool
) -> tuple[Scenario, tuple[Move, ...], Problem]:
    """The scenario of a return, its scheduled moves, and the optimiser's problem: from `t_s` to the hover at home."""
    changes = _begun(plan, t_s)
    if _changes_after(plan, t_s):
        back = ChangeTable(kind="reshape", to="start", at_s=0.0)
        takes_s = _last_change_s(_with_changes(plan.scenario, [*changes, back]))
        early_s = max(_still_s(plan, t_s), t_s, 0.0) + _SETTLED_S
        latest_s = end_s - takes_s - _SETTLED_S
        at_s = max(latest_s, early_s) if late else early_s
        changes.append(back.model_copy(update={"at_s": round(at_s, 3)}))
    scenario = _home_scenario(plan, _with_changes(plan.scenario, changes), end_s)
    avoided = scenario.model_copy(update={"no_fly": inflated.no_fly, "keep_in": inflated.keep_in})
    moves = [move for move in plan.scheduled_moves if move.start_s <= t_s]
    starts = [move.start_s for move in moves]
    if len(changes) and not changes[-1].auto and changes[-1].to == "start" and len(starts) < _scheduled(changes):
        starts.append(float(changes[-1].at_s or 0.0))
    timeline = lay(scenario, tuple(starts), min(t_s, 0.0), end_s)
    flight = flight_problem(avoided)
    problem = replace(
        flight,
        start_s=t_s,
        end_s=end_s,
        start_state=plan.leader_trajectory.state(t_s)[:12],
        start_thrust_N=float(plan.leader_trajectory.control(t_s)[0]),
        shape=shape_part(timeline.shape, t_s, end_s),
        zone_reserve_m=_ZONE_RESERVE_M,
        # No direction is asked for at home; the yaw turns calmly to that of the start.
        objective=replace(
            flight.objective, heading_weight=0.0, speed_ref_mps=_CRUISE * min(scenario.limits.speed_ned_mps[:2])
        ),
    )
    problem = replace(problem, tightenings=_reserves(problem, t_s, end_s))
    still_s = next((end for begin, end in plan.shape.moving_s if begin < t_s < end), t_s)
    if not problem.coordinates and still_s > t_s:  # as it is flown: its moves begin within a tolerance of that
        parts = shape_part(plan.shape, t_s, still_s), shape_part(timeline.shape, still_s, end_s)
        problem = replace(problem, shape=joined_shapes(list(parts)))
    if problem.coordinates:
        begins = _coordinates_at(plan, problem, t_s, timeline.shape)
        heading = None
        if problem.follows_course:
            turn = begins[[c.free_end for c in problem.coordinates].index(True)]
            heading = HeadingEnds(flight.course_at_start_rad, turn, 2.0 * np.pi * round(turn[0] / (2.0 * np.pi)))
        problem = replace(problem, begins=begins, heading=heading)
    return scenario, timeline.moves, problem


def _reserves(problem: Problem, t_s: float, end_s: float) -> tuple[Tightening, ...]:
    """Tighter tilt and rates: calm turns, in which violations between nodes seldom need another solve."""
    spare = problem.state_high - np.abs(problem.start_state)
    found = []
    gentle_rad = _OF_LOAD * float(np.arctan(problem.scenario.limits.load_factor_max))
    for column in (6, 7, 9, 10, 11):
        most = float(problem.state_high[column])
        by = max(_CALMER * most, most - gentle_rad if column < 9 else 0.0)  # where it turns back, all of it is a turn
        found.append(Tightening(column, t_s, end_s, max(min(by, _OF_SPARE * float(spare[column])), 0.0)))
    return tuple(found)


def _scheduled(changes: list[ChangeTable]) -> int:
    return sum(not change.auto for change in changes)


def _home_scenario(plan: Plan, scenario: Scenario, end_s: float) -> Scenario:
    """The scenario of a flight that ends over the pads at `end_s`: without route and survey, in a box with the pads."""
    home, start = _home_ned_m(scenario) * NED_FROM_UP, scenario.start
    end = Boundary(position_m=tuple(home.tolist()), roll_pitch_yaw_deg=(0.0, 0.0, start.roll_pitch_yaw_deg[2]))
    hovers = hover_start_ned_m(scenario)
    boxes = {
        key: (min(low, float(hovers[:, axis].min())), max(high, float(hovers[:, axis].max())))
        for axis, key in enumerate(("north_m", "east_m"))
        for low, high in [getattr(scenario.limits, key)]
    }
    time_table = scenario.time.model_copy(update={"flight_s": end_s, "free": False})
    return scenario.model_copy(
        update={
            "end": end,
            "time": time_table,
            "route": (),
            "loops": 1,
            "survey": None,
            "limits": scenario.limits.model_copy(update=boxes),
        }
    )


def _coordinates_at(plan: Plan, problem: Problem, t_s: float, scheduled: Shape) -> tuple[Array, ...]:
    """Value and first three derivatives (4,) of each coordinate at `t_s`, from the plan's shape."""
    mission = plan.phase(PhaseKind.MISSION)
    allowed = AllowedShapes.of(plan.scenario)
    assert allowed is not None
    last_s = float(np.nextafter(mission.end_s, -np.inf))
    middle_s = float(np.clip(t_s, mission.start_s, last_s))
    times: Array = middle_s + _STENCIL_S * _STENCIL.astype(np.float64)
    times = times[(times >= mission.start_s) & (times <= last_s)]
    scale, turn, blend = allowed.nearest(plan.offsets(times), scheduled.offsets(times))
    values = {CoordinateName.SCALE: scale, CoordinateName.HEADING: np.unwrap(turn), CoordinateName.BLEND: blend}
    moves = mission.start_s < t_s < mission.end_s
    found = []
    for c in problem.coordinates:
        curve = make_interp_spline(times, values[c.name], 5 if len(times) > 5 else len(times) - 1)
        orders = range(4) if moves else range(1)
        chain = np.zeros(4)
        chain[list(orders)] = [float(curve(middle_s, order)) for order in orders]
        if not c.free_end:
            chain[0] = np.clip(chain[0], c.low, c.high)
        found.append(chain)
    return tuple(found)


def _flown(plan: Plan, attempt: _Attempt, on_round: Callable[[MeshRound], None], began: float) -> Plan:
    """The optimised flight of an attempt, with its hover and landing. It is not verified yet."""
    problem, guess, near = attempt.problem, attempt.guess, attempt.near
    if problem.follows_course:
        problem, guess, near = with_fixed_turns(problem, guess)
    found = optimise(problem, guess, on_round, near=near)
    return _whole(plan, attempt, found, began)


def _whole(plan: Plan, attempt: _Attempt, found: Optimum, began: float) -> Plan:
    scenario, problem = attempt.scenario, attempt.problem
    shape = found.shape
    automatic = automatic_moves(
        problem.shape,
        problem.target_ned_m,
        problem.coordinates,
        found.trajectory.coordinates,
        problem.change_budget.speed_mps,
    )
    end_offsets = shape.at(float(np.nextafter(shape.end_s, -np.inf)))
    phases = phases_of(scenario)
    arrival = next(n for n, phase in enumerate(phases) if phase.name == PhaseKind.MISSION) + 1
    return Plan(
        scenario,
        joined([found.trajectory.vehicle, *leader_to_ground(scenario)]),
        joined_shapes([shape, *shape_to_ground(scenario, end_offsets)]),
        (Phase(PhaseKind.MISSION, problem.start_s, problem.end_s), *phases[arrival:]),
        found.objective,
        found.history,
        (),
        tuple(sorted((*attempt.moves, *automatic), key=lambda move: move.start_s)),
        {"return": time.perf_counter() - began},
        tuple(problem.start_state.tolist()),
        used_before=used_until(plan, problem.start_s),
    )
