"""Starts that fail on emulated vehicles: nobody stays armed, no motor goes on turning, and it is said why."""

from __future__ import annotations

import numpy as np

from gcs.errors import PeerRefusal
from gcs.plan.trajectory.plan import Plan
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.sim.world import World
from tests.bridge.flying import fly


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
