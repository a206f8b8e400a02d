"""Small flights, planned and judged once: three vehicles over a meadow, and formations that change."""

from __future__ import annotations

import pytest

from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report, verify
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import FLIGHTS, Planned
from tests.unit.plan.problems import meadow


@pytest.fixture(scope="session")
def meadow_plan(simulation1: Scenario) -> Plan:
    three = [v.model_dump() for v in simulation1.formation.vehicle[:3]]
    return make_plan(meadow(simulation1, formation={"vehicle": three}))


@pytest.fixture(scope="session")
def meadow_report(meadow_plan: Plan) -> Report:
    return verify(meadow_plan)


@pytest.fixture(scope="session")
def planned(simulation1: Scenario) -> Planned:
    """Plan and verdict of one of FLIGHTS, by its name; each is made once."""
    made: dict[str, tuple[Plan, Report]] = {}

    def plan_of(name: str) -> tuple[Plan, Report]:
        if name not in made:
            plan = make_plan(FLIGHTS[name](simulation1))
            made[name] = plan, verify(plan)
        return made[name]

    return plan_of
