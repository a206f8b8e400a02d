"""What tests of every kind start from: the repository, and Simulation 1 as a scenario and as a plan."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from tests.kept import PATCHES, kept, make_room
from tests.progress import AreaProgress
from tests.sharing.kept_functions import KEPT

# What tests share is made once, on disk: set before any other module imports these functions by name.
for module, (name, *makers) in KEPT.items():
    place = import_module(module)
    setattr(place, name, kept(getattr(place, name), *makers))

# The same examples in each run: a change is blamed for its own mistakes only. SKEIN_NEW_EXAMPLES=1 draws others.
settings.register_profile("suite", max_examples=40, deadline=None, derandomize="SKEIN_NEW_EXAMPLES" not in os.environ)
settings.load_profile("suite")
LONG = (
    "test_course_frame_cost.py",
    "test_readme.py",
    "test_fly.py",
    "test_every_await.py",
    "test_recorded_flight.py",
    "test_mixed_fleet.py",
    "test_real_flights.py",
)


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Progress by area, where people read it: the process that prints, not its workers.

    A background job has SIGINT ignored, and `nohup` SIGHUP; programs under test inherit it. Tests are the same there.
    """
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
    make_room()
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None and config.get_verbosity() <= 0:
        config.pluginmanager.register(AreaProgress(reporter), "area-progress")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest begin, so that no worker is left alone with one at the end.

    What is loaded by now stays: looked at for garbage again and again, it took 7 % of the suite's time.
    """
    items.sort(key=lambda item: item.path.name not in LONG)
    gc.freeze()
    gc.set_threshold(5_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_itemcollected(item: pytest.Item) -> None:
    """A further case of a slow test is a long one: of two marks the later tier counts."""
    if item.get_closest_marker("long"):
        item.own_markers[:] = [mark for mark in item.own_markers if mark.name != "slow"]


@pytest.fixture(autouse=True)
def _nothing_kept_while_code_is_patched(request: pytest.FixtureRequest) -> Iterator[None]:
    if "monkeypatch" in request.fixturenames:
        PATCHES.append(request.getfixturevalue("monkeypatch"))
    yield
    PATCHES.clear()


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


@pytest.fixture(scope="session")
def hop(repo_root: Path) -> Plan:
    """Three vehicles, 5 m apart, 60 m to the north and 20 m to the east at 8 m, within 30 s."""
    from gcs.plan.planner import make_plan
    from tests.bridge.flying import hop_scenario

    return make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))


@pytest.fixture(scope="session")
def plan_of(repo_root: Path, simulation1_plan: Plan) -> Callable[[str], Plan]:
    """The plan of a bundled scenario, by its path under missions/; each is made once."""
    from gcs.plan.planner import make_plan

    made = {"simulation1/scenario.toml": simulation1_plan}

    def plan(name: str) -> Plan:
        if name not in made:
            made[name] = make_plan(load_scenario(repo_root / "missions" / name))
        return made[name]

    return plan
