"""What every attack starts from: a short plan of three vehicles, and the vehicles in the air of this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from gcs.plan.plan_file import save_plan
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.sources.load import load_scenario
from sim_bridge.personality import by_name
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tests.bridge.flying import hop_scenario
from tests.fleets import CLOCK, StillFleet, emulated, free_port, running_fleet, still_commands

SPEEDUP = 10.0
MakeVehicles = Callable[..., tuple[World, int]]
MakeStill = Callable[..., tuple[StillFleet, int]]


@pytest.fixture(scope="session")
def hop(repo_root: Path) -> Plan:
    """Three vehicles, 5 m apart, half a minute between take-off and landing."""
    return make_plan(hop_scenario(load_scenario(repo_root / "missions" / "field")))


@pytest.fixture(scope="session")
def hop_file(hop: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same plan as a file, verified."""
    path = tmp_path_factory.mktemp("hop") / "hop.skein"
    save_plan(hop, verify(hop), path)
    return path


@pytest.fixture
def vehicles(hop: Plan) -> Iterator[MakeVehicles]:
    """A function that starts the plan's vehicles and returns them with the port that they call.

    `autopilot` is "ardupilot" or "px4", `speedup` times real time; further options are those of `WorldOptions`.
    """
    with ExitStack() as stack:

        def start(autopilot: str | None = None, **options: Any) -> tuple[World, int]:
            port = options.pop("port", None) or free_port()
            personality = by_name(autopilot) if autopilot else None
            known = {"links": (call(port),), "speedup": SPEEDUP, "personality": personality, **options}
            return stack.enter_context(running_fleet(hop.scenario, WorldOptions(**known))), port

        yield start


@pytest.fixture
def still(hop: Plan) -> Iterator[MakeStill]:
    """A function that makes the plan's vehicles, and returns them with the port that they call.

    They and commands of this process have virtual time.
    """
    with still_commands(), ExitStack() as stack:

        def make(**options: Any) -> tuple[StillFleet, int]:
            port = free_port()
            return stack.enter_context(StillFleet(hop.scenario, links=[f"udpout:127.0.0.1:{port}"], **options)), port

        yield make


@pytest.fixture
def still_vehicles(hop: Plan) -> Iterator[MakeVehicles]:
    """As `vehicles`; they and commands of this process have virtual time."""
    with still_commands(), ExitStack() as stack:

        def start(autopilot: str | None = None, **options: Any) -> tuple[World, int]:
            port = free_port()
            known = WorldOptions(links=(call(port),), personality=by_name(autopilot) if autopilot else None, **options)
            return stack.enter_context(emulated(hop.scenario, known, CLOCK)), port

        yield start


def all_down(world: World) -> bool:
    """Whether every vehicle stands on the ground with its motors off."""
    return bool(world.airframes.landed.all()) and not any(vehicle.autopilot.armed for vehicle in world.vehicles)
