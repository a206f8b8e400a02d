"""Limits of acceleration and jerk: planned and proved for every vehicle, also while a formation changes or turns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.plan.planner import make_plan
from gcs.plan.trajectory.greatest_motion import greatest_motion
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import COURSE, SHRINK, TURN, at, fleet

ACCEL_MPS2, JERK_MPS3 = 0.8, 1.0
COMFORT: dict[str, Any] = {"accel_max_mps2": ACCEL_MPS2, "jerk_max_mps3": JERK_MPS3}
CHANGES = (at(TURN, 1.0), at(SHRINK, 18.0))


def hasty(scenario: Scenario, **limits: Any) -> Scenario:
    """A flight of 40 m in 18 s, with a stop as late as the limits allow."""
    return fleet(scenario, time={"flight_s": 18.0}, limits={"accel_max_mps2": None} | limits)


@pytest.fixture(scope="module")
def unpleasant(simulation1: Scenario) -> Plan:
    return make_plan(hasty(simulation1))


def test_a_stop_is_gentle_where_the_scenario_says_so(simulation1: Scenario, unpleasant: Plan) -> None:
    before = greatest_motion(unpleasant)
    assert before.accel_mps2.max() > ACCEL_MPS2 and before.jerk_mps3.max() > 1.5 * JERK_MPS3
    plan = make_plan(hasty(simulation1, **COMFORT))
    report = verify(plan)
    assert report.ok, report.failures
    after = greatest_motion(plan)
    assert after.accel_mps2.max() <= 1.001 * ACCEL_MPS2
    assert after.jerk_mps3.max() <= 1.001 * JERK_MPS3


def test_a_plan_that_is_not_gentle_is_refused_by_the_verifier(simulation1: Scenario, unpleasant: Plan) -> None:
    asked = replace(unpleasant, scenario=hasty(simulation1, **COMFORT))
    failed = {check.name for check in verify(asked).failures}
    assert {"acceleration", "jerk", "acceleration continuous at joints"} <= failed
    assert verify(unpleasant).ok


@pytest.mark.parametrize(
    "formation", [{}, pytest.param(COURSE, marks=pytest.mark.slow)], ids=["inertial", "along the course"]
)
def test_every_vehicle_keeps_the_limits_while_the_shape_changes(
    simulation1: Scenario, formation: dict[str, Any]
) -> None:
    changes = CHANGES if not formation else (at(SHRINK, 2.0),)
    plan = make_plan(fleet(simulation1, changes=changes, time={"flight_s": 40.0}, limits=COMFORT, formation=formation))
    report = verify(plan)
    assert report.ok, report.failures
    sizes = np.linalg.norm(plan.jerks(np.linspace(0.0, 39.99, 2000)), axis=-1)  # (V, N)
    assert np.ptp(sizes, axis=0).max() > 0.05, "followers move as the leader does"
    assert sizes.max() <= 1.001 * JERK_MPS3
    proved = min(c.proved for c in report.checks if (c.name, c.phase) == ("jerk", "mission") and c.proved is not None)
    assert -1e-3 * JERK_MPS3 <= proved <= JERK_MPS3 - sizes.max()


def test_the_jerk_is_the_derivative_of_the_acceleration(unpleasant: Plan) -> None:
    joints, step_s = unpleasant.joints_s, 1e-4
    t_s = 0.5 * (joints[1:] + joints[:-1])
    differences = unpleasant.accelerations(t_s + step_s) - unpleasant.accelerations(t_s - step_s)
    np.testing.assert_allclose(unpleasant.jerks(t_s), differences / (2.0 * step_s), atol=1e-5)


def test_a_scenario_without_the_key_is_written_and_planned_as_before(simulation1: Scenario) -> None:
    assert "jerk_max_mps3" not in simulation1.model_dump_json()
