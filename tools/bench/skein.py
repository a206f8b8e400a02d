"""Skein as a contender, in a process of its own like the others.

Run as `python -m tools.bench.skein problem.json result.json FLEET HOW`. FLEET is `leader` or `six`. HOW: `lagrange` or
`linear`, one solve of a problem from A to B with that form of the control on the given mesh; `refined`, on the mesh
that it refines by itself; or, of a problem with points, `plan`, whole and verified, or `one_solve` by Eq. 41.
"""

import contextlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import PPoly

from gcs import make_plan, verify
from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.mesh_refinement import optimise
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.nlp.variables import ControlForm
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.trajectory.plan import MeshRound
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tools.bench.contender import made_with
from tools.bench.describe import alone, on_route, route_problem, six, straight

Found = dict[str, Any]


def one_solve(problem: Problem, mesh: Mesh, guess: Trajectory, form: ControlForm) -> Found:
    """The given problem on the given mesh, cold."""
    program = transcribe(problem, mesh, guess, form)
    solution = solve(program, program.scaled(guess))
    flown = program.mesh(solution.y)
    return {
        "solver_s": solution.seconds,
        "iterations": solution.iterations,
        "objective": solution.objective,
        "points_s": flown.joints_s[flown.arrivals].tolist(),
    } | interpolated(program.trajectory(solution.y))


def refined(problem: Problem) -> Found:
    """A trajectory that holds between its nodes."""
    best = optimise(problem, straight(problem))
    return {
        "solver_s": sum(done.seconds for done in best.history),
        "iterations": sum(done.iterations for done in best.history),
        "objective": best.objective,
    } | interpolated(best.trajectory)


def verified_plan(scenario: Scenario) -> Found:
    """The whole plan, verified; CPU time until the first solution, the refined flight, the plan and the verdict."""
    began = time.process_time()
    rounds: list[MeshRound] = []
    at_s: list[float] = []

    def on_round(done: MeshRound) -> None:
        rounds.append(done)
        at_s.append(time.process_time() - began)

    plan = make_plan(scenario, on_round)
    plan_s = time.process_time() - began
    report = verify(plan)
    parts = []  # of the leader, between the two states of the common problem
    for poly in (plan.leader_trajectory.state, plan.leader_trajectory.control):
        first, last = (int(np.abs(poly.x - t_s).argmin()) for t_s in (0.0, scenario.time.flight_s))
        parts.append(PPoly(poly.c[:, first:last], poly.x[first : last + 1]))
    return {
        "cold_cpu_s": at_s[0],
        "flight_cpu_s": at_s[len(plan.mesh_history) - 1],
        "plan_cpu_s": plan_s,
        "verified_cpu_s": time.process_time() - began,
        "success": report.ok,
        "status": "; ".join(str(check) for check in report.checks if not check.ok) or "verified",
        "solver_s": rounds[0].seconds,
        "iterations": rounds[0].iterations,
        "solves": len(rounds),
        "objective": plan.objective,
        "points_s": list(plan.route_s),
    } | interpolated(Trajectory(*parts))


def interpolated(flown: Trajectory) -> Found:
    """Per interval as many points as its polynomial has coefficients, strictly inside."""
    found: Found = {"joints_s": flown.joints_s.tolist()}
    for name, poly in (("state", flown.state), ("control", flown.control)):
        tau = 0.5 * (np.polynomial.legendre.leggauss(len(poly.c))[0] + 1.0)
        spans = list(zip(poly.x[:-1], poly.x[1:], strict=True))
        found[name] = [poly(low + tau * (high - low)).tolist() for low, high in spans]
        found[f"{name}_tau"] = [tau.tolist()] * len(spans)
    return found


def answer(given: Found, fleet: str, how: str) -> Found:
    """Solve as asked; all time counts from the scenario on."""
    mesh = Mesh(np.array(given["joints_s"]), tuple(given["degrees"]))
    formation = on_route() if given["points_ned_m"] else six()
    scenario = formation if fleet == "six" else alone(formation)
    began, began_cpu = time.perf_counter(), time.process_time()
    if how == "plan":
        return verified_plan(scenario) | made_with("skein-gcs")
    if how == "one_solve":
        found = one_solve(*route_problem(), ControlForm.LAGRANGE)
    elif how == "refined":
        found = refined(flight_problem(scenario))
    else:
        problem = flight_problem(scenario)
        found = one_solve(problem, mesh, straight(problem), ControlForm[how.upper()])
    spent = {"cold_s": time.perf_counter() - began, "cold_cpu_s": time.process_time() - began_cpu}
    return spent | {"success": True, "status": "Solve_Succeeded"} | found | made_with("skein-gcs")


def main(problem: str, result: str, fleet: str, how: str) -> None:
    """Read the problem and write the result."""
    ca.has_nlpsol("ipopt")  # loads the library: that is part of importing
    with contextlib.redirect_stdout(sys.stderr):
        found = answer(json.loads(Path(problem).read_text()), fleet, how)
    Path(result).write_text(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:5])
