"""What position errors leave of a separation: closed forms, the emulated sensors' figures, bundled missions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.position_errors import DEVIATIONS, SIGMA, climb_separation_m, separation_left
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.dynamics.sensors import GRADES


def with_sensors(plan: Plan, grade: str) -> Plan:
    data = plan.scenario.model_dump(mode="json")
    data["sensors"]["grade"] = grade
    return replace(plan, scenario=Scenario.model_validate(data))


def test_the_figures_are_those_of_the_emulated_sensors() -> None:
    assert SIGMA.keys() == GRADES.keys()
    for name, grade in GRADES.items():
        drift = grade.gnss_drift
        white = grade.gnss_white
        assert SIGMA[name].horizontal_m == (drift[0].sigma or white[0])
        assert SIGMA[name].vertical_m == (drift[2].sigma or white[2])


def test_vehicles_side_by_side_lose_the_difference_of_two_errors(simulation1_plan: Plan) -> None:
    left = separation_left(simulation1_plan)
    assert left is not None
    assert left.pair == (2, 5)
    assert left.planned_m == pytest.approx(0.5, abs=1e-3)  # on their pads
    assert left.left_m == pytest.approx(left.planned_m - DEVIATIONS * math.sqrt(2.0) * 0.01, abs=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        "simulation1",
        "field",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("changes", "simulation2", "ridge", "gap")),
    ],
)
def test_the_bundled_missions_keep_their_required_separation(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(f"{name}/scenario.toml")
    left = separation_left(plan)
    assert left is not None
    assert left.left_m >= plan.scenario.judge.separation_min_m


def test_gnss_cannot_fly_a_formation_of_half_a_metre(simulation1_plan: Plan) -> None:
    left = separation_left(with_sensors(simulation1_plan, "gnss"))
    assert left is not None
    assert left.left_m < 0.0


def test_climbing_vehicles_are_apart_by_their_columns_alone(simulation1_plan: Plan) -> None:
    plan = simulation1_plan
    pads = plan.pads_ned_m[:, :2]
    pairs = [np.linalg.norm(pads[a] - pads[b]) for a in range(6) for b in range(a)]
    assert climb_separation_m(plan) == pytest.approx(min(pairs))
    (check,) = (c for c in verify(plan).checks if c.name == "separation over the pads")
    assert check.ok
    assert check.worst == pytest.approx(min(pairs) - plan.scenario.judge.separation_min_m)
    data = plan.scenario.model_dump(mode="json")
    data["limits"]["separation_min_m"] = data["judge"]["separation_min_m"] = 0.55
    nearer = verify(replace(plan, scenario=Scenario.model_validate(data)))
    assert "separation over the pads" in {c.name for c in nearer.failures}


def with_places(plan: Plan, places_ned_m: list[list[float]]) -> Plan:
    """Three vehicles at these places (NED) of a rigid shape, the whole flight; their pads are as they were."""
    return replace(plan, shape=rigid(np.array(places_ned_m), plan.t_start_s, plan.t_end_s))


def test_the_pair_that_loses_most_counts_and_not_the_nearest_one(meadow_plan: Plan) -> None:
    """Heights are known less well: 9.5 m above each other leave less than 9 m beside each other; on landing, 30 m."""
    flown = [[0.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, -9.5]]
    landed = [[0.0, 0.0, 0.0], [0.0, 30.0, 0.0], [30.0, 0.0, 0.0]]
    joints = np.array([meadow_plan.t_start_s, meadow_plan.phase("landing").start_s, meadow_plan.t_end_s])
    shape = Shape(PPoly(np.array([[[1.0, 0.0], [0.0, 1.0]]]), joints), np.array([flown, landed]))
    plan = with_sensors(replace(meadow_plan, shape=shape, begin_state=(0.0,) * 12), "gnss")
    found = separation_left(plan)
    assert found is not None
    assert (found.planned_m, found.pair) == (pytest.approx(9.5), (plan.sysids[0], plan.sysids[2]))
    assert found.left_m == pytest.approx(9.5 - DEVIATIONS * math.sqrt(2.0) * SIGMA["gnss"].vertical_m)


def test_pads_count_only_for_a_plan_that_takes_off(meadow_plan: Plan) -> None:
    """They are 2 m apart at most, the places of this shape and its landing points 20 m."""
    plan = with_places(meadow_plan, [[0, 0, 0], [0, 20, 0], [20, 0, 0]])
    on_the_ground, in_the_air = separation_left(plan), separation_left(replace(plan, begin_state=(0.0,) * 12))
    assert on_the_ground is not None and in_the_air is not None
    assert on_the_ground.planned_m < 3.0
    assert on_the_ground.t_s == plan.t_start_s
    assert in_the_air.planned_m == pytest.approx(20.0)
