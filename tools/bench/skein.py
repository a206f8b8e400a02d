"""Skein as a contender: the same mesh in both control forms, and the mesh it refines by itself.

Run as `python -m tools.bench.skein problem.json result.json WHAT`, a process of its own like the others. WHAT is
linear, lagrange or refined; with "six" before it, for the whole formation.
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

from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.mesh_refinement import optimise
from gcs.plan.nlp.program.transcription import transcribe
from gcs.plan.nlp.variables import ControlForm
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tools.bench.describe import alone, six, straight


def fixed_mesh(scenario: Scenario, mesh: Mesh, form: ControlForm) -> dict[str, Any]:
    """One solve, cold, from the scenario on."""
    watch = _Watch()
    problem = flight_problem(scenario)
    program = transcribe(problem, mesh, straight(problem), form)
    solution = solve(program, program.scaled(straight(problem)))
    trajectory = program.trajectory(solution.y)
    return watch.read() | _result(solution.seconds, solution.iterations, solution.objective, trajectory, 1)


def refined(scenario: Scenario) -> dict[str, Any]:
    """From the scenario to a trajectory that holds between its nodes."""
    watch = _Watch()
    problem = flight_problem(scenario)
    best = optimise(problem, straight(problem))
    times, history = watch.read(), best.history
    return times | _result(
        sum(r.seconds for r in history),
        sum(r.iterations for r in history),
        best.objective,
        best.trajectory,
        len(history),
    )


class _Watch:
    """Wall and processor time from its making on."""

    def __init__(self) -> None:
        self.began = time.perf_counter(), time.process_time()

    def read(self) -> dict[str, float]:
        return {
            "cold_s": time.perf_counter() - self.began[0],
            "cold_cpu_s": time.process_time() - self.began[1],
        }


def _result(solver_s: float, iterations: int, objective: float, trajectory: Trajectory, rounds: int) -> dict[str, Any]:
    state_tau, state = points(trajectory.state)
    control_tau, control = points(trajectory.control)
    return {
        "solver_s": solver_s,
        "iterations": iterations,
        "rounds": rounds,
        "objective": objective,
        "status": "Solve_Succeeded",
        "success": True,
        "joints_s": trajectory.joints_s.tolist(),
        "state_tau": state_tau,
        "state": state,
        "control_tau": control_tau,
        "control": control,
        "versions": {name: version(name) for name in ("skein-gcs", "casadi", "numpy")},
        "python": platform.python_version(),
    }


def points(poly: PPoly) -> tuple[list[list[float]], list[list[list[float]]]]:
    """Per interval as many points as its polynomial has coefficients, strictly inside."""
    count = len(poly.c)
    tau = 0.5 * (np.polynomial.legendre.leggauss(count)[0] + 1.0)
    x = np.asarray(poly.x)
    values = [poly(x[i] + tau * (x[i + 1] - x[i])).tolist() for i in range(len(x) - 1)]
    return [tau.tolist()] * len(values), values


def main(problem: str, answer: str, what: str) -> None:
    """Solve as asked and write the result."""
    ca.has_nlpsol("ipopt")  # loads the library: that is part of importing
    scenario = six() if what.startswith("six") else alone(six())
    given = json.loads(Path(problem).read_text())
    mesh = Mesh(np.array(given["joints_s"]), tuple(given["degrees"]))
    with contextlib.redirect_stdout(sys.stderr):
        if what.endswith("refined"):
            result = refined(scenario)
        else:
            result = fixed_mesh(
                scenario, mesh, ControlForm.LAGRANGE if what.endswith("lagrange") else ControlForm.LINEAR
            )
    Path(answer).write_text(json.dumps(result))


if __name__ == "__main__":
    main(*sys.argv[1:4])
