"""Starts that fail on emulated vehicles: nobody stays armed, no motor goes on turning, and it is said why."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from gcs.errors import FlightError, OrderError, PeerRefusal
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.execution.telemetry_watch import LIMIT_S
from gcs.flight.monitoring.progress import ALL_VEHICLES, Step
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.sim.world import World
from tests.bridge.flying import fly, step_aside
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
    assert not any(vehicle.autopilot.armed for vehicle in flown.world.vehicles)
    assert [vehicle.autopilot.mode.name for vehicle in flown.world.vehicles] == ["GUIDED"] * 3  # no order to land


def test_after_a_refusal_no_vehicle_spins_until_another_has_answered(hop: Plan) -> None:
    flown = fly(hop, "2:refuse-arming", "3:up.delay=2.5")
    assert isinstance(flown.error, PeerRefusal)
    assert 0.0 < on_s(flown.world)[0, 0] < 2.0
    assert not any(vehicle.autopilot.armed for vehicle in flown.world.vehicles)


def test_a_vehicle_that_does_not_confirm_that_it_is_disarmed_is_named(hop: Plan) -> None:
    def deafen(world: World, flight: FlightSequence) -> None:
        world.vehicles[2].commands.ignores = world.vehicles[2].autopilot.mode.name == "GUIDED"

    flown = fly(hop, "2:refuse-arming", during=deafen)
    assert isinstance(flown.error, OrderError)
    assert "vehicle 1 disarmed again; vehicle 3 did not confirm being disarmed: keep away" in flown.error.message


WEAK = tuple(f"2:motor={motor},0.6@start:0" for motor in (1, 2, 3, 4))


@pytest.mark.parametrize(
    ("faults", "said", "runs_s"),
    [
        (WEAK, "does not climb: 0.0 m in 8 s (required 1.0 m)", 10.0),
        pytest.param(("2:motor=1@start:0",), "is tilted by", 6.0, marks=pytest.mark.slow),
        (("2:motor=1@2",), "is tilted by", 8.0),
    ],
    ids=["weak", "dead on the pad", "dead in the climb"],
)
def test_a_motor_that_is_dead_at_the_take_off(hop: Plan, faults: tuple[str, ...], said: str, runs_s: float) -> None:
    """It stops its motors on the ground, though it takes itself for flying; the others land."""
    flown = fly(hop, *faults)
    assert isinstance(flown.error, FlightError)
    assert f"the start was aborted: vehicle 2 {said}" in flown.error.message
    (event,) = [event for event in flown.events if event.sysid != ALL_VEHICLES]
    assert (event.sysid, event.what) == (2, "ordered to disarm")
    assert said in event.rule
    armed_s, flew_s = on_s(flown.world)
    assert 0.0 < flew_s[1] < armed_s[1] < runs_s
    assert not any(vehicle.autopilot.armed for vehicle in flown.world.vehicles)
    assert flown.world.airframes.landed.all()
    for sysid in (1, 3):
        came_home(flown, sysid)


class Reboot:
    """A vehicle reboots once, as soon as `when` is true; `deaf`: it then answers nothing."""

    def __init__(self, when: Callable[[FlightSequence], bool], *, row: int = 1, deaf: bool = False) -> None:
        self.at_s = math.nan
        self._when, self._row, self._deaf = when, row, deaf

    def __call__(self, world: World, flight: FlightSequence) -> None:
        if math.isnan(self.at_s) and self._when(flight):
            self.at_s = world.t_s
            world._reboot(self._row)
            world.vehicles[self._row].commands.ignores = self._deaf


def is_read_back(flight: FlightSequence) -> bool:
    return flight.held is not None


def flies(flight: FlightSequence) -> bool:
    return (flight.monitor.plan_time_s or 0.0) > 5.0


def climbs(flight: FlightSequence) -> bool:
    return flight.step is Step.TAKEOFF and bool(flight.vehicles[2].view.position_ned_m[2] < -3.0)


def test_a_reboot_after_the_checks_ends_the_flight_before_arming(hop: Plan) -> None:
    """Afterwards it sends HEARTBEATs only; its clock, for which the flight waits, stands."""
    reboot = Reboot(is_read_back)
    flown = fly(hop, during=reboot, texts_after_upload_s=60.0)
    assert isinstance(flown.error, FlightError)
    assert flown.error.message == "vehicle 2 rebooted 2 s ago: what was checked and read back may be gone."
    assert flown.world.t_s - reboot.at_s < 6.0
    assert on_s(flown.world).max() == 0.0
    assert [(event.sysid, event.what) for event in flown.events] == [(2, "sends HEARTBEATs only")]


def test_a_vehicle_that_never_reports_again_ends_the_wait_for_its_clock(hop: Plan) -> None:
    reboot = Reboot(is_read_back, deaf=True)
    flown = fly(hop, during=reboot, texts_after_upload_s=60.0)
    assert isinstance(flown.error, FlightError)
    assert "vehicle 2 sent HEARTBEATs but neither position nor time for 20 s, asked again" in flown.error.message
    assert LIMIT_S < flown.world.t_s - reboot.at_s < LIMIT_S + 3.0
    assert on_s(flown.world).max() == 0.0


@pytest.mark.slow
def test_a_reboot_in_flight_is_a_loss_and_is_told(hop: Plan) -> None:
    flown = fly(hop, during=Reboot(flies))
    assert isinstance(flown.error, FlightError)
    assert "vehicle 2 left the formation: disarmed in the air" in flown.error.message
    assert flown.orders(1) == flown.orders(3) == ["land"]
    assert flown.happened(2) == ["disarmed in the air", "sends HEARTBEATs only", "rebooted 2 s ago"]
    assert flown.world.airframes.landed.all()


@pytest.mark.slow
def test_a_reboot_in_the_climb_lands_the_others_on_their_pads(hop: Plan) -> None:
    flown = fly(hop, during=Reboot(climbs))
    assert isinstance(flown.error, FlightError)
    assert "vehicle 2 stopped its motors by itself 3.0 m up. The others are ordered to land." in flown.error.message
    assert flown.world.airframes.landed.all()
    for sysid in (1, 3):
        came_home(flown, sysid)


@pytest.mark.slow
def test_a_reboot_of_the_only_vehicle_whose_clock_the_flight_has(field: Scenario) -> None:
    data = step_aside(field).model_dump(mode="json")
    data["formation"]["vehicle"] = data["formation"]["vehicle"][:1]
    flown = fly(make_plan(Scenario.model_validate(data)), during=(reboot := Reboot(flies, row=0)))
    assert isinstance(flown.error, FlightError)
    assert "vehicle 1 left the formation: disarmed in the air" in flown.error.message
    assert flown.world.t_s - reboot.at_s < 8.0
