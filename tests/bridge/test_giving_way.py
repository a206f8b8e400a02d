"""What docs/flying.md promises for fences, pilots and vehicles that come too near each other, on emulated vehicles.

Times in faults are seconds from take-off on; T0 is about 15 s after it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.errors import FlightError
from gcs.flight.execution.flight import FlightSequence
from gcs.mavlink import CopterMode
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.navigation_error import vehicle_size_m
from sim_bridge.sim.world import World
from tests.bridge.flying import Flown, fly, hop_scenario, say, take_over
from tests.bridge.test_mishaps import came_home, flew_on

LIMIT_M = 3.6
NOTHING, INT8 = 0.0, 2


def leader_and(field: Scenario, place: list[float]) -> Plan:
    """A leader, and a vehicle at this place from it: north, east, up."""
    data = hop_scenario(field).model_dump(mode="json")
    data["limits"]["north_m"] = [-40.0, 720.0]
    places = ([0.0, 0.0, 8.0], place)
    data["formation"]["vehicle"] = [{"sysid": n, "position_m": place} for n, place in enumerate(places, start=1)]
    data["judge"]["separation_min_m"] = LIMIT_M
    return make_plan(Scenario.model_validate(data))


def modes_at(sysid: int, *story: tuple[float, int]) -> Callable[[World, FlightSequence], None]:
    """Return a pilot that puts a vehicle into these modes at these plan times."""
    left = list(story)

    def look(world: World, flight: FlightSequence) -> None:
        t_s = flight.monitor.plan_time_s
        if left and t_s is not None and t_s >= left[0][0]:
            take_over(world, sysid, left.pop(0)[1])

    return look


def stopped_leader(plan: Plan) -> Flown:
    """The leader's pilot stops it in the air, and lands it later."""
    flown = fly(plan, during=modes_at(1, (12.0, CopterMode.LOITER), (24.0, CopterMode.LAND)))
    assert isinstance(flown.error, FlightError)
    assert flown.orders(1) == ["released"]
    assert "pilot took over" in flown.happened(1)
    assert flown.world.airframes.landed.all()
    return flown


def least_distance_m(flown: Flown) -> float:
    aloft = (flown.t_s > 0.0) & (flown.places[:, :, 2] < -1.0).all(axis=0)
    return float(np.linalg.norm(flown.places[0, aloft] - flown.places[1, aloft], axis=-1).min())


@pytest.mark.long
def test_a_vehicle_without_time_to_brake_climbs(field: Scenario) -> None:
    flown = stopped_leader(leader_and(field, [-4.33, -2.5, 8.6]))
    # Where it comes to rest decides: 2 m higher it may still be too near, and lands; or far enough, and returns; and
    # on its way back it may still meet the leader, which drifts, and land.
    first, *then = flown.orders(2)
    assert first == "climb"
    assert then in (["land"], ["return"], ["return", "land"])
    spread_s, over_s = flown.at_s(2, "ordered to climb"), flown.at_s(2, f"ordered to {then[0]}")
    climbing = (flown.t_s > spread_s) & (flown.t_s < over_s)
    heights = -flown.places[1, climbing, 2]
    assert heights.max() - heights[0] == pytest.approx(2.0, abs=0.4)
    assert least_distance_m(flown) > vehicle_size_m(flown.plan.scenario.vehicle)


@pytest.mark.long
def test_a_vehicle_with_time_to_brake_holds_and_returns(field: Scenario) -> None:
    flown = stopped_leader(leader_and(field, [-25.6, -8.5, 8.0]))
    assert flown.orders(2) == ["hold", "return"]
    held_s, back_s = flown.at_s(2, "ordered to hold"), flown.at_s(2, "ordered to return")
    assert back_s - held_s > 5.0
    held = (flown.t_s > held_s + 4.0) & (flown.t_s < back_s)
    assert np.ptp(flown.places[1, held, :2], axis=0).max() < 1.0  # it stands
    came_home(flown, 2)
    assert least_distance_m(flown) > LIMIT_M


@pytest.mark.slow
def test_a_vehicle_blown_over_the_fence_returns(hop: Plan) -> None:
    """Twice: vehicle 3 only reports it, as configured, and is ordered to return; vehicle 2 turns back by itself."""

    def only_tell(world: World, flight: FlightSequence) -> None:
        if not said:
            said.append(True)
            say(world, 3, "PARAM_SET", param_id="FENCE_ACTION", param_value=NOTHING, param_type=INT8)

    said: list[bool] = []
    flown = fly(hop, "3:push=-2,7@23..25.5", "2:push=2,-7@23..25.5", safety=True, during=only_tell)
    assert isinstance(flown.error, FlightError)
    assert flown.happened(3) == ["fence breached"]
    assert any("fence breached" in text.lower() for text in flown.said(3))
    assert flown.orders(3) == ["return"]
    assert {"failsafe took over", "fence breached"} >= set(flown.happened(2)) != set()
    assert set(flown.orders(2)) == {"return"}
    came_home(flown, 2)
    came_home(flown, 3)
    flew_on(flown, 1)


@pytest.mark.long
def test_all_fall_silent_and_land(hop: Plan) -> None:
    """They receive, and are not heard; whatever their failsafes are, they land as ordered."""
    flown = fly(
        hop,
        "all:down.silent@23..70",
        lost_after_s=1.5,
        until=lambda world: bool(world.airframes.landed.all()),
    )
    assert isinstance(flown.error, FlightError)
    assert "vehicles 1, 2, 3 were lost" in flown.error.message
    assert {vehicle.autopilot.mode.number for vehicle in flown.world.vehicles} == {CopterMode.LAND}
    assert (flown.places[:, -1, 0] > 5.0).all()
    assert (flown.places[:, -1, 0] < 55.0).all()  # where they were
