"""What tests of every kind start from: the repository, and Simulation 1 as a scenario and as a plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.plan.trajectory import Plan
from gcs.scenario.load import load_scenario
from gcs.scenario.model import Scenario


@pytest.fixture(scope="session")
def repo_root() -> Path:
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def simulation1(repo_root: Path) -> Scenario:
    return load_scenario(repo_root / "missions" / "simulation1")


@pytest.fixture(scope="session")
def simulation1_plan(simulation1: Scenario) -> Plan:
    from gcs.plan.planner import make_plan

    return make_plan(simulation1)
