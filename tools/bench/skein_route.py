"""Skein as a contender on the common problem of several legs, from its first solution to a verified plan.

Run as `python -m tools.bench.skein_route problem.json result.json WHAT`, a process of its own like the others. WHAT is
leader or six, for the verified plan of the leader alone or of the formation, or lagrange: one solve of the leader with
the control of Eq. 41, which is the peers' form.
"""

from __future__ import annotations

import contextlib
import json
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import PPoly

from gcs import make_plan, verify
from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.program.transcription import transcribe
from gcs.plan.nlp.variables import ControlForm
from gcs.plan.trajectory.plan import MeshRound, Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tools.bench.describe import alone
from tools.bench.describe_route import route_guess, route_mesh, route_problem, six_on_route
from tools.bench.skein import points


def verified_plan(scenario: Scenario) -> dict[str, Any]:
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
    verified_s = time.process_time() - began
    flight = len(plan.mesh_history)
    return {
        "cold_cpu_s": at_s[0],
        "flight_cpu_s": at_s[flight - 1],
        "plan_cpu_s": plan_s,
        "verified_cpu_s": verified_s,
        "success": report.ok,
        "status": "; ".join(str(check) for check in report.checks if not check.ok) or "verified",
        "iterations": rounds[0].iterations,
        "solves": len(rounds),
        "objective": plan.objective,
        "points_s": list(plan.route_s),
    } | _interpolated(_flight(plan))


def one_solve() -> dict[str, Any]:
    """The leader's first program with the control of Eq. 41, cold."""
    began = time.process_time()
    problem, route = route_problem()
    mesh, guess = route_mesh(problem), route_guess(problem, route)
    program = transcribe(problem, mesh, guess, ControlForm.LAGRANGE)
    solution = solve(program, program.scaled(guess))
    flown = program.mesh(solution.y)
    return {
        "cold_cpu_s": time.process_time() - began,
        "success": True,
        "status": "Solve_Succeeded",
        "iterations": solution.iterations,
        "objective": solution.objective,
        "points_s": flown.joints_s[flown.arrivals].tolist(),
    } | _interpolated(program.trajectory(solution.y))


def _flight(plan: Plan) -> Trajectory:
    """The leader's part of the plan between the two states of the common problem."""
    end_s = plan.scenario.time.flight_s
    parts = []
    for poly in (plan.leader_trajectory.state, plan.leader_trajectory.control):
        first, last = (int(np.abs(poly.x - t_s).argmin()) for t_s in (0.0, end_s))
        parts.append(PPoly(poly.c[:, first:last], poly.x[first : last + 1]))
    return Trajectory(*parts)


def _interpolated(flown: Trajectory) -> dict[str, Any]:
    state_tau, state = points(flown.state)
    control_tau, control = points(flown.control)
    return {
        "joints_s": flown.joints_s.tolist(),
        "state_tau": state_tau,
        "state": state,
        "control_tau": control_tau,
        "control": control,
        "versions": {name: version(name) for name in ("skein-gcs", "casadi", "numpy")},
        "python": platform.python_version(),
    }


def main(_: str, answer: str, what: str) -> None:
    """Solve as asked and write the result."""
    ca.has_nlpsol("ipopt")  # loads the library: that is part of importing
    six = six_on_route()
    with contextlib.redirect_stdout(sys.stderr):
        result = one_solve() if what == "lagrange" else verified_plan(six if what == "six" else alone(six))
    Path(answer).write_text(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:4])
