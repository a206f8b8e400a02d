"""A small flight, planned and judged once: three vehicles over a meadow."""

from __future__ import annotations

import pytest

from gcs.plan.planner import make_plan
from gcs.plan.trajectory import Plan
from gcs.plan.verify import Report, verify
from gcs.scenario.model import Scenario
from tests.unit.plan.problems import meadow


@pytest.fixture(scope="session")
def meadow_plan(simulation1: Scenario) -> Plan:
    three = [v.model_dump() for v in simulation1.formation.vehicle[:3]]
    return make_plan(meadow(simulation1, formation={"vehicle": three}))


@pytest.fixture(scope="session")
def meadow_report(meadow_plan: Plan) -> Report:
    return verify(meadow_plan)
