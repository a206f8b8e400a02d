"""What tests of flights start from: a hop of three vehicles, and their ways back."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from tests.bridge.flying import hop_scenario


@pytest.fixture(scope="session")
def hop(repo_root: Path) -> Plan:
    """Three vehicles, 5 m apart, 60 m to the north and 20 m to the east at 8 m, within 30 s."""
    return make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))


@pytest.fixture(scope="session")
def hop_returns(hop: Plan) -> ReturnPlan:
    return plan_returns(hop, (Autopilot.ARDUPILOT,) * len(hop.sysids))
