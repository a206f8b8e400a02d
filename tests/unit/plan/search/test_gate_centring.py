"""In a gate between two no-fly zones the leader keeps to the middle, for no more than 0.1 % of the optimum."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.cli.planning.plan_tables import say_gates
from gcs.cli.shared.console import Screen
from gcs.plan.planner import make_plan
from gcs.plan.search import free_final_time
from gcs.plan.search.gate_centring import DEFAULT_PERCENT
from gcs.plan.trajectory.gates import gates_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import alone, meadow

_NORTH_M, _EDGE_M = 100.0, 0.5  # where the gate is, and its edge beside the straight way
_CENTRED_M = 0.35  # what the rounded edge of a zone leaves


def through_gate(scenario: Scenario, width_m: float, *, mirrored: bool = False, **point: Any) -> Scenario:
    """A leader alone on a drawn leg of 200 m, which a gate between two walls nearly lets through."""
    side = -1.0 if mirrored else 1.0
    walls = [(-40.0, _EDGE_M), (_EDGE_M + width_m, 60.0)]
    return meadow(
        alone(scenario),
        time={"flight_s": 110.0},
        limits={"north_m": [-20.0, 240.0], "east_m": [-80.0, 80.0]},
        start={"position_m": [0.0, 0.0, 3.0]},
        end={"position_m": [200.0, 20.0 * side, 3.0]},
        route=[{"position_m": [200.0, 0.0, 3.0], "corridor_m": "free", **point}],
        objective={"height_ref_m": 3.0},
        no_fly=[
            {
                "polygon_m": [
                    [_NORTH_M, side * low],
                    [_NORTH_M, side * high],
                    [_NORTH_M + 3.0, side * high],
                    [_NORTH_M + 3.0, side * low],
                ]
            }
            for low, high in walls
        ],
    )


@pytest.mark.parametrize(
    ("width_m", "mirrored"),
    [(3.0, False), pytest.param(3.0, True, marks=pytest.mark.slow), pytest.param(2.5, False, marks=pytest.mark.slow)],
)
def test_a_drawn_leg_passes_the_middle_of_a_gate(
    simulation1: Scenario,
    width_m: float,
    mirrored: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    scenario = through_gate(simulation1, width_m, mirrored=mirrored)
    plan = make_plan(scenario)
    assert verify(plan).ok
    low_m, high_m = _beside(plan, width_m)
    assert low_m + high_m == pytest.approx(width_m, abs=0.3)
    assert abs(low_m - high_m) < _CENTRED_M

    monkeypatch.setattr(free_final_time, "centred", lambda problem, best, on_round: best)
    shortest = make_plan(scenario)
    assert min(_beside(shortest, width_m)) < 0.5 * width_m - _CENTRED_M
    assert shortest.objective <= plan.objective <= (1.0 + 0.01 * DEFAULT_PERCENT) * shortest.objective

    assert not list(gates_of(plan))
    ((gate, near_m, far_m),) = gates_of(shortest)
    assert (gate.zone, gate.far_zone) == (0, 1)
    assert (near_m, far_m) == pytest.approx(_beside(shortest, width_m), abs=0.1)
    assert gate.aside_m == pytest.approx(0.5 * (far_m - near_m), abs=0.2)
    say_gates(Screen(), shortest)
    told = f": [objective] gate_cost_percent = 0.1 pays for no more; a greater one for up to {gate.aside_m:.1f} m more"
    assert f"{near_m:.2f} m from the one and {far_m:.2f} m from the other{told}" in capsys.readouterr().out


@pytest.mark.slow
def test_room_that_costs_more_than_a_thousandth_is_left(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = through_gate(simulation1, 10.0)
    plan = make_plan(scenario)
    monkeypatch.setattr(free_final_time, "centred", lambda problem, best, on_round: best)
    shortest = make_plan(scenario)
    assert shortest.objective <= plan.objective <= (1.0 + 0.01 * DEFAULT_PERCENT) * shortest.objective
    wide, near = (min(_beside(each, 10.0)) for each in (plan, shortest))
    assert wide > near + 0.3


@pytest.mark.slow
def test_the_middle_of_a_wide_gate_is_flown_where_the_scenario_pays_for_it(simulation1: Scenario) -> None:
    scenario = through_gate(simulation1, 10.0)
    objective = scenario.objective.model_copy(update={"gate_cost_percent": 100.0})
    plan = make_plan(scenario.model_copy(update={"objective": objective}))
    assert verify(plan).ok
    low_m, high_m = _beside(plan, 10.0)
    assert abs(low_m - high_m) < 2.0 * _CENTRED_M
    assert not list(gates_of(plan))


def _beside(plan: Plan, width_m: float) -> tuple[float, float]:
    """How far the leader passes from the one wall and from the other."""
    states = plan.states(np.arange(0.0, 110.0, 0.05))[0]
    inside = (states[:, 0] > _NORTH_M) & (states[:, 0] < _NORTH_M + 3.0)
    east_m = np.abs(states[inside, 1]) - _EDGE_M
    return float(east_m.min()), float(width_m - east_m.max())
