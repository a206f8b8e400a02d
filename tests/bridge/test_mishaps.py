"""What docs/flying.md promises for when things fail, on emulated vehicles: the others' flight, and how it ends for one.

Times in faults are seconds from take-off on; T0 is about 20 s after it.
"""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.policy import OnLoss
from gcs.flight.options import FlightMode
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


@pytest.mark.slow
def test_nothing_happens_where_nothing_is_wrong(hop: Plan) -> None:
    flown = fly(hop)
    assert flown.error is None
    assert flown.events == []
    for sysid in (1, 2, 3):
        flew_on(flown, sysid)


def test_a_vehicle_is_lost_the_others_land(hop: Plan) -> None:
    flown = fly(hop, "2:die@30")
    assert isinstance(flown.error, FlightError)
    assert "vehicle 2 was lost" in flown.error.message
    assert flown.happened(2) == ["link lost", "vehicle lost"]
    assert flown.orders(1) == flown.orders(3) == ["land"]
    assert flown.world.airframes.landed.all()


@pytest.mark.slow
def test_a_vehicle_is_lost_the_others_return_staggered(hop: Plan) -> None:
    flown = fly(hop, "2:die@30", on_loss=OnLoss.RETURN)
    assert flown.orders(1) == flown.orders(3) == ["return"]
    came_home(flown, 1)
    came_home(flown, 3)
    homewards = flown.t_s > flown.at_s(1, "ordered to return")
    tops = [-flown.places[row, homewards, 2].min() for row in (0, 2)]
    returns = flown.flight.contingency.returns
    assert tops == pytest.approx([returns.altitudes_m[0], returns.altitudes_m[2]], abs=0.5)
    apart = np.linalg.norm(flown.places[0, homewards] - flown.places[2, homewards], axis=-1)
    assert apart.min() > flown.plan.scenario.judge.separation_min_m


@pytest.mark.slow
def test_a_vehicle_is_lost_the_others_go_on(hop: Plan) -> None:
    flown = fly(hop, "2:die@30", on_loss=OnLoss.CONTINUE)
    assert isinstance(flown.error, FlightError)
    flew_on(flown, 1)
    flew_on(flown, 3)


@pytest.mark.slow
def test_a_link_that_comes_back_soon(hop: Plan) -> None:
    flown = fly(hop, "3:silent@30..33.5")
    assert flown.error is None
    assert flown.happened(3) == ["link lost", "link back"]
    assert flown.orders(3) == ["rejoin"]
    row, late = 2, (flown.t_s > 25.0) & (flown.t_s < 30.0)
    assert np.linalg.norm(flown.places[row, late] - flown.planned[row, late], axis=-1).max() < 0.5


@pytest.mark.slow
def test_a_link_that_comes_back_late(hop: Plan) -> None:
    flown = fly(hop, "3:silent@30..37")
    assert flown.orders(3) == ["return"]
    came_home(flown, 3)
    flew_on(flown, 1)
    flew_on(flown, 2)
    kept_apart(flown)


@pytest.mark.slow
def test_a_short_outage_of_gnss(hop: Plan) -> None:
    flown = fly(hop, "2:gnss-outage@30..34")
    assert flown.error is None
    assert flown.happened(2) == ["GNSS lost", "GNSS back"]
    assert flown.orders(2) == []


@pytest.mark.slow
def test_a_long_outage_of_gnss(hop: Plan) -> None:
    flown = fly(hop, "2:gnss-outage@25..60")
    assert flown.orders(2)[-1] == "land"
    flew_on(flown, 1)
    assert flown.world.airframes.landed.all()


@pytest.mark.slow
def test_a_low_battery_that_lasts_for_the_plan_changes_nothing(hop: Plan) -> None:
    """The choice is told with its numbers."""
    flown = fly(hop, "3:battery=0.18@30")
    assert flown.error is None
    assert flown.orders(3) == []
    (told,) = flown.events
    assert told.data is not None
    assert told.data["chosen"] == "finish"
    needs = [one["need_pct"] for one in told.data["alternatives"]]
    assert needs[0] + told.data["reserve_pct"] <= told.data["remaining_pct"] <= 18.0
    for sysid in (1, 2, 3):
        flew_on(flown, sysid)


@pytest.mark.slow
def test_a_low_battery_that_lasts_for_nothing_else_lands(hop: Plan) -> None:
    flown = fly(hop, "3:battery=0.112@26")
    assert flown.orders(3) == ["land"]
    flew_on(flown, 1)
    flew_on(flown, 2)
    kept_apart(flown)


def test_a_critical_battery_lands_at_once(hop: Plan) -> None:
    flown = fly(hop, "3:battery=0.05@26")
    assert flown.orders(3)[-1] == "land"
    down = flown.places[2, -1]
    assert 5.0 < down[0] < 50.0  # neither at home nor at the end
    flew_on(flown, 1)


@pytest.mark.slow
def test_a_leader_is_lost_and_another_leads(hop: Plan) -> None:
    flown = fly(hop, "1:die@30", follow=True)
    assert flown.orders(2) == ["lead"]
    assert flown.orders(3) == []
    flew_on(flown, 2)
    flew_on(flown, 3)


@pytest.mark.slow
def test_on_board_missions_are_watched_as_well(hop: Plan) -> None:
    flown = fly(hop, "3:battery=0.05@38", mode=FlightMode.MISSION)
    assert flown.orders(3) == ["land"]
    assert flown.error is not None
