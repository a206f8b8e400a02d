"""From a scenario to a plan: the optimised flight, and the phases that join it to the ground."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gcs.errors import Infeasible
from gcs.plan.formation.reshape import SLACK_M
from gcs.plan.formation.separation import least_gap
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.formation.shape import joined as joined_shapes
from gcs.plan.formation.timeline import stops_ned_m
from gcs.plan.nlp.mesh_refinement import Optimum, optimise
from gcs.plan.ocp.problem import ObjectiveTerm, flight_problem, run_up_problem
from gcs.plan.search.free_final_time import best_flight, with_fixed_time
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.trajectory.ground_phases import landing_step, shape_from_ground, straight_down, vertical
from gcs.plan.trajectory.phases import Phase, PhaseKind, phases_of
from gcs.plan.trajectory.plan import Alternative, MeshRound, Plan
from gcs.plan.trajectory.trajectory import Trajectory, joined
from gcs.plan.trajectory.zone_margin import first_with_margin
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import (
    NED_FROM_UP,
    ground_step_peaks,
    hover_start_ned_m,
    landing_points_ned_m,
    leader_index,
    pads_ned_m,
    quadrotor,
)
from gcs.types import Array
from gcs.util.long_work import within

LIMIT_S = 1800.0  # of planning, in all: far longer than any plan that succeeds


def make_plan(
    scenario: Scenario,
    on_round: Callable[[MeshRound], None] = lambda _: None,
    *,
    every_way: bool = False,
    workers: int = 1,
    extra_objectives: tuple[ObjectiveTerm, ...] = (),
    limit_s: float = LIMIT_S,
) -> Plan:
    """The plan of the whole flight of a scenario, not verified yet. Raises PlanningError where there is none.

    `every_way` optimises all routes that the search finds, not only those that can still win. With more than one
    `workers`, processes optimise routes in parallel where that is quicker; the plan is the same. A program that asks
    for more than one must be importable (`if __name__ == "__main__"`). `extra_objectives` are terms of the objective
    beside those of `gcs.plan.ocp.objectives.TERMS`, for the flight from T0 to the arrival. All routes together take at
    most `limit_s` seconds: then the best plan so far is returned, or OutOfTime raised where there is none.
    """
    _check_landing(scenario)
    with within(limit_s):
        return _made(scenario, on_round, extra_objectives, every_way=every_way, workers=workers)


def _made(
    scenario: Scenario,
    on_round: Callable[[MeshRound], None],
    extra_objectives: tuple[ObjectiveTerm, ...],
    *,
    every_way: bool,
    workers: int,
) -> Plan:
    began = time.perf_counter()

    def flight(inflated: Scenario, told: bool) -> tuple[Optimum, tuple[Alternative, ...]]:
        problem = flight_problem(inflated, extra_objectives)
        return best_flight(problem, on_round, all_routes=every_way, workers=workers, explained=told)

    best, alternatives = first_with_margin(scenario, flight)
    scenario = with_fixed_time(scenario, best.trajectory.end_s)
    trajectory = best.trajectory.vehicle
    flight_done = time.perf_counter()
    run_up = first_with_margin(scenario, lambda inflated, _: _run_up(inflated, on_round))
    run_up_done = time.perf_counter()
    phases = phases_of(scenario)
    leader = leader_index(scenario)
    vehicle = quadrotor(scenario)
    yaw_start = np.radians(scenario.start.roll_pitch_yaw_deg[2])
    hover, pad = hover_start_ned_m(scenario)[leader], pads_ned_m(scenario)[leader]
    span = {p.name: (p.start_s, p.end_s) for p in phases}
    parts = [vertical(*span[PhaseKind.TAKEOFF], pad, hover[2], yaw_start, vehicle)]
    if PhaseKind.HOVER in span:
        parts.append(vertical(*span[PhaseKind.HOVER], hover, hover[2], yaw_start, vehicle))
    if run_up is not None:
        parts.append(run_up)
    parts += [trajectory, *leader_to_ground(scenario)]
    return Plan(
        scenario,
        joined(parts),
        _whole_shape(scenario, best.shape, phases),
        phases,
        best.objective,
        best.history,
        alternatives,
        best.moves,
        {"flight": flight_done - began, "run-up": run_up_done - flight_done},
        route_s=best.point_s,
        leg_limits=tuple(line.limits for line in best.lines),
    )


def leader_to_ground(scenario: Scenario) -> list[Trajectory]:
    """The leader after the end of the flight: the hover on arrival, where there is one, and the landing."""
    vehicle, end = quadrotor(scenario), np.array(scenario.end.position_m) * NED_FROM_UP
    yaw_ned_rad = np.radians(scenario.end.roll_pitch_yaw_deg[2])
    # Changes of the shape do not move the leader's landing point.
    ground = landing_points_ned_m(scenario)[leader_index(scenario)]
    span = {p.name: (p.start_s, p.end_s) for p in phases_of(scenario)}
    parts = []
    if PhaseKind.ARRIVAL_HOVER in span:
        parts.append(vertical(*span[PhaseKind.ARRIVAL_HOVER], end, end[2], yaw_ned_rad, vehicle))
    down_m = landing_step(*span[PhaseKind.LANDING], float(end[2]), float(ground[2]), scenario)
    return [*parts, straight_down(down_m, end, yaw_ned_rad, vehicle)]


def shape_to_ground(scenario: Scenario, offsets_ned_m: Array) -> list[Shape]:
    """Offsets (V, 3) after the end of the flight: rigid in the hover, onto uneven ground in the landing."""
    landing = phases_of(scenario)[-1]
    parts = []
    if scenario.time.flight_s < landing.start_s:
        parts.append(rigid(offsets_ned_m, scenario.time.flight_s, landing.start_s))
    ground = landing_points_ned_m(scenario, offsets_ned_m)
    return [*parts, shape_from_ground(landing.end_s, landing.start_s, ground, offsets_ned_m, scenario)]


def _check_landing(scenario: Scenario) -> None:
    """Raises Infeasible where the last shape of the schedule cannot land."""
    if scenario.formation.ends_in_start_shape:
        return  # then `gcs check` has tested it
    limits, ids = scenario.limits, scenario.formation.sysids
    last = stops_ned_m(scenario)[-1]
    ground = landing_points_ned_m(scenario, last)
    gap_m, i, j = least_gap(ground)
    if gap_m < limits.separation_min_m - SLACK_M:
        raise Infeasible.because(
            f"vehicles {ids[i]} and {ids[j]} end above each other and would land {gap_m:.2f} m apart; "
            f"separation_min_m is {limits.separation_min_m:g} m",
            hint="add a [[formation.change]] that ends in a shape that is wider, seen from above",
        )
    fall_m = float((ground - last)[:, 2].max() + scenario.end.position_m[2])
    needed_s = ground_step_peaks(scenario)[0] * fall_m / limits.speed_ned_mps[2]
    given_s = scenario.ground_phases.landing_s
    if given_s is not None and given_s < needed_s:
        raise Infeasible.because(
            f"landing_s = {given_s:g} is too short: the highest vehicle descends "
            f"{fall_m:.1f} m at {limits.speed_ned_mps[2]:g} m/s at most, which takes {needed_s:.1f} s",
            hint=f"set [ground_phases] landing_s to {np.ceil(needed_s):g} or more",
        )


def _run_up(scenario: Scenario, on_round: Callable[[MeshRound], None]) -> Trajectory | None:
    """The flight from the hover to the state of Eq. 15 by the same method, with height and heading as references."""
    if not any(scenario.start.velocity_mps):
        return None
    problem = run_up_problem(scenario, hover_start_ned_m(scenario)[leader_index(scenario)])
    objective = replace(
        problem.objective,
        terminal_weight="1",
        heading_ref_rad=float(problem.end_state[8]),
        height_ref_m=float(-problem.end_state[2]),
        height_scale_m=1.0,
    )
    return optimise(replace(problem, objective=objective), along(problem, straight_route(problem)), on_round).trajectory


def _whole_shape(scenario: Scenario, flight: Shape, phases: tuple[Phase, ...]) -> Shape:
    """Offsets from ground to ground: those of the flight, rigid before and after, and onto uneven ground."""
    begin, end = flight.at(flight.start_s), flight.at(np.nextafter(flight.end_s, -np.inf))
    takeoff = phases[0]
    parts = [shape_from_ground(takeoff.start_s, takeoff.end_s, pads_ned_m(scenario), begin, scenario)]
    if takeoff.end_s < flight.start_s:
        parts.append(rigid(begin, takeoff.end_s, flight.start_s))
    return joined_shapes([*parts, flight, *shape_to_ground(scenario, end)])
