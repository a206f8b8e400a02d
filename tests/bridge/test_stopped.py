"""A flight that is stopped (Ctrl-C) at any of its steps leaves no vehicle airborne and none armed."""

from __future__ import annotations

import pytest

from gcs.flight.execution.fleet_landing import FleetLanding
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.progress import ALL_VEHICLES, Step
from gcs.plan.trajectory.plan import Plan
from sim_bridge.sim.world import World
from tests.bridge.flying import fly


def all_down(world: World) -> bool:
    return bool(world.airframes.landed.all()) and not any(vehicle.autopilot.armed for vehicle in world.vehicles)


@pytest.mark.parametrize(
    ("step", "later_s"),
    [
        (Step.READY, 0.0),
        (Step.UPLOAD, 0.2),
        pytest.param(Step.TAKEOFF, 0.0, marks=pytest.mark.slow),
        (Step.TAKEOFF, 0.02),  # some are armed, and no heartbeat has told it yet
        pytest.param(Step.TAKEOFF, 5.0, marks=pytest.mark.slow),
        (Step.FLY, 1.0),
        pytest.param(Step.LAND, 0.1, marks=pytest.mark.slow),  # a whole flight
    ],
)
def test_a_flight_may_be_stopped_at_any_time(hop: Plan, step: Step, later_s: float) -> None:
    slow = ["all:delay=0.5"] if step is Step.UPLOAD else []  # it takes no time without
    flown = fly(hop, *slow, stop=(step, later_s), until=all_down)
    assert flown.stopped
    told = [event.what for event in flown.events if event.sysid == ALL_VEHICLES]
    if step in (Step.FLY, Step.LAND):
        assert told[-1] == "ordered to land where they are"
        assert flown.flight.step is Step.LAND
    if step in (Step.READY, Step.UPLOAD):
        assert not flown.world.airframes.truth[:, 2].any()  # no vehicle has left the ground


def test_they_land_though_what_is_told_of_it_fails(hop: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(self: FlightSequence, reason: str) -> None:
        raise RuntimeError(reason)

    monkeypatch.setattr(FlightSequence, "_ends_early", fails)
    monkeypatch.setattr(FleetLanding, "send_once", lambda self: None)  # lost: the landing itself must follow
    flown = fly(hop, stop=(Step.FLY, 1.0))
    assert flown.stopped
    assert not any(vehicle.autopilot.armed for vehicle in flown.world.vehicles)
