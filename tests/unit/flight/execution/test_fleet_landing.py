"""The landing of a flight in virtual time: late answers, refusals, and what counts as landed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError, OrderError
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.policy import State
from gcs.flight.execution.fleet_landing import HANDED_OVER, FleetLanding
from gcs.flight.execution.order_carrier import FlyingFleet
from gcs.flight.execution.streamer import Streamer
from gcs.flight.execution.takeoff_landing import FlightVehicle
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.monitor import Monitor
from gcs.link.wire.message import Message
from gcs.mavlink import MavResult
from gcs.mission.export.setpoint_stream import build_stream
from gcs.plan.trajectory.plan import Plan
from tests.unit.flight.execution.test_takeoff_landing import Vehicle, live

PX4 = Autopilot.PX4.traits.flight
ON_THE_GROUND = 1  # MAV_LANDED_STATE
DOWN_S = 18.2  # from the order to land to the disarming


def land(
    vehicle: Vehicle,
    plan: Plan,
    act: Callable[[FleetLanding, FlightVehicle], Awaitable[object]],
    *,
    state: State = State.FLYING,
    taken: bool = True,
    rules: list[str] | None = None,
) -> tuple[float, list[str]]:
    """Have the ground station land it; returns how long it took, and what the person was told."""
    told: list[str] = []

    def tell(sysid: int, what: str, rule: str) -> None:
        told.append(what)
        if rules is not None:
            rules.append(rule)

    async def fly(crew: FlightVehicle) -> None:
        fleet, options = {crew.sysid: crew}, FlightOptions()
        time = FleetTime({crew.sysid: crew.session})
        streamer = Streamer(plan, build_stream(plan, 25.0), fleet, time, options)
        landing = FleetLanding(
            FlyingFleet(fleet, Monitor(plan), streamer, time, options),
            lambda: {crew.sysid: state},
            lambda order: told.append(f"did not {order.what}"),
            tell,
        )
        if taken:
            landing.custody.take_up()
        try:
            await act(landing, crew)
        finally:
            await landing.orders.close()

    return live(vehicle, plan, fly), told


def comes_down(after_s: float) -> Callable[[Vehicle, dict[str, Any]], None]:
    """Lands after each order: shows the mode `after_s` late, and disarms in the end."""

    def obey(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(after_s, lambda: setattr(vehicle, "mode", PX4.land))
        loop.call_later(DOWN_S, lambda: setattr(vehicle, "armed", False))

    return obey


async def as_planned(landing: FleetLanding, crew: FlightVehicle) -> None:
    landing.order(crew, planned=True)
    await landing.until_landed()
    landing.raise_failed_orders()


async def in_a_crisis(landing: FleetLanding, crew: FlightVehicle) -> None:
    await landing.land_all()
    landing.raise_failed_orders()


def test_a_late_answer_does_not_break_a_planned_landing(simulation1_plan: Plan) -> None:
    """The mode is shown 7 s late, the acknowledgement too: the order is told as late, and was carried out."""
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True, obey=comes_down(7.0), ack_s=7.0)
    took_s, told = land(vehicle, simulation1_plan, as_planned)
    assert DOWN_S < took_s < DOWN_S + 12.0
    assert told == ["did not land"]


@pytest.mark.parametrize("after_s", [4.0, 4.8])
def test_a_mode_that_is_shown_in_time_needs_no_repetition(simulation1_plan: Plan, after_s: float) -> None:
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True, obey=comes_down(after_s), ack_s=7.0)
    assert land(vehicle, simulation1_plan, as_planned)[1] == []


def test_a_late_answer_to_an_order_in_a_crisis_is_told_in_the_end(simulation1_plan: Plan) -> None:
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True, obey=comes_down(7.0), ack_s=7.0)
    with pytest.raises(OrderError, match="a repetition was carried out"):
        land(vehicle, simulation1_plan, in_a_crisis)


def test_a_planned_landing_that_is_refused_for_good_is_an_order_that_failed(simulation1_plan: Plan) -> None:
    """It is repeated until the vehicle is silent, and the flight says that it is not known whether it landed."""
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True, result=MavResult.TEMPORARILY_REJECTED)

    async def until_silent(landing: FleetLanding, crew: FlightVehicle) -> None:
        asyncio.get_running_loop().call_later(60.0, lambda: setattr(vehicle, "session", None))
        await as_planned(landing, crew)

    with pytest.raises(OrderError, match=r"ordered 7 times.*it is not known whether landed"):
        land(vehicle, simulation1_plan, until_silent)


def test_a_vehicle_that_lands_without_any_answer_has_carried_out_the_planned_order(simulation1_plan: Plan) -> None:
    """It hears all and lands; neither acknowledgements nor the mode arrive."""
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True, obey=comes_down(1e9), ack_s=1e9)
    took_s, told = land(vehicle, simulation1_plan, as_planned)
    assert DOWN_S < took_s < DOWN_S + 2.0
    assert set(told) == {"did not land"}


@pytest.mark.parametrize("crisis", [False, True])
def test_one_wrong_heartbeat_ends_no_flight(simulation1_plan: Plan, crisis: bool) -> None:
    """For one HEARTBEAT the vehicle says that it is disarmed, in the air."""
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True, obey=comes_down(1.0))

    async def lied_to(landing: FleetLanding, crew: FlightVehicle) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(6.2, lambda: setattr(vehicle, "armed", False))
        loop.call_later(7.1, lambda: setattr(vehicle, "armed", True))
        await (in_a_crisis if crisis else as_planned)(landing, crew)
        assert not vehicle.armed

    assert land(vehicle, simulation1_plan, lied_to)[0] > DOWN_S


def test_landed_is_who_has_disarmed(simulation1_plan: Plan) -> None:
    """PX4 tells its LAND item as reached 16 s before the ground, both tell that they stand before they disarm."""
    vehicle = Vehicle(PX4, armed=True)

    async def come_down(landing: FleetLanding, crew: FlightVehicle) -> None:
        vehicle.say(Message("MISSION_ITEM_REACHED", {"seq": 7}, 1, 1), 1.0)
        vehicle.say(Message("EXTENDED_SYS_STATE", {"vtol_state": 0, "landed_state": ON_THE_GROUND}, 1, 1), 16.0)
        asyncio.get_running_loop().call_later(DOWN_S, lambda: setattr(vehicle, "armed", False))
        await landing.until_landed()

    assert DOWN_S < land(vehicle, simulation1_plan, come_down)[0] < DOWN_S + 2.0


def test_a_pilots_vehicle_gets_no_order_and_is_watched_until_it_has_landed(simulation1_plan: Plan) -> None:
    vehicle = Vehicle(PX4, mode=PX4.hold, armed=True)

    async def come_down(landing: FleetLanding, crew: FlightVehicle) -> None:
        asyncio.get_running_loop().call_later(DOWN_S, lambda: setattr(vehicle, "armed", False))
        landing.send_once()
        assert landing.of_pilots() == [crew.sysid]
        await landing.land_all()
        assert landing.of_pilots() == []

    took_s, told = land(vehicle, simulation1_plan, come_down, state=State.LEFT)
    assert DOWN_S < took_s < DOWN_S + 2.0
    assert told == ["still in the air"]
    assert vehicle.heard == []


def test_a_vehicle_that_others_armed_gets_no_order_and_is_not_waited_for(simulation1_plan: Plan) -> None:
    vehicle = Vehicle(PX4, mode=PX4.hold, armed=True)

    async def end(landing: FleetLanding, crew: FlightVehicle) -> None:
        with pytest.raises(FlightError, match=r"vehicle 1 armed, and not by this flight"):
            landing.custody.take_to_arm(crew.sysid)
        landing.send_once()
        await landing.land_all()
        landing.report_airborne()
        landing.hand_over()

    took_s, told = land(vehicle, simulation1_plan, end, taken=False)
    assert took_s < 0.1
    assert told == []
    assert vehicle.heard == []


def test_a_vehicle_whose_arming_is_not_confirmed_yet_is_landed(simulation1_plan: Plan) -> None:
    """It is armed 0.4 s after the order to arm was sent; the flight ends before."""
    vehicle = Vehicle(PX4, mode=PX4.hold, obey=comes_down(0.5))

    async def end(landing: FleetLanding, crew: FlightVehicle) -> None:
        landing.custody.take_to_arm(crew.sysid)
        asyncio.get_running_loop().call_later(0.4, lambda: setattr(vehicle, "armed", True))
        landing.send_once()
        await landing.land_all()
        landing.hand_over()

    took_s, told = land(vehicle, simulation1_plan, end, taken=False)
    assert DOWN_S < took_s < DOWN_S + 2.0
    assert told == []


def test_a_vehicle_that_is_silent_or_still_armed_is_handed_over_by_name(simulation1_plan: Plan) -> None:
    vehicle = Vehicle(PX4, mode=PX4.guided, armed=True)
    rules: list[str] = []

    async def end(landing: FleetLanding, crew: FlightVehicle) -> None:
        landing.hand_over()
        vehicle.session = None
        await asyncio.sleep(20.0)
        await landing.land_all()
        landing.hand_over()

    assert land(vehicle, simulation1_plan, end, rules=rules)[1] == [HANDED_OVER] * 2
    assert rules[0].startswith("still armed: fly it by its RC transmitter")
    assert rules[1].startswith("not heard: it is not known whether landed")
    assert "gcs attach --land" in rules[1]
