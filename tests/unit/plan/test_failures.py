"""No quiet result: what cannot be flown ends in an error with the solver's status and what stands in the way."""

from __future__ import annotations

import _thread
import re
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible, OutOfTime, PlanningError
from gcs.plan.nlp import ipopt as solve_module
from gcs.plan.nlp import mesh_refinement
from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.mesh import Mesh, end_refined
from gcs.plan.nlp.transcription import Program, transcribe
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.planner import make_plan
from gcs.scenario.schema.scenario import Scenario
from gcs.util.long_work import shown
from tests.unit.plan.problems import alone, changed, meadow, straight
from tests.unit.plan.route_flights import CORNER, flight_through
from tests.unit.plan.route_flights import FAR as FAR_POINT

# Right across the way, far higher than the ceiling of 35 m.
WALL = {
    "north_m": [100.0],
    "east_m": [7.0],
    "height_m": [200.0],
    "spread_north_m": [30.0],
    "spread_east_m": [4000.0],
}


FAR = {"position_m": [200.0, 14.0, 5.0]}
WALLED = {"terrain": {"ripple": None, "mountains": WALL}, "time": {"flight_s": 60.0}, "end": FAR}
# 498 m in 60 s, where 5 m/s are allowed.
TOO_FAST = {"time": {"flight_s": 60.0}, "end": {"position_m": [500.0, 14.0, 5.0]}}


def program(scenario: Scenario) -> Program:
    problem = flight_problem(scenario)
    return transcribe(problem, Mesh(np.linspace(problem.start_s, problem.end_s, 7), (4,) * 6), straight(problem))


def attempt(scenario: Scenario) -> PlanningError:
    made = program(scenario)
    with pytest.raises(PlanningError) as caught:
        solve(made, made.scaled(straight(flight_problem(scenario))))
    return caught.value


@pytest.mark.parametrize(
    ("tables", "against"),
    [
        (TOO_FAST, "limit of north speed"),
        (WALLED, "limit of north speed and the clearance of vehicle 1"),
        (
            {"no_fly": [{"north_m": 20.0, "east_m": 700.0, "radius_m": 698.0}]},
            "limit of east position and the no-fly zone 1 for vehicle 1",
        ),
    ],
    ids=["too little time", "a wall under a low ceiling", "a disk across the box"],
)
def test_a_failure_names_the_status_the_worst_constraint_and_what_stands_in_the_way(
    simulation1: Scenario, tables: dict[str, Any], against: str
) -> None:
    failure = attempt(meadow(alone(simulation1), **tables))
    assert isinstance(failure, Infeasible)
    assert failure.exit_code == 4
    assert "IPOPT: Infeasible_Problem_Detected" in failure.message
    assert "the largest violation is of Eq. 1 for" in failure.message
    assert f"against the {against}" in failure.message
    assert "flight_s" in failure.hint


def test_every_iteration_of_a_solve_is_reported(simulation1: Scenario) -> None:
    scenario, lines = meadow(alone(simulation1)), list[str]()
    made = program(scenario)
    with shown(lines.append, 0.0):
        found = solve(made, made.scaled(straight(flight_problem(scenario))))
    assert len(lines) == found.iterations + 1  # the guess is one
    assert lines[3] == "solving: iteration 4 of at most 250"


def test_a_solve_without_end_is_ended_with_a_sentence(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(solve_module.OPTIONS, "ipopt.max_wall_time", 1e-6)
    assert "one solve took longer than 15 min" in attempt(meadow(alone(simulation1))).message


@pytest.mark.slow
def test_a_failure_on_a_route_names_the_leg(simulation1: Scenario) -> None:
    flight = flight_through(simulation1, {**CORNER, "at_s": 12.0}, {**FAR_POINT, "at_s": 21.0})
    with pytest.raises(Infeasible) as caught:
        make_plan(flight)
    assert re.search(r"at t = \d+\.\d s in leg [1-3] \((start|point [12]) to (point [12]|end)\)", caught.value.message)


def test_running_out_of_iterations_is_a_failure_too(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(solve_module.OPTIONS, "ipopt.max_iter", 3)
    failure = attempt(meadow(alone(simulation1)))
    assert not isinstance(failure, Infeasible)
    assert "the iteration limit was reached (IPOPT: Maximum_Iterations_Exceeded)" in failure.message


def test_a_guess_that_creeps_is_given_up_and_one_that_converges_is_the_same(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without this, the guess of two rounds through a gate takes half of the planning time, in vain."""
    iterations: list[int] = []
    run = solve_module.run

    def counted(solver: solve_module.Solver, *rest: Any) -> solve_module.Solution:
        try:
            return run(solver, *rest)
        finally:
            iterations.append(solver.iterations.done)

    monkeypatch.setattr(solve_module, "run", counted)
    made, start = program(meadow(alone(simulation1), **WALLED)), straight(flight_problem(meadow(alone(simulation1))))
    with pytest.raises(PlanningError, match="the constraints contradict each other") as given_up:
        solve(made, made.scaled(start), giving_up=True)
    assert not isinstance(given_up.value, OutOfTime)
    assert iterations == [31]
    easy = program(meadow(alone(simulation1)))
    kept, free = (solve(easy, easy.scaled(start), giving_up=giving_up) for giving_up in (True, False))
    assert np.array_equal(kept.y, free.y)


def test_ctrl_c_stops_a_solve_and_is_not_taken_for_its_failure(
    simulation1: Scenario, capfd: pytest.CaptureFixture[str]
) -> None:
    """In 242 s the way is too long by a little, and the solver tries for many seconds."""
    problem = flight_problem(changed(simulation1, time={"flight_s": 242.0}))
    made = transcribe(problem, end_refined(0.0, 242.0, 9.0, 1.0, 5), straight(problem))
    start = made.scaled(straight(problem))
    timer = threading.Timer(0.5, _thread.interrupt_main)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        solve(made, start)
    timer.join()
    assert capfd.readouterr() == ("", ""), "the solver's own words for Ctrl-C"


def test_ctrl_c_while_an_iteration_is_reported_is_not_taken_for_the_time_limit(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    scenario = meadow(alone(simulation1))
    problem = flight_problem(scenario)
    made = transcribe(problem, Mesh(np.linspace(0.0, 20.0, 4), (3, 3, 3)), straight(problem))
    monkeypatch.setattr(solve_module, "report", interrupted)
    with pytest.raises(KeyboardInterrupt):
        solve(made, made.scaled(straight(problem)))


def test_functions_without_a_value_are_a_failure_and_do_not_hide_the_rest(simulation1: Scenario) -> None:
    scenario = meadow(alone(simulation1))
    problem = flight_problem(scenario)
    broken = replace(problem, quadrotor=replace(problem.quadrotor, drag_Nspm=(float("nan"),) * 3))
    made = transcribe(broken, Mesh(np.linspace(0.0, 20.0, 4), (3, 3, 3)), straight(broken))
    with pytest.raises(PlanningError, match="not finite"):
        solve(made, made.scaled(straight(problem)))


@pytest.mark.parametrize("tables", [{"time": {"flight_s": 6.0}}, WALLED], ids=["time", "wall"])
def test_the_planner_passes_it_on(simulation1: Scenario, tables: dict[str, Any]) -> None:
    with pytest.raises(PlanningError) as caught:
        make_plan(meadow(alone(simulation1), **tables))
    assert caught.value.message
    assert caught.value.hint


def test_a_mesh_that_is_never_good_enough_is_a_failure(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_refinement, "MAX_ROUNDS", 1)
    disk = {"north_m": 20.0, "east_m": 8.0, "radius_m": 4.0}
    problem = flight_problem(meadow(alone(simulation1), no_fly=[disk]))
    with pytest.raises(PlanningError, match=r"1 refinements .* no-fly zone 1 violated by .* m at t = .* s"):
        mesh_refinement.optimise(problem, straight(problem))


def test_a_second_solve_knows_the_first(simulation1: Scenario) -> None:
    made = program(meadow(alone(simulation1)))
    first = solve(made, made.scaled(straight(flight_problem(meadow(alone(simulation1))))))
    again = solve(made, first.y, first)
    assert again.iterations < first.iterations / 2
    assert again.objective == pytest.approx(first.objective, rel=1e-6)
    np.testing.assert_allclose(again.y, first.y, atol=1e-3)
