"""What docs/flying.md promises for when things fail, on emulated vehicles: the others' flight, and how it ends for one.

Times in faults are seconds from take-off on; T0 is about 15 s after it.
"""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.choices import FlightMode, OnLoss
from gcs.plan.trajectory.plan import Plan
from tests.bridge.flying import Flown, fly


def flew_on(flown: Flown, sysid: int) -> None:
    """It was where the plan wants it from T0 to the arrival."""
    row = flown.plan.sysids.index(sysid)
    during = (flown.t_s > 0.0) & (flown.t_s < flown.plan.flight_s)
    error = np.linalg.norm(flown.places[row, during] - flown.planned[row, during], axis=-1)
    assert error.max() < 0.5


def came_home(flown: Flown, sysid: int) -> None:
    """It stands on the pad it started from."""
    row = flown.plan.sysids.index(sysid)
    assert np.linalg.norm(flown.places[row, -1] - flown.plan.pads_ned_m[row]) < 1.0


def kept_apart(flown: Flown) -> None:
    aloft = flown.t_s > -10.0
    places = flown.places[:, aloft]
    for a in range(2):
        for b in range(a + 1, 3):
            assert np.linalg.norm(places[a] - places[b], axis=-1).min() > flown.plan.scenario.judge.separation_min_m


@pytest.fixture(scope="module")
def two_fail(hop: Plan) -> Flown:
    """The battery of vehicle 3 is nearly empty, then vehicle 2 dies."""
    return fly(hop, "3:battery=0.05@21", "2:die@24", lost_after_s=5.0)


def test_a_vehicle_is_lost_the_others_land(two_fail: Flown) -> None:
    assert isinstance(two_fail.error, FlightError)
    assert "vehicle 2 was lost" in two_fail.error.message
    assert two_fail.happened(2) == ["link lost", "vehicle lost"]
    assert two_fail.orders(1) == ["land"]
    assert two_fail.at_s(1, "ordered to land") == pytest.approx(two_fail.at_s(2, "vehicle lost"), abs=0.1)
    assert two_fail.world.airframes.landed.all()


def test_a_critical_battery_lands_at_once(two_fail: Flown) -> None:
    assert two_fail.happened(3)[0] == "battery critical"
    assert set(two_fail.orders(3)) == {"land"}
    assert two_fail.at_s(3, "ordered to land") < two_fail.at_s(2, "link lost")
    down = two_fail.places[2, -1]
    assert 2.0 < down[0] < 50.0  # neither at home nor at the end


@pytest.mark.slow
def test_a_vehicle_is_lost_the_others_return_staggered(hop: Plan) -> None:
    flown = fly(hop, "2:die@24", on_loss=OnLoss.RETURN)
    assert flown.orders(1) == flown.orders(3) == ["return"]
    came_home(flown, 1)
    came_home(flown, 3)
    homewards = flown.t_s > flown.at_s(1, "ordered to return")
    tops = [-flown.places[row, homewards, 2].min() for row in (0, 2)]
    returns = flown.flight.contingency.charge.returns
    assert tops == pytest.approx([returns.altitudes_m[0], returns.altitudes_m[2]], abs=0.5)
    apart = np.linalg.norm(flown.places[0, homewards] - flown.places[2, homewards], axis=-1)
    assert apart.min() > flown.plan.scenario.judge.separation_min_m


@pytest.fixture(scope="module")
def flown_on(hop: Plan) -> Flown:
    """Vehicle 2 dies, vehicle 1 is without GNSS for a while, and vehicle 3 has just enough in its battery."""
    return fly(hop, "2:die@24", "1:gnss-outage@24..28", "3:battery=0.18@24", on_loss=OnLoss.CONTINUE)


@pytest.mark.long
def test_a_vehicle_is_lost_the_others_go_on(flown_on: Flown) -> None:
    assert isinstance(flown_on.error, FlightError)
    assert flown_on.happened(2) == ["link lost", "vehicle lost"]
    flew_on(flown_on, 1)
    flew_on(flown_on, 3)


@pytest.mark.slow
def test_a_short_outage_of_gnss(flown_on: Flown) -> None:
    assert flown_on.happened(1) == ["GNSS lost", "GNSS back"]
    assert flown_on.orders(1) == []


@pytest.mark.long
def test_a_low_battery_that_lasts_for_the_plan_changes_nothing(flown_on: Flown) -> None:
    """The choice is told with its numbers."""
    assert flown_on.orders(3) == []
    (told,) = (event for event in flown_on.events if event.sysid == 3)
    assert told.data is not None
    assert told.data["chosen"] == "finish"
    needs = [one["need_pct"] for one in told.data["alternatives"]]
    assert needs[0] + told.data["reserve_pct"] <= told.data["remaining_pct"] <= 18.0


@pytest.fixture(scope="module")
def link_back_soon(hop: Plan) -> Flown:
    """The link of vehicle 3 is away for a moment; vehicle 2 is without GNSS for long."""
    return fly(hop, "3:silent@24..27.5", "2:gnss-outage@19..54")


@pytest.mark.long
def test_a_link_that_comes_back_soon(link_back_soon: Flown) -> None:
    flown = link_back_soon
    assert flown.happened(3) == ["link lost", "link back"]
    assert flown.orders(3) == ["rejoin"]
    row, late = 2, (flown.t_s > 25.0) & (flown.t_s < 30.0)
    assert np.linalg.norm(flown.places[row, late] - flown.planned[row, late], axis=-1).max() < 0.5


@pytest.mark.long
def test_a_long_outage_of_gnss(link_back_soon: Flown) -> None:
    assert link_back_soon.orders(2)[-1] == "land"
    flew_on(link_back_soon, 1)
    assert link_back_soon.world.airframes.landed.all()


@pytest.mark.long
def test_a_link_that_comes_back_late(hop: Plan) -> None:
    flown = fly(hop, "3:silent@24..31")
    assert flown.orders(3) == ["return"]
    came_home(flown, 3)
    flew_on(flown, 1)
    flew_on(flown, 2)
    kept_apart(flown)


@pytest.mark.long
def test_a_low_battery_that_lasts_for_nothing_else_lands(hop: Plan) -> None:
    flown = fly(hop, "3:battery=0.112@20")
    assert flown.orders(3) == ["land"]
    flew_on(flown, 1)
    flew_on(flown, 2)
    kept_apart(flown)


@pytest.mark.long
def test_a_leader_is_lost_and_another_leads(hop: Plan) -> None:
    flown = fly(hop, "1:die@24", follow=True)
    assert flown.orders(2) == ["lead"]
    assert flown.orders(3) == []
    flew_on(flown, 2)
    flew_on(flown, 3)


@pytest.fixture(scope="module")
def on_board(hop: Plan) -> Flown:
    """Missions on board: the GNSS time of vehicle 2 jumps, then the battery of vehicle 3 is nearly empty."""
    return fly(hop, "2:clock-jump=20@32", "3:battery=0.05@34", mode=FlightMode.MISSION)


@pytest.mark.slow
def test_on_board_missions_are_watched_as_well(on_board: Flown) -> None:
    assert set(on_board.orders(3)) == {"land"}
    assert on_board.error is not None


@pytest.mark.long
def test_a_jump_of_gnss_time_after_the_start_is_told_and_the_missions_go_on(on_board: Flown) -> None:
    assert on_board.happened(2) == ["has a GNSS time that is off by +20.0 s: it flies by its boot clock"]
    assert on_board.orders(1) == on_board.orders(2) == []
    assert np.linalg.norm(on_board.places[1, -1] - on_board.plan.landing_points_ned_m[1]) < 1.5
