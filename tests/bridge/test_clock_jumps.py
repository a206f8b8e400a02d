"""Missions on board wait by GNSS time: what becomes of them when that time jumps."""

from __future__ import annotations

import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.execution.flight import FlightSequence
from gcs.plan.trajectory.plan import Plan
from sim_bridge.sim.world import World
from tests.bridge.flying import fly


@pytest.mark.slow
def test_a_jump_before_the_common_start_lands_all_and_names_the_vehicle(hop: Plan) -> None:
    flown = fly(hop, "2:clock-jump=20@6", mode=FlightMode.MISSION)
    assert isinstance(flown.error, FlightError)
    assert "that of vehicle 2 is off by +20.0 s" in str(flown.error)
    assert flown.world.airframes.landed.all()


def test_a_vehicle_whose_time_differs_from_the_start_is_not_armed(hop: Plan) -> None:
    armed: list[int] = []

    def look(world: World, _: FlightSequence) -> None:
        armed.extend(sysid for sysid, one in zip(world.sysids, world.vehicles, strict=True) if one.autopilot.armed)

    flown = fly(hop, "3:clock-jump=-20", during=look, mode=FlightMode.MISSION)
    assert isinstance(flown.error, FlightError)
    assert "that of vehicle 3 is off by -" in str(flown.error)
    assert armed == []
