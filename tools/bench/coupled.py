"""Six vehicles as one coupled program, the way a formation is written without a virtual rigid body.

Knows: CasADi, the same mesh, dynamics, cost and constraints as the leader's, six times, and every pair's separation at
every node.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from gcs.physics.quadrotor import POSITION
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.program.program_bounds import STATE_UNIT
from gcs.plan.nlp.program.transcription import Program, transcribe
from gcs.plan.nlp.variables import NX, ControlForm
from gcs.plan.ocp import stage_functions
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import offsets_ned_m
from tools.bench.describe import alone, straight


def each_vehicle(scenario: Scenario) -> list[Problem]:
    """The leader's flight, begun and ended at every vehicle's own place."""
    leader = flight_problem(alone(scenario))
    problems = []
    for offset in offsets_ned_m(scenario):
        start, end = leader.start_state.copy(), leader.end_state.copy()
        start[POSITION] += offset
        end[POSITION] += offset
        # The paper's places reach out of the paper's box by as much as the leader's folded box allows for.
        low, high = leader.state_low.copy(), leader.state_high.copy()
        low[POSITION] = np.minimum(low[POSITION], np.minimum(start[POSITION], end[POSITION]))
        high[POSITION] = np.maximum(high[POSITION], np.maximum(start[POSITION], end[POSITION]))
        problems.append(replace(leader, start_state=start, end_state=end, state_low=low, state_high=high))
    return problems


def solve(mesh: Mesh, limit_s: float, scenario: Scenario, clock: str = "wall") -> dict[str, Any]:
    """One program for all, its derivatives CasADi's own; `limit_s` bounds the solver's time.

    The time is that of the `clock`: wall or cpu.
    """
    began, began_cpu = time.perf_counter(), time.process_time()
    problems = each_vehicle(scenario)
    programs = [transcribe(problem, mesh, straight(problem), ControlForm.LAGRANGE) for problem in problems]
    guesses = [p.scaled(straight(q)) for p, q in zip(programs, problems, strict=True)]
    unknowns = [ca.MX.sym(f"y{v}", p.layout.size) for v, p in enumerate(programs)]
    parts = stage_functions.functions(problems[0])
    columns = [_instants(p, y) for p, y in zip(programs, unknowns, strict=True)]
    cost, rows, low, high = ca.MX(0), [], [], []
    for program, y, z in zip(programs, unknowns, columns, strict=True):
        f, g = _one_vehicle(problems[0], program, parts, y, z)
        cost += f / len(programs)
        rows.append(g)
        low.append(program.g_low)
        high.append(program.g_high)
    least = scenario.limits.separation_min_m
    for a, b in itertools.combinations(columns, 2):
        apart = ca.sum1((a[POSITION, :] - b[POSITION, :]) ** 2).T / least**2
        rows.append(apart)
        low.append(np.ones(apart.numel()))
        high.append(np.full(apart.numel(), np.inf))
    nlp: dict[str, Any] = {"x": ca.vertcat(*unknowns), "f": cost, "g": ca.vertcat(*rows)}
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-6,
        "ipopt.max_iter": 3000,
        f"ipopt.max_{clock}_time": limit_s,
    }
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    built = time.perf_counter()
    result = solver(
        x0=np.concatenate(guesses),
        lbx=np.concatenate([p.y_low for p in programs]),
        ubx=np.concatenate([p.y_high for p in programs]),
        lbg=np.concatenate(low),
        ubg=np.concatenate(high),
    )
    ended = time.perf_counter()
    stats = solver.stats()
    return {
        "cold_s": ended - began,
        "cold_cpu_s": time.process_time() - began_cpu,
        "solver_s": ended - built,
        "iterations": stats["iter_count"],
        "objective": float(result["f"]),
        "status": stats["return_status"],
        "success": bool(stats["success"]),
        "unknowns": int(nlp["x"].numel()),
    }


def _instants(program: Program, y: ca.MX) -> ca.MX:
    """State and control (16, N) at the nodes."""
    sampling = ca.DM(program.layout.sampling(program.layout.node_times_s()))
    return ca.reshape(ca.mtimes(sampling, y * program.unit + program.shift), program.layout.nz, program.layout.nodes)


def _one_vehicle(
    problem: Problem, program: Program, parts: stage_functions.StageFunctions, y: ca.MX, z: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """Objective and rows of one vehicle alone, for CasADi to differentiate."""
    layout, nodes = program.layout, program.layout.nodes
    quadrature = layout.quadrature()
    late = quadrature * TERMINAL_WEIGHTS[problem.objective.terminal_weight](layout.node_times_s(), problem.end_s)
    shares = np.vstack([quadrature / problem.duration_s, late / late.sum()])
    a, b = (ca.DM(matrix) for matrix in layout.collocation())
    unit = np.tile(STATE_UNIT, a.size1() // NX)
    motion = ca.mtimes(a, y * program.unit + program.shift) - ca.mtimes(b, ca.vec(parts.motion.map(nodes)(z)))
    return ca.sum2(parts.cost.map(nodes)(z, shares)), ca.vertcat(
        motion / unit, ca.vec(parts.path.map(nodes)(z, np.zeros((parts.path.size1_in(1), nodes))))
    )
