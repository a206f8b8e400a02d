"""The problem of all contenders: Simulation 1's leader, from A to B or through points, as plain numbers on a mesh."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gcs.physics.states import NU
from gcs.plan.nlp.mesh import Mesh, end_refined
from gcs.plan.nlp.mesh_refinement import DEGREE, LONGEST_S, SHORTEST_S
from gcs.plan.nlp.program_bounds import STATE_UNIT
from gcs.plan.nlp.route_phases import first_mesh, leg_times
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS, TERMS, yaw_rate
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.ocp.stage_functions import REST_SMOOTHING_MPS
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.search.leg_guess import on_time, routes_through
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.environment.terrain import ENVELOPE_ROUNDING_M, ripple_peak_m
from gcs.scenario.schema.places import LegsTable
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from tools.bench_route import drawn

_MOUNTAIN = ("height_m", "north_m", "east_m", "spread_north_m", "spread_east_m")
MISSION = Path(__file__).resolve().parents[2] / "missions" / "simulation1"


def six() -> Scenario:
    """The paper's formation."""
    return load_scenario(MISSION)


def alone(scenario: Scenario) -> Scenario:
    """The same flight of the leader only."""
    formation = scenario.formation
    leader = tuple(v for v in formation.vehicle if v.sysid == formation.leader)
    only = {"vehicle": leader} if formation.count is None else {"count": 1}
    formation = formation.model_copy(update=only)
    return scenario.model_copy(update={"formation": formation})


def straight(problem: Problem) -> Trajectory:
    """The guess of every contender: a straight track that ignores the map, lifted over the ground."""
    return along(problem, straight_route(problem))


def uniform(problem: Problem) -> Mesh:
    """15 intervals of degree 4."""
    return Mesh(np.linspace(problem.start_s, problem.end_s, 16), (4,) * 15)


def refined_at_ends(problem: Problem) -> Mesh:
    """30 intervals of degree 4, short ones at the ends."""
    for longest_s in np.arange(20.0, 5.0, -0.1):
        mesh = end_refined(problem.start_s, problem.end_s, float(longest_s), 1.0, 4)
        if mesh.intervals == 30:
            return mesh
    raise ValueError("no end-refined mesh of 30 intervals")


def converged(problem: Problem) -> Mesh:
    """220 intervals, of 0.125 s where the flight is lively: finer ones change the objective by less than 2e-5."""
    ends = np.linspace(0.0, 10.0, 81)
    middle = np.linspace(10.0, problem.duration_s - 10.0, 61)
    joints = np.concatenate([ends[:-1], middle[:-1], problem.duration_s - ends[::-1]])
    return Mesh(problem.start_s + joints, (3,) * (len(joints) - 1))


def on_route() -> Scenario:
    """The paper's formation through five points, free between them: peers know no corridors."""
    free = LegsTable(corridor_m="free", height_tolerance_m="free", heading_tolerance_deg="free")
    return drawn(5, 1).model_copy(update={"legs": free})


def route_problem() -> tuple[Problem, Mesh, Trajectory]:
    """The leader through the points, with Skein's first mesh and its first guess."""
    problem = flight_problem(alone(on_route()))
    route = routes_through(problem)[0]
    problem = on_time(problem, route)
    return problem, first_mesh(problem, LONGEST_S, SHORTEST_S, DEGREE), along(problem, route)


def numbers(problem: Problem, mesh: Mesh, guess: Trajectory | None = None) -> dict[str, Any]:
    """Everything that `Leader` reads; arrays as lists. The guess is a straight track unless there is a better one."""
    scenario = problem.scenario
    assert scenario.terrain.ripple is not None and not scenario.no_fly and len(scenario.formation.vehicle) == 1
    program = transcribe(problem, mesh, straight(problem))
    assert all(not point.radius_m and not point.hold_s for point in problem.points)
    times = np.linspace(problem.start_s, problem.end_s, 201) if guess is None else guess.state.x
    guess = guess or straight(problem)
    legs = leg_times(problem, mesh)
    mountains = scenario.terrain.mountains
    turning = next(term for term in TERMS if term.rate is yaw_rate)
    late = TERMINAL_WEIGHTS[problem.objective.terminal_weight](program.layout.node_times_s(), problem.end_s)
    return {
        "end_s": problem.end_s,
        "joints_s": mesh.joints_s.tolist(),
        "degrees": list(mesh.degrees),
        "leg_of_interval": mesh.leg_of_interval.tolist(),
        "points_ned_m": [point.place_ned_m.tolist() for point in problem.points],
        "stretch": [1.0, 1.0] if legs is None else [float(legs.low[0]), float(legs.high[0])],
        "state_unit": STATE_UNIT.tolist(),
        "control_unit": program.unit[-NU:].tolist(),
        "control_shift": program.shift[-NU:].tolist(),
        "state_low": problem.state_low.tolist(),
        "state_high": problem.state_high.tolist(),
        "start_state": problem.start_state.tolist(),
        "end_state": problem.end_state.tolist(),
        "control_low": problem.control_low.tolist(),
        "control_high": problem.control_high.tolist(),
        "guess_s": times.tolist(),
        "guess_state": guess.state(times).tolist(),
        "guess_control": guess.control(times).tolist(),
        "quadrotor": asdict(problem.quadrotor),
        "objective": asdict(problem.objective),
        "turning_weight": turning.weight(problem),
        "yaw_rate_max_radps": turning.scale(problem),
        "late_integral": float(program.layout.quadrature() @ late),  # of Q, as the mesh sees it
        "mountains": [list(getattr(mountains, key)) for key in _MOUNTAIN],
        "ripple_peak_m": ripple_peak_m(scenario.terrain.ripple),
        "rounding_m": ENVELOPE_ROUNDING_M,
        "clearance_min_m": scenario.limits.clearance_min_m,
        "load_factor_max": scenario.limits.load_factor_max,
        "rest_mps": REST_SMOOTHING_MPS,
    }


def leader_problem() -> Problem:
    """The common problem."""
    return flight_problem(alone(six()))
