"""Starts that fail on emulated vehicles: nobody stays armed, no motor goes on turning, and it is said why."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import FlightError, PeerRefusal
from gcs.plan.trajectory.plan import Plan
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.sim.world import World
from tests.bridge.flying import fly
from tests.bridge.test_mishaps import came_home


def on_s(world: World) -> np.ndarray:
    """How long each vehicle was armed, and how long it flew (2, V)."""
    assert world.truth is not None
    flags = np.array(world.truth._flags)  # (N, V, 3)
    return np.asarray(flags[:, :, :2].sum(axis=0).T * CONTROL_PERIOD_S)


def test_one_refuses_to_be_armed_and_the_others_stand_still_within_two_seconds(hop: Plan) -> None:
    flown = fly(hop, "2:refuse-arming")
    assert isinstance(flown.error, PeerRefusal)
    assert flown.error.message == (
        "no vehicle took off: vehicle 2 refused MAV_CMD_COMPONENT_ARM_DISARM: execution failed "
        "(MAV_RESULT_FAILED); it reports: Arm: Accels inconsistent; vehicles 1, 3 disarmed again."
    )
    turned_s, flew_s = on_s(flown.world)
    assert flew_s.max() == 0.0
    assert turned_s[1] == 0.0
    assert 0.0 < turned_s[[0, 2]].min() <= turned_s.max() < 2.0
    assert [vehicle.autopilot.mode.name for vehicle in flown.world.vehicles] == ["GUIDED"] * 3  # no order to land


@pytest.mark.parametrize(
    ("fault", "said", "runs_s"),
    [
        ("2:motor=1@start:0", "does not climb: 0.0 m in 8 s (required 1.0 m)", 10.0),
        ("2:motor=1@2", "fell from", 8.0),
    ],
    ids=["on the pad", "in the climb"],
)
def test_a_motor_that_is_dead_at_the_take_off(hop: Plan, fault: str, said: str, runs_s: float) -> None:
    """It stops its motors on the ground, though it takes itself for flying; the others land."""
    flown = fly(hop, fault)
    assert isinstance(flown.error, FlightError)
    assert f"the start was aborted: vehicle 2 {said}" in flown.error.message
    (event,) = flown.events
    assert (event.sysid, event.what) == (2, "ordered to disarm")
    assert said in event.rule
    armed_s, flew_s = on_s(flown.world)
    assert 0.0 < flew_s[1] < armed_s[1] < runs_s
    assert not any(vehicle.autopilot.armed for vehicle in flown.world.vehicles)
    assert flown.world.airframes.landed.all()
    for sysid in (1, 3):
        came_home(flown, sysid)
