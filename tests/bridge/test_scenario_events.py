"""Events of a scenario in flight: their orders are given by themselves, and where none is planned, the other one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.flight.execution.flight import FlightSequence
from gcs.flight.execution.plan_orders import NEW_PLAN
from gcs.flight.monitoring.progress import AskedOrder
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import EventTable
from sim_bridge.sim.world import World
from tests.bridge.flying import Flown, fly

pytestmark = pytest.mark.slow


def flown_with(hop: Plan, row: EventTable, *faults: str) -> Flown:
    return fly(replace(hop, scenario=hop.scenario.model_copy(update={"on": (row,)})), *faults)


def test_the_shape_grows_at_its_time(hop: Plan) -> None:
    flown = flown_with(hop, EventTable(at_s=5.0, order="scale", factor=1.4))
    assert flown.error is None, flown.error
    (change,) = [event for event in flown.events if event.what.startswith(NEW_PLAN)]
    assert "[[on]] row 1: it is t = 5 s" in change.rule
    assert 5.0 < change.data["begins_t_s"] < 8.0
    late = (flown.t_s > 27.0) & (flown.t_s < 29.0)
    spread_m = np.linalg.norm(flown.places[0, late] - flown.places[1, late], axis=-1)
    np.testing.assert_allclose(spread_m, 1.4 * 5.0, atol=0.3)


def test_a_low_battery_brings_the_whole_formation_home(hop: Plan) -> None:
    row = EventTable(battery_below_percent=60.0, order="home", otherwise="return")
    flown = flown_with(hop, row, "2:battery=0.55@25")
    assert flown.error is None, flown.error
    (change,) = [event for event in flown.events if event.what.startswith(NEW_PLAN)]
    assert "fly home together, asked by [[on]] row 1: vehicle 2 has 5" in change.rule
    np.testing.assert_allclose(flown.places[:, -1, :2], hop.pads_ned_m[:, :2], atol=0.5)


def test_where_no_plan_is_found_the_other_order_is_given(hop: Plan) -> None:
    row = EventTable(at_s=5.0, order="scale", factor=9.0, otherwise="land")
    flown = flown_with(hop, row)
    assert any(event.what == "keep their plan" for event in flown.events)
    assert {flown.orders(sysid)[0] for sysid in (1, 2, 3)} == {"land"}


def test_a_vehicle_that_returns_already_is_left_at_that(hop: Plan) -> None:
    done = []

    def send_home(_: World, flight: FlightSequence) -> None:
        if not done and (flight.monitor.plan_time_s or -1.0) > 3.0:
            done.append(flight.ask(AskedOrder.RETURN, (2,), by="the test"))

    row = EventTable(at_s=8.0, order="home", otherwise="land")
    plan = replace(hop, scenario=hop.scenario.model_copy(update={"on": (row,)}))
    flown = fly(plan, during=send_home)
    assert flown.orders(2) == ["return"]
    assert flown.orders(1) == flown.orders(3) == ["land"]
