"""Re-planning in flight: from any state, at any time of the mission, around new no-fly disks.

Programs are built once for a plan and solved for each re-plan. The state is the leader's, because the formation is
defined by it; followers return to their offsets as after any disturbance. The shape keeps its schedule; where it
turns with its course, it turns with the new one. The verifier decides whether the new plan may be flown.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible, OutOfTime, PlanningError, UsageError
from gcs.physics.states import POSITION
from gcs.plan.nlp.ipopt import Solution, run
from gcs.plan.nlp.mesh import Mesh, counted, end_refined
from gcs.plan.nlp.mesh_refinement import (
    DEGREE,
    LONGEST_S,
    SHORTEST_S,
    Optimum,
    clearance_reserve_m,
    drifting_intervals,
)
from gcs.plan.nlp.transcription import Program
from gcs.plan.nlp.violations import complaints, find_violations
from gcs.plan.ocp.margins import box, clearance, height, no_fly, state_limits
from gcs.plan.ocp.problem import ObjectiveTerm, Problem, flight_problem
from gcs.plan.replanning.obstacle_detour import detours
from gcs.plan.replanning.parametric_nlp import ParametricNlp, parametric_nlp, tightened, with_zones
from gcs.plan.replanning.remaining_plan import (
    flown_through,
    plan_from_flight,
    shape_part,
    still_ahead,
    trajectory_part,
    with_times_of_changes,
)
from gcs.plan.replanning.turning import turning
from gcs.plan.replanning.warm_start import Multipliers, multipliers
from gcs.plan.search.homotopy_classes import GRID_EXCESS
from gcs.plan.search.infeasibility import check_time
from gcs.plan.search.initial_guess import along
from gcs.plan.search.routes import find_routes, survey
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import MeshRound, Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.trajectory.zone_margin import kept_margin, new_zone, without_margin
from gcs.scenario.environment.no_fly import ZoneName
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

SPARE_DISKS = 2
LEAST_S = 5.0  # least remaining time of the mission for a re-plan
_MESHES = (1.4, 1.0, 0.7, 0.45, 0.3)  # numbers of intervals, as shares of that of the whole flight
_FEWEST = 8
_ROUNDS = 5
_RESERVED_S = 30.0  # from the start, until when reserves grow
# Reserves at the nodes to limits at which the first plan is active: then a second solve is seldom needed.
CLEARANCE_RESERVE_M, ZONE_RESERVE_M, RATE_RESERVE = 0.06, 0.01, 0.04
_LEAST_RESERVE_M = 0.02  # less than the planner's own


class Replanner:
    """Re-plans one plan any number of times. Building its programs takes about a second; re-plans build nothing."""

    def __init__(
        self,
        plan: Plan,
        *,
        spare_disks: int = SPARE_DISKS,
        extra_objectives: tuple[ObjectiveTerm, ...] = (),
        keeps_margin: bool = True,
    ) -> None:
        """Build the programs, and solve the plan once for its multipliers. Raises PlanningError where that fails.

        `extra_objectives` are those of `make_plan`. Without `keeps_margin` a re-plan may pass no-fly zones as near as
        the verifier allows; with it that is the second attempt.
        """
        self.plan = plan
        self.spare_disks = spare_disks
        self._extra_objectives = extra_objectives
        self._keeps_room = keeps_margin and plan.scenario.limits.zone_margin_m is None
        self._second: Replanner | None = None
        inflated = kept_margin(plan) if keeps_margin else without_margin(plan.scenario)
        mission = plan.phase(PhaseKind.MISSION)
        flight = flight_problem(inflated, extra_objectives)
        fixed = with_times_of_changes(flight.scenario, plan)
        self._turns = turning(plan, fixed, flight)
        whole = replace(
            flight,
            start_s=mission.start_s,
            start_state=plan.leader_trajectory.state(mission.start_s),
            shape=shape_part(self._turns.base if self._turns else plan.shape, mission.start_s, mission.end_s),
            coordinates=flight.coordinates if self._turns else (),
        )
        if self._turns:
            whole = replace(whole, scenario=fixed)
        if whole.points:
            passed = len(whole.points) - len(plan.route_s)
            whole = replace(whole, scenario=fixed, points=whole.points[passed:], point_s=plan.route_s, lines=plan.lines)
        self._whole = replace(whole, clearance_reserve_m=clearance_reserve_m(whole, CLEARANCE_RESERVE_M))
        self._old = trajectory_part(plan.leader_trajectory, mission.start_s, mission.end_s)
        self._has_own_program = bool(plan.scenario.route) or self._turns is not None  # points, or a heading
        if self._has_own_program:
            return
        most = end_refined(mission.start_s, mission.end_s, LONGEST_S, SHORTEST_S, DEGREE).intervals
        counts = sorted({max(2 * int(np.ceil(0.5 * share * most)), _FEWEST) for share in _MESHES})
        whole = self._whole
        meshes = [counted(whole.start_s, whole.end_s, count, SHORTEST_S, DEGREE) for count in counts]
        self._programs = {n: parametric_nlp(whole, mesh, spare_disks) for n, mesh in zip(counts, meshes, strict=True)}
        finest, planned = (
            self._programs[counts[-1]],
            trajectory_part(plan.leader_trajectory, whole.start_s, whole.end_s),
        )
        program = finest.program(whole, meshes[-1], planned)
        try:
            solution = run(finest.afresh, program, {"x0": program.scaled(planned)})
        except PlanningError:  # a formation that shrinks to fit a gap leaves no such room
            self._whole = replace(whole, clearance_reserve_m=clearance_reserve_m(whole, _LEAST_RESERVE_M))
            program = finest.program(self._whole, meshes[-1], planned)
            solution = run(finest.afresh, program, {"x0": program.scaled(planned)})
        self._old, self._multipliers = program.trajectory(solution.y), multipliers(program, solution)

    def replan(
        self,
        state: Array,
        t_s: float,
        zones: Sequence[NoFlyZone] = (),
        on_round: Callable[[MeshRound], None] = lambda _: None,
    ) -> Plan:
        """The plan from the leader's `state` (12,), or the fleet's (V, 12), SI and NED, at `t_s`, to the ground.

        `zones` are new disks, at most `spare_disks` of them. The result is not verified. Raises UsageError for a time
        outside the mission or an invalid state, Infeasible with the reason, PlanningError.
        """
        began = time.perf_counter()
        leader = self._leader(state)
        self._check(t_s, zones)
        scenario = self.plan.scenario
        try:
            return self._replanned(leader, t_s, tuple(zones), on_round, began)
        except OutOfTime:
            raise
        except PlanningError:
            if scenario.route or not self._keeps_room or not (zones or scenario.no_fly or scenario.keep_in):
                raise
        self._second = self._second or Replanner(
            self.plan, spare_disks=self.spare_disks, extra_objectives=self._extra_objectives, keeps_margin=False
        )
        return self._second._replanned(leader, t_s, tuple(zones), on_round, began)

    def _replanned(
        self,
        leader: Array,
        t_s: float,
        zones: tuple[NoFlyZone, ...],
        on_round: Callable[[MeshRound], None],
        began: float,
    ) -> Plan:
        """The plan; along a route, through the points that are still ahead, and a hold that has begun ends now."""
        problem = self._problem(leader, t_s, zones)
        problem = still_ahead(problem, t_s) if problem.points else problem
        avoided = problem.scenario.no_fly[len(problem.scenario.no_fly) - len(zones) :]
        _check_start(self._turns.without_heading(problem) if self._turns else problem)
        if self._has_own_program:
            try:
                found = flown_through(problem, self._old, avoided, on_round, self._turns)
            except PlanningError as failure:
                raise _in_words(problem, failure) from failure
            return self._made(problem, zones, began, found)
        check_time(problem)
        failures: list[PlanningError] = []
        for guess, known in self._guesses(problem, avoided):
            try:
                flown, objective, history = self._flown(problem, guess, known, on_round)
            except OutOfTime as over:
                raise _in_words(problem, over) from over
            except PlanningError as failure:
                failures.append(failure)
                continue
            return self._made(problem, zones, began, Optimum(flown, problem.shape, objective, tuple(history)))
        raise _in_words(problem, next((f for f in failures if isinstance(f, Infeasible)), failures[-1]))

    def _made(self, problem: Problem, zones: tuple[NoFlyZone, ...], began: float, found: Optimum) -> Plan:
        """The plan of a flight, in the scenario with the new zones as they were given."""
        scenario, took = self.plan.scenario, {"re-plan": time.perf_counter() - began}
        true = replace(problem, scenario=with_zones(scenario, (*scenario.no_fly, *zones)))
        return plan_from_flight(self.plan, true, found, took)

    def _guesses(
        self, problem: Problem, zones: tuple[NoFlyZone, ...]
    ) -> Iterator[tuple[Trajectory, Multipliers | None]]:
        """Guesses: the old trajectory with a detour on each side of new disks; then routes through the whole map.

        Raises Infeasible where the map has none, or the shortest is longer than the speed limits allow.
        """
        for guess in detours(problem, self._old, zones):
            yield guess, self._multipliers
        routes = find_routes(problem, survey(problem))
        speed_mps = float(np.hypot(*problem.state_high[3:5]))
        if routes[0].length_m > GRID_EXCESS * (reach_m := speed_mps * problem.duration_s):
            raise Infeasible(
                f"no plan from t = {problem.start_s:g} s: the shortest route is {routes[0].length_m:.0f} m long, "
                f"and at {speed_mps:.1f} m/s at most the remaining {problem.duration_s:.0f} s allow {reach_m:.0f} m",
                hint="land, return or hold (`gcs attach`); the old plan has not changed",
            )
        for route in routes:
            yield along(problem, route), None

    def _leader(self, state: Array) -> Array:
        state = np.asarray(state, dtype=np.float64)
        vehicles = len(self.plan.sysids)
        if state.shape not in ((12,), (vehicles, 12)):
            raise UsageError(
                f"a state has 12 numbers, or 12 for each of {vehicles} vehicles, not {state.shape}",
                hint="north, east, down, their speeds, roll, pitch, yaw, their rates: m, m/s, rad, rad/s",
            )
        leader = state if state.ndim == 1 else state[self.plan.leader]
        if not np.isfinite(leader).all():
            raise UsageError(
                "the leader's state has numbers that are not finite", hint="wait until all 12 numbers are estimated"
            )
        return leader

    def _check(self, t_s: float, zones: Sequence[NoFlyZone]) -> None:
        """Raises UsageError for a time outside the mission, and for zones that there is no room for."""
        mission = self.plan.phase(PhaseKind.MISSION)
        if not mission.start_s <= t_s <= mission.end_s - LEAST_S:
            raise UsageError(
                f"t = {t_s:g} s is not within the mission: a re-plan may begin from {mission.start_s:g} s to "
                f"{mission.end_s - LEAST_S:g} s",
                hint="give a time within it; take-off, run-up and landing are flown as planned",
            )
        if len(zones) > self.spare_disks or any(zone.radius_m is None for zone in zones):
            raise UsageError(
                f"{len(zones)} new zones given; there is room for {self.spare_disks}, and only for disks",
                hint="put disks around the zones, or plan again with `gcs plan`",
            )

    def _problem(self, leader: Array, t_s: float, zones: tuple[NoFlyZone, ...]) -> Problem:
        mission, scenario = self.plan.phase(PhaseKind.MISSION), self._whole.scenario
        if self._keeps_room or scenario.limits.zone_margin_m is not None:
            places = leader[POSITION] + self.plan.shape.at(t_s)
            zones = tuple(new_zone(scenario, zone, t_s, places) for zone in zones)
        problem = replace(
            self._whole,
            scenario=with_zones(scenario, (*scenario.no_fly, *zones)),
            start_s=float(t_s),
            start_state=leader,
            shape=shape_part(self._whole.shape, t_s, mission.end_s),
        )
        return problem if self._turns is None else self._turns.taken_over(problem)

    def _flown(
        self, problem: Problem, trajectory: Trajectory, known: Multipliers | None, on_round: Callable[[MeshRound], None]
    ) -> tuple[Trajectory, float, list[MeshRound]]:
        history: list[MeshRound] = []
        for parametric, mesh in self._meshes(problem):
            program = _with_reserves(parametric.program(problem, mesh, trajectory))
            start = {"x0": program.scaled(trajectory)}
            if known is not None:
                start["lam_x0"], start["lam_g0"] = known.on(program)
            for _ in range(_ROUNDS):
                solution = run(parametric.again if "lam_x0" in start else parametric.afresh, program, start)
                trajectory = program.trajectory(solution.y)
                missed = find_violations(problem, trajectory, problem.shape)
                drift = () if missed else drifting_intervals(problem, trajectory, problem.shape, quick=True)[1]
                history.append(_round(program, solution, (*complaints(missed), *drift)))
                on_round(history[-1])
                if not missed and not drift:
                    return trajectory, solution.objective, history
                known = multipliers(program, solution)
                if drift:
                    break
                program = tightened(program, trajectory, missed)
                start = {"x0": np.clip(solution.y, program.y_low, program.y_high), "lam_x0": solution.y_multipliers}
                start["lam_g0"] = np.array(list(solution.g_multipliers.values()))
        raise PlanningError.because(
            f"the finest mesh was not enough: {'; '.join(history[-1].complaints)}",
            hint="plan again with `gcs plan`, or re-plan from a later state",
        )

    def _meshes(self, problem: Problem) -> list[tuple[ParametricNlp, Mesh]]:
        """The coarsest mesh whose intervals are short enough, and the finest, with shorter ones at the ends."""
        start_s, end_s = problem.start_s, problem.end_s
        meshes = [
            (built, counted(start_s, end_s, count, SHORTEST_S, DEGREE)) for count, built in self._programs.items()
        ]
        enough = [pair for pair in meshes[:-1] if np.diff(pair[1].joints_s).max() <= 1.01 * LONGEST_S]
        finest = self._programs[meshes[-1][0].intervals]
        finer = finest, counted(start_s, end_s, finest.intervals, 0.5 * SHORTEST_S, DEGREE)
        return [*enough[:1], finer]


def _in_words(problem: Problem, failure: PlanningError) -> PlanningError:
    """The optimiser's message, with what the operator can do in flight."""
    return type(failure)(
        f"no plan from t = {problem.start_s:g} s in the remaining {problem.duration_s:.0f} s: " + failure.reason,
        hint="land, return or hold (`gcs attach`); the old plan has not changed",
    )


def _with_reserves(program: Program) -> Program:
    """The program with reserves to the verifier's limits: for no-fly zones, and for rates after the start."""
    layout = program.layout
    y_low, y_high, g_low = program.y_low.copy(), program.y_high.copy(), program.g_low.copy()
    rates = (np.arange(1, layout.state_points)[:, None] * layout.nx + np.arange(9, 12)).ravel()
    y_low[rates] *= 1.0 - RATE_RESERVE
    y_high[rates] *= 1.0 - RATE_RESERVE
    start_s = float(layout.mesh.joints_s[0])
    for row, (constraint, t_s) in enumerate(program.g_ids):
        if isinstance(constraint.of, ZoneName) and not constraint.of.keep_in:
            # The flight may begin as near to a zone as its plan passes.
            g_low[row] += ZONE_RESERVE_M * min((t_s - start_s) / _RESERVED_S, 1.0)
    return replace(program, y_low=y_low, y_high=y_high, g_low=g_low)


def _round(program: Program, solution: Solution, found: tuple[str, ...]) -> MeshRound:
    layout = program.layout
    return MeshRound(
        layout.mesh.intervals, layout.size, 0, solution.iterations, solution.seconds, solution.objective, found
    )


def _check_start(problem: Problem) -> None:
    """Raises Infeasible where the first state violates a limit."""
    scenario = problem.scenario
    leader = problem.start_state[None, None]
    places = problem.start_state[POSITION] + problem.shape.at(problem.start_s)[:, None]
    found = [*state_limits(scenario, leader), *box(scenario, places), height(scenario, places)]
    found += [clearance(scenario, places)]
    found += no_fly(scenario, places, np.array([problem.start_s]))
    for margin in found:
        if margin.value.min() < 0.0:
            vehicle = int(margin.value.min(axis=1).argmin())
            of_vehicle = f" for vehicle {scenario.formation.sysids[vehicle]}" if len(margin.value) > 1 else ""
            raise Infeasible.because(
                f"the state at t = {problem.start_s:g} s violates {margin.name}{of_vehicle} by "
                f"{-margin.value.min():.3g} {margin.unit}",
                hint="bring the formation back within its limits (hold or return), then re-plan",
            )
