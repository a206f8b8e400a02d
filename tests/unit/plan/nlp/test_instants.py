"""Instants between nodes: dense where a zone is passed or a limit is exceeded, none elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.plan.nlp.instants import instants_between, instants_near_zones
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.mesh_refinement import FROM_SOLUTION
from gcs.plan.nlp.transcription import Program, transcribe
from gcs.plan.nlp.variables import VariableLayout
from gcs.plan.nlp.violations import Violation
from gcs.plan.ocp.problem import Problem, flight_problem
from gcs.plan.ocp.stage_functions import EVERYWHERE, RowReach
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.problems import alone, meadow, straight

MESH = Mesh(np.array([0.0, 10.0, 20.0]), (5, 5))
STOPS = np.union1d(VariableLayout(MESH).node_times_s(), MESH.joints_s)


def miss(kind: Kind, begin_s: float, worst_s: float, end_s: float) -> Violation:
    return Violation(ConstraintId(kind), "m", worst_s, 0.1, 0.1, 9.0, (begin_s, end_s))


def passing(scenario: Scenario, **tables: Any) -> Problem:
    """Straight north for 100 m in 20 s, beside a disk halfway."""
    disk = {"north_m": 52.0, "east_m": 12.0, "radius_m": 10.0}
    far = {"position_m": [102.0, 1.0, 3.0]}
    return flight_problem(meadow(alone(scenario), end=far, **{"no_fly": [disk]} | tables))


def test_beside_a_zone_all_gaps_that_the_contact_may_move_to_are_enforced() -> None:
    found = instants_between(MESH, (miss(Kind.ZONE, 4.0, 4.1, 4.3),))
    every = np.union1d(found, STOPS)
    inside = every[(every >= 3.0) & (every <= 5.3)]
    assert np.diff(inside).max() < 0.2501
    first, last = STOPS[STOPS < 3.0].max(), STOPS[STOPS > 5.3].min()
    assert first < found.min() and found.max() < last
    assert 4.1 in found


def test_in_a_gap_a_limit_is_enforced_at_eight_parts_and_where_it_is_exceeded_most() -> None:
    gap = STOPS[2:4]
    worst_s = round(float(gap @ [0.7, 0.3]), 3)
    found = instants_between(MESH, (miss(Kind.YAW_RATE, worst_s - 0.1, worst_s, worst_s + 0.1),))
    assert worst_s in found
    assert len(found) == 8
    assert gap[0] < found.min() and found.max() < gap[1]
    short = Mesh(np.array([0.0, 0.5, 1.0]), (5, 5))
    assert np.diff(instants_between(short, (miss(Kind.YAW_RATE, 0.2, 0.22, 0.24),))).min() > 0.01


def test_nothing_is_enforced_where_nothing_is_wrong() -> None:
    assert instants_between(MESH, ()).size == 0


def test_a_guess_cannot_jump_over_a_zone(simulation1: Scenario) -> None:
    problem = passing(simulation1)
    found = instants_near_zones(problem, MESH, straight(problem))
    every = np.union1d(found, STOPS)
    beside = every[(every > 6.0) & (every < 14.0)]  # 20 m either way
    assert np.diff(beside).max() < 0.4001  # 2 m at 5 m/s
    for zones in ([], [{"north_m": 52.0, "east_m": 95.0, "radius_m": 40.0}]):  # none, or far away
        free = passing(simulation1, no_fly=zones)
        assert instants_near_zones(free, MESH, straight(free)).size == 0


@pytest.mark.parametrize("reach", [EVERYWHERE, FROM_SOLUTION, RowReach(1.0, 5.0)])
def test_the_program_has_rows_about_what_is_within_reach(simulation1: Scenario, reach: RowReach) -> None:
    problem = passing(simulation1)
    mesh = MESH.enforcing_at(np.array([9.9, 19.9]))
    guess = straight(problem)
    program = transcribe(problem, mesh, guess, reach=reach)
    every = np.append(STOPS[[t not in MESH.joints_s for t in STOPS]], mesh.extra_s)
    places = {t_s: guess.state(t_s)[:2] for t_s in every.tolist()}
    near = {t_s for t_s, place in places.items() if outside_m(place) < reach.zone_m}
    assert {t_s for one, t_s in program.g_ids if one.kind is Kind.ZONE} == near
    assert len(near) > 0 and (len(near) < len(every)) == (reach is not EVERYWHERE)
    assert rows_of(program, Kind.YAW, 9.9) == (reach is EVERYWHERE)
    assert rows_of(program, Kind.HEIGHT, 9.9)  # 3 m over ground that counts as 0 in a range of 35 m
    assert program.nlp.size1_out(1) == len(program.g_ids) == len(program.g_low) == len(program.g_high)


def outside_m(place: Array) -> float:
    """As the program has it: a little more than the distance."""
    return float((np.sum((place - [52.0, 12.0]) ** 2) - 10.0**2) / 20.0)


def rows_of(program: Program, kind: Kind, t_s: float) -> int:
    """Number of rows of a kind at an instant, as bounds of the state."""
    return sum(one.kind is kind and "bound" in str(one.form).lower() for one, at_s in program.g_ids if at_s == t_s)
