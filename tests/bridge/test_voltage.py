"""Low batteries as autopilots report them: by text, charge state, sensor bit and status, whatever the percentage."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.mavlink import MavState, MessageId
from gcs.plan.trajectory.plan import Plan
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.personality import by_name
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.protocol.telemetry.vitals import BUILDERS
from sim_bridge.sim.world import WorldOptions
from tests.bridge.flying import fly
from tests.bridge.test_mishaps import flew_on, kept_apart
from tests.bridge.test_own_battery import with_battery
from tests.fleets import CLOCK, emulated, free_port

BATTERY_BIT = 0x2000000
ASKED = (MessageId.HEARTBEAT, MessageId.SYS_STATUS, MessageId.BATTERY_STATUS)


@pytest.mark.slow
def test_a_voltage_that_sags_at_a_full_percentage_is_heard_in_every_way_and_acted_on(hop: Plan) -> None:
    """ArduCopter says so below BATT_LOW_VOLT, 10.5 V, and does nothing. What then counts as left is not enough."""
    plan = replace(hop, scenario=with_battery(hop, 0.3))
    flown = fly(plan, "3:sag=6@16")
    (said,) = (event for event in flown.events if event.what.startswith("reports: WARNING: Battery 1 is low 10."))
    rules = {event.rule for event in flown.events if event.sysid == 3 and event.what == "raises an alarm"}
    assert rules >= {"not healthy any more: battery"}
    (low,) = (event for event in flown.events if event.what == "battery low")
    assert low.rule.startswith("20 % left, reserve 10 %: land here needs ")
    assert 0.0 < low.unix_s - said.unix_s < 3.0
    assert flown.orders(3) == ["land"]
    assert flown.world.airframes.battery.remaining[2] > 0.75
    flew_on(flown, 1)
    flew_on(flown, 2)
    kept_apart(flown)


@pytest.mark.parametrize(
    ("autopilot", "fault", "charge_state", "critical"),
    [
        ("ardupilot", "3:sag=7", 2, True),
        ("px4", "3:battery=0.14", 2, False),  # its status is critical only while a failsafe acts, in flight
        ("px4", "3:battery=0.06", 3, False),
    ],
)
def test_the_alarms_of_each_autopilot(hop: Plan, autopilot: str, fault: str, charge_state: int, critical: bool) -> None:
    options = WorldOptions(
        links=(call(free_port()),), personality=by_name(autopilot), faults=parse_faults([fault], hop.sysids)
    )
    with emulated(hop.scenario, options, CLOCK) as world:
        CLOCK.wait_until(lambda: world.t_s > 15.0)
        for sysid, state in ((2, 1), (3, charge_state)):
            sources = world.vehicles[sysid - 1]._telemetry.sources
            heartbeat, status, battery = (BUILDERS[number](sources) for number in ASKED)
            assert battery["charge_state"] == state
            assert bool(status["onboard_control_sensors_health"] & BATTERY_BIT) == (state == 1)
            assert (heartbeat["system_status"] == MavState.CRITICAL) == (critical and state > 1)
