"""The fixtures that people get who test their own ground software, for our own tests of them; and a short plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.plan.planner import make_plan
from gcs.plan.trajectory import Plan
from gcs.scenario.load import load_scenario
from sim_bridge.testing import fleet, make_fleet
from tests.bridge.flying import hop_scenario

__all__ = ["fleet", "make_fleet"]


@pytest.fixture(scope="session")
def hop(repo_root: Path) -> Plan:
    """Three vehicles, half a minute, a plan."""
    return make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))
