"""A free time of flight: closed forms, bounds, time against energy, and scenarios without a plan."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.plan.nlp.mesh import end_refined
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.planner import make_plan
from gcs.plan.search.free_final_time import with_free_time
from gcs.plan.search.initial_guess import along, straight_route
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tests.unit.plan.formations import ROOMY, STRONG
from tests.unit.plan.problems import alone, meadow

REFERENCE_S = 40.0


def free(scenario: Scenario, time_weight: float, energy_weight: float = 1.0, **time: float) -> Scenario:
    return meadow(
        alone(scenario),
        time={"flight_s": REFERENCE_S, "free": True, **time},
        objective={"weights": [energy_weight, 0.0, 0.0], "time_weight": time_weight},
        end={"position_m": [62.0, 1.0, 3.0]},
    )


def verified(scenario: Scenario) -> Plan:
    plan = make_plan(scenario)
    report = verify(plan)
    assert report.ok, report.failures
    assert plan.scenario.time.flight_s == plan.phase("mission").end_s
    assert not plan.scenario.time.free
    return plan


def dash(scenario: Scenario, length_m: float, accel_mps2: float, speed_mps: float) -> Scenario:
    """From rest to rest as quickly as may be."""
    return meadow(
        alone(scenario),
        vehicle=STRONG,
        limits=ROOMY | {"accel_max_mps2": accel_mps2, "speed_ned_mps": [speed_mps, speed_mps, 1.5]},
        end={"position_m": [2.0 + length_m, 1.0, 3.0]},
        time={"flight_s": 30.0, "free": True},
        objective={"weights": [0.0, 0.0, 0.0], "time_weight": 1.0},
    )


@pytest.mark.parametrize(
    ("length_m", "accel_mps2", "speed_mps", "least_s"),
    [
        (20.0, 0.5, 4.0, 2.0 * (20.0 / 0.5) ** 0.5),
        pytest.param(60.0, 0.8, 3.0, 60.0 / 3.0 + 3.0 / 0.8, marks=pytest.mark.slow),
    ],
)
def test_the_least_time_from_rest_to_rest(
    simulation1: Scenario, length_m: float, accel_mps2: float, speed_mps: float, least_s: float
) -> None:
    """The double integrator's: bang-bang, or a trapezoid of speed; a vehicle that has to tilt takes a little more."""
    plan = verified(dash(simulation1, length_m, accel_mps2, speed_mps))
    assert least_s < plan.flight_s < 1.09 * least_s
    ground = plan.scenario.ground_phases
    whole_s = plan.flight_s + ground.takeoff_s + 2.0 * ground.hover_s + ground.landing_s
    assert plan.t_end_s - plan.t_start_s == pytest.approx(whole_s)


@pytest.mark.long
def test_energy_and_time_are_traded_monotonely(simulation1: Scenario) -> None:
    """d/dT of k (T_ref / T)^2 + w T / T_ref vanishes at T_ref (2 k / w)^(1/3); starting and stopping make k > 1."""
    flights = [verified(free(simulation1, weight)).flight_s for weight in (0.5, 6.0)]
    assert flights[0] > flights[1]
    for weight, flight_s in zip((0.5, 6.0), flights, strict=True):
        ideal_s = REFERENCE_S * (2.0 / weight) ** (1.0 / 3.0)
        assert ideal_s < flight_s < 1.2 * ideal_s


@pytest.mark.long
def test_no_other_time_costs_less(simulation1: Scenario) -> None:
    best = verified(free(simulation1, 2.0))
    assert best.flight_s == pytest.approx(44.05, abs=0.6)
    for other_s in (0.95 * best.flight_s, 1.05 * best.flight_s):
        other = verified(free(simulation1, 2.0, earliest_s=other_s - 1e-3, latest_s=other_s))
        assert other.objective > best.objective


def test_what_has_no_plan_in_its_time_has_one_in_the_best(simulation1: Scenario) -> None:
    hopeless = free(simulation1, 1.0, 0.1).model_copy(
        update={"time": simulation1.time.model_copy(update={"flight_s": 11.0})}
    )
    with pytest.raises(Infeasible, match="11 s are too short"):
        make_plan(hopeless)
    time = hopeless.time.model_copy(update={"free": True})
    plan = verified(hopeless.model_copy(update={"time": time}))
    assert 17.0 < plan.flight_s < 22.0
    late = time.model_copy(update={"latest_s": 11.5})
    with pytest.raises(Infeasible, match=r"11\.5 s are too short"):
        make_plan(hopeless.model_copy(update={"time": late}))


@pytest.mark.long
def test_energy_alone_takes_all_the_time_it_may(simulation1: Scenario) -> None:
    plan = verified(free(simulation1, 0.0, latest_s=55.0))
    assert plan.flight_s == 55.0


def test_the_derivatives_are_those_of_the_program(simulation1: Scenario) -> None:
    """Columns of time beside all others, against differences of the gradient and of the constraints."""
    problem = with_free_time(flight_problem(free(simulation1, 2.0)))
    guess = along(problem, straight_route(problem))
    mesh = end_refined(problem.start_s, problem.end_s, 9.0, 2.0, 3)
    program = transcribe(problem, mesh, guess)
    rng = np.random.default_rng(5)
    y = program.scaled(guess) + 0.02 * rng.normal(size=len(program.y_low))
    weights = rng.normal(size=len(program.g_low))

    def at(y: Any) -> tuple[float, np.ndarray]:
        cost, constraints = program.nlp(y, [])
        return float(cost), np.asarray(constraints).ravel()

    _, gradient = program.derivatives["grad_f"](y, [])
    _, jacobian = program.derivatives["jac_g"](y, [])
    upper = np.asarray(program.derivatives["hess_lag"](y, [], 0.7, weights))
    hessian = upper + np.triu(upper, 1).T
    direction = rng.normal(size=len(y))
    direction[-1] = 3.0
    step = 1e-5

    def pull(y: Any) -> np.ndarray:
        slope = np.asarray(program.derivatives["grad_f"](y, [])[1]).ravel()
        return 0.7 * slope + np.asarray(program.derivatives["jac_g"](y, [])[1]).T @ weights

    (more, above), (less, below) = at(y + step * direction), at(y - step * direction)
    assert (more - less) / (2 * step) == pytest.approx(float(np.asarray(gradient).ravel() @ direction), rel=1e-5)
    np.testing.assert_allclose((above - below) / (2 * step), np.asarray(jacobian) @ direction, atol=2e-4)
    bent = (pull(y + step * direction) - pull(y - step * direction)) / (2 * step)
    np.testing.assert_allclose(bent, hessian @ direction, atol=2e-4 * np.abs(bent).max())


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({}, "needs a cost of time, or the slowest flight is the best"),
        (
            {
                "objective": {"time_weight": 1.0},
                "formation": {"change": [{"kind": "rotate", "angle_deg": 9.0, "at_s": 5.0}]},
            },
            "changes of the formation have times of their own|while changes",
        ),
        (
            {
                "objective": {"time_weight": 1.0},
                "no_fly": [
                    {"north_m": 30.0, "east_m": 90.0, "radius_m": 5.0, "moves": [[0.0, 0.0, 0.0], [9.0, 1.0, 0.0]]}
                ],
            },
            "while no-fly zones move",
        ),
    ],
)
def test_times_that_cannot_be_chosen_are_refused(simulation1: Scenario, tables: dict[str, Any], words: str) -> None:
    scenario = meadow(simulation1, **{"time": {"flight_s": 40.0, "free": True}, **tables})
    mistakes = [str(mistake) for mistake in check(scenario)]
    assert any(mistake.startswith("time.free = true: ") for mistake in mistakes)
    assert any(part in mistake for mistake in mistakes for part in words.split("|"))
