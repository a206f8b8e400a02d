"""Missions of Simulation 1, made once, and small flights whose motion is written down."""

from __future__ import annotations

import pytest

from gcs.mission.model import VehicleMission
from gcs.mission.waypoints.mission_items import build_missions, timed_legs
from gcs.mission.waypoints.timed_legs import TimedLegs
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from tests.unit.mission.waypoints.small_flights import there_and_on


@pytest.fixture(scope="session")
def legs(simulation1_plan: Plan) -> TimedLegs:
    return timed_legs(simulation1_plan)


@pytest.fixture(scope="session")
def missions(simulation1_plan: Plan, legs: TimedLegs) -> tuple[VehicleMission, ...]:
    return build_missions(simulation1_plan, legs)


@pytest.fixture(scope="session")
def small(simulation1: Scenario) -> Plan:
    return there_and_on(simulation1)
