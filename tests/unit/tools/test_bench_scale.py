"""Sixty vehicles make the same nonlinear program as six: no more unknowns, hardly more constraints."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from gcs.plan.nlp.mesh import end_refined
from gcs.plan.nlp.transcription import Program, transcribe
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.trajectory.constraint_id import Kind
from tools.bench.memory import peak_mb
from tools.bench_scale import scenario


def program(vehicles: int) -> Program:
    problem = flight_problem(scenario(vehicles))
    mesh = end_refined(problem.start_s, problem.end_s, 9.0, 1.0, 5)
    return transcribe(problem, mesh, along(problem, straight_route(problem)))


def test_the_program_does_not_grow_with_the_fleet() -> None:
    six, many = program(6), program(60)
    assert many.layout.size == six.layout.size
    assert len(many.g_ids) == len(six.g_ids)
    # ... and it watches other vehicles where the ground is another.
    watched = {constraint for constraint, _ in many.g_ids if constraint.kind is Kind.CLEARANCE}
    assert len(watched) > 20


def test_the_benchmark_flies_what_it_says() -> None:
    task = scenario(50, changes=True)
    assert len(task.formation.sysids) == 50
    assert len(task.formation.change) == 3
    assert np.all(np.diff(task.formation.sysids) == 1)


def test_a_small_program_started_by_a_large_one_is_small() -> None:
    """The kernel's ru_maxrss survives exec; what is measured must not."""
    ballast = np.ones(10_000_000)  # 80 MB
    code = "from tools.bench.memory import peak_mb; print(peak_mb())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 40.0 < ballast.nbytes / 1e6 < peak_mb()
