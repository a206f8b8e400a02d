"""Ordered to return from behind a no-fly zone, its fence on board: no vehicle meets it, all land on their pads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.flight.contingency.choices import FlightMode
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.progress import AskedOrder
from gcs.plan.planner import make_plan
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from sim_bridge.sim.world import World
from tests.bridge.flying import fly, hop_scenario


def behind_a_zone(field: Scenario) -> Scenario:
    """The hop of two ArduCopters and a PX4, with a zone between its end and its pads."""
    data = json.loads(hop_scenario(field).model_dump_json())
    data["no_fly"] = [{"north_m": 30.0, "east_m": 0.0, "radius_m": 12.0}]
    data["end"]["position_m"] = [60.0, 0.0, 8.0]
    data["formation"]["vehicle"][1]["autopilot"] = "px4"
    return Scenario.model_validate(data)


@pytest.mark.slow
def test_all_are_called_home_from_behind_a_zone(repo_root: Path) -> None:
    plan = make_plan(behind_a_zone(load_scenario(repo_root / "missions" / "field")))
    called: list[bool] = []
    breaches: list[int] = []

    def call_home(world: World, flight: FlightSequence) -> Any:
        north_m = world.airframes.truth[:, 0]
        if not called and (north_m > 48.0).all() and flight.contingency is not None:
            called.append(True)
            flight.ask(AskedOrder.RETURN)
        breaches.append(sum(vehicle._failsafe.breaches for vehicle in world.vehicles))

    flown = fly(plan, during=call_home, safety=True, mode=FlightMode.STREAM)
    assert called
    assert breaches[-1] == 0
    assert all(vehicle._failsafe._beyond_shapes(30.0, 0.0) for vehicle in flown.world.vehicles)  # it is on board
    assert flown.world.airframes.landed.all()
    np.testing.assert_allclose(flown.world.airframes.truth[:, :2], plan.pads_ned_m[:, :2], atol=1.0)
    (zone,) = plan.scenario.no_fly
    outside = outside_m(zone, np.zeros(1), flown.places[..., 0], flown.places[..., 1])
    assert outside.min() > -0.5
    straight = np.linspace(flown.places[:, np.argmax(flown.places[0, :, 0]), :2], plan.pads_ned_m[:, :2], 200)
    assert outside_m(zone, np.zeros(1), straight[..., 0], straight[..., 1]).min() < -3.0
