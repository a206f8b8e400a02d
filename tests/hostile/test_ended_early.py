"""A flight whose vehicles came down before the plan's end has failed, although all have landed."""

from __future__ import annotations

import pytest

from gcs.errors import FlightError
from gcs.flight.execution.flight import FlightSequence
from gcs.mavlink import MavCommand
from gcs.plan.trajectory.plan import Plan
from sim_bridge.sim.world import World
from tests.bridge.flying import fly, say

FORCED = 21196.0


@pytest.mark.slow
def test_a_vehicle_that_is_disarmed_in_the_air_by_another_station(hop: Plan) -> None:
    done: list[bool] = []

    def disarm(world: World, flight: FlightSequence) -> None:
        if not done and world.airframes.truth[1, 0] > 0.0:
            done.append(True)
            off = {"param1": 0.0, "param2": FORCED} | {f"param{n}": 0.0 for n in range(3, 8)}
            say(world, 2, "COMMAND_LONG", command=int(MavCommand.COMPONENT_ARM_DISARM), confirmation=0, **off)

    flown = fly(hop, during=disarm)
    assert isinstance(flown.error, FlightError)
    assert flown.error.exit_code == 9
    assert "vehicle 2 left the formation: disarmed in the air" in flown.error.message
    assert flown.happened(2)[0] == "disarmed in the air"


@pytest.mark.long
def test_a_common_time_that_is_wrong_does_not_end_a_flight_as_if_it_were_flown(hop: Plan) -> None:
    """Should the common time jump by 20 s in spite of all, the vehicles' boot clocks say how long they flew."""
    jumped: list[bool] = []

    def jump(world: World, flight: FlightSequence) -> None:
        t_s = flight.monitor.plan_time_s
        if not jumped and t_s is not None and t_s > 5.0:
            jumped.append(True)
            right = flight.time.sure_s
            flight.time.sure_s = lambda: right() + 20.0  # type: ignore[method-assign]

    flown = fly(hop, during=jump)
    assert isinstance(flown.error, FlightError)
    assert "until the landing, by its own clock" in flown.error.message
    assert flown.world.airframes.landed.all()
