"""Each emulated vehicle has the autopilot that its scenario names, unless one is given for all."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from sim_bridge.personality import PX4, Personality
from sim_bridge.sim.vehicle_factory import VehicleFactory

AUTOPILOTS = {"ardupilot": 3, "px4": 12}


@pytest.mark.parametrize(
    ("given", "names"),
    [(None, ["ardupilot", "px4", "ardupilot", "px4", "ardupilot", "ardupilot"]), (PX4, ["px4"] * 6)],
)
def test_vehicles_of_a_mixed_fleet(given: Personality | None, names: list[str], repo_root: Path) -> None:
    data = tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))
    for row in (1, 3):
        data["formation"]["vehicle"][row]["autopilot"] = "px4"
    factory = VehicleFactory(Scenario.model_validate(data), given, 1, 1.8e9)
    assert [_heartbeat(factory, row) for row in range(6)] == [AUTOPILOTS[name] for name in names]


@pytest.mark.parametrize(("given", "reaction"), [(None, "slow_down_room"), (PX4, "height_error_m")])
def test_vehicles_react_in_both_ways_by_the_seed(given: Personality | None, reaction: str, repo_root: Path) -> None:
    """Where an ArduCopter may make a slow-down, or a PX4 brake, some vehicles of a fleet do and others do not."""
    scenario = load_scenario(repo_root / "missions" / "field")
    fleets = []
    for seed in (1, 1, 2, 3):
        factory = VehicleFactory(scenario, given, seed, 1.8e9)
        vehicles = [factory.vehicle(row).autopilot for row in range(6)]
        fleets.append([getattr(each.path_generator.navigator, reaction) for each in vehicles])
    assert fleets[0] == fleets[1] != fleets[2]
    assert all(len(set(ends)) == 2 for ends in fleets)


def _heartbeat(factory: VehicleFactory, row: int) -> int:
    """MAV_AUTOPILOT of the vehicle's first HEARTBEAT."""
    vehicle = factory.vehicle(row, 0.0)
    for step in range(200):
        for message in vehicle.step(0.02 * step, 0.02 * step, True):
            if message.name == "HEARTBEAT":
                return int(message.fields["autopilot"])
    raise AssertionError("no heartbeat within 4 s")
