"""The fixtures that people get who test their own ground software, for our own tests of them; and a short plan."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from gcs.plan.plan_file import save_plan
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from sim_bridge.fleet import Fleet
from sim_bridge.testing import fleet
from tests.bridge.flying import hop_scenario
from tests.fleets import StillFleet, still_commands

__all__ = ["fleet"]


@pytest.fixture
def make_fleet() -> Iterator[Callable[..., Fleet]]:
    """A function that makes fleets, with the arguments of `Fleet`. They and commands that are run have virtual time."""
    with still_commands(), ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(StillFleet(*arguments, **options))


@pytest.fixture
def make_threaded_fleet() -> Iterator[Callable[..., Fleet]]:
    """The same, ten times as fast as real time, in threads of their own."""
    with ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(Fleet(*arguments, **{"speedup": 10.0, **options}))


@pytest.fixture(scope="session")
def field(repo_root: Path) -> Scenario:
    return load_scenario(repo_root / "missions" / "field")


@pytest.fixture(scope="session")
def hop(field: Scenario) -> Plan:
    """Three vehicles, half a minute, a plan."""
    return make_plan(hop_scenario(field))


@pytest.fixture(scope="session")
def hop_skein(hop: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`hop` as a file, verified."""
    path = tmp_path_factory.mktemp("hop") / "hop.skein"
    save_plan(hop, verify(hop), path)
    return path


@pytest.fixture(scope="session")
def short_mission(simulation1: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulation 1's vehicles and formation on a flight of half a minute."""
    data = simulation1.model_dump(mode="json")
    data["name"] = "short"
    data["time"]["flight_s"] = 30.0
    data["end"]["position_m"] = [62.0, 51.0, 3.0]
    data["objective"]["height_ref_m"] = 4.0
    path = tmp_path_factory.mktemp("short") / "scenario.json"
    path.write_text(json.dumps(data))
    return path


@pytest.fixture(scope="session")
def short_plan(short_mission: Path) -> Plan:
    return make_plan(load_scenario(short_mission))


@pytest.fixture(scope="session")
def short_skein(short_plan: Plan, short_mission: Path) -> Path:
    """The plan of `short_mission`, for commands that need not plan it again."""
    path = short_mission.with_name("short.skein")
    save_plan(short_plan, verify(short_plan), path)
    return path
