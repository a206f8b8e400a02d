"""Multipliers of a solution whose legs became longer: each keeps its row, and the next solve profits."""

from __future__ import annotations

import numpy as np

from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.mesh_refinement import moved, with_times
from gcs.plan.nlp.route_phases import first_mesh
from gcs.plan.nlp.transcription import transcribe
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import CORNER, FAR, first_guess, flight_through


def test_a_moved_solution_names_every_row_again_and_is_solved_at_once(simulation1: Scenario) -> None:
    problem, guess = first_guess(flight_through(simulation1, {**CORNER, "radius_m": 3.0}, {**FAR, "hold_s": 3.0}))
    first_guess_mesh = first_mesh(problem, 9.0, 1.0, 4)
    program = transcribe(problem, first_guess_mesh, guess)
    cold = solve(program, program.scaled(guess))
    mesh = program.mesh(cold.y)
    assert np.abs(mesh.joints_s - first_guess_mesh.joints_s).max() > 0.1  # the legs' times did change
    warm = moved(cold, first_guess_mesh, mesh)
    assert list(warm.g_multipliers.values()) == list(cold.g_multipliers.values())
    flown = program.trajectory(cold.y)
    later = with_times(problem, flown.end_s, tuple(mesh.joints_s[mesh.arrivals].tolist()))
    again = transcribe(later, mesh, flown)
    found = {(name, round(t_s, 6)): price for (name, t_s), price in warm.g_multipliers.items()}
    for (name, t_s), price in zip(again.g_ids, cold.g_multipliers.values(), strict=True):
        assert found[name, round(t_s, 6)] == price
    solution = solve(again, again.scaled(flown), warm)
    afresh = solve(again, again.scaled(guess))
    assert solution.iterations < 0.6 * afresh.iterations
