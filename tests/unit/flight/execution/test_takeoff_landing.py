"""One vehicle from silence to the air and down again, on a clock of its own: habits that recordings show."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from gcs.autopilots.columns import FlightBehaviour
from gcs.autopilots.traits import Autopilot, link_behaviour
from gcs.errors import FlightError, PeerTimeout
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.fleet_arming import arm_all
from gcs.flight.execution.fleet_landing import Custody
from gcs.flight.execution.takeoff_landing import (
    WATCHED_IDS,
    FlightVehicle,
    request_telemetry,
    set_mode,
    start_mission,
    take_off,
)
from gcs.flight.execution.telemetry_watch import FRESH_S, TelemetryWatch
from gcs.flight.monitoring.monitor import VehicleView
from gcs.link.protocols.command import CommandRefused
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MavCommand, MavResult, MessageId, ModeFlag
from gcs.plan.trajectory.plan import Plan
from tests.virtual_clock import VirtualLoop

ARDUPILOT, PX4 = (known.traits.flight for known in (Autopilot.ARDUPILOT, Autopilot.PX4))
BOTH = pytest.mark.parametrize("behaviour", [ARDUPILOT, PX4], ids=["ArduPilot", "PX4"])


def autopilot_of(behaviour: FlightBehaviour) -> Autopilot:
    return next(known for known in Autopilot if known.traits.flight is behaviour)


@dataclass
class Vehicle:
    """Beats every second, acknowledges commands as set, and does what `obey` makes of them."""

    behaviour: FlightBehaviour
    mode: int = 0
    armed: bool = False
    result: int = MavResult.ACCEPTED
    obey: Callable[[Vehicle, dict[str, Any]], None] = lambda vehicle, fields: None
    heard: list[dict[str, Any]] = field(default_factory=list)
    session: VehicleSession | None = None
    ack_s: float = 0.01  # after a command

    def heartbeat(self) -> Message:
        fields = {
            "autopilot": autopilot_of(self.behaviour),
            "base_mode": int(ModeFlag.CUSTOM),
        }
        fields["base_mode"] |= int(ModeFlag.ARMED) if self.armed else 0
        return Message("HEARTBEAT", {**fields, "type": 2, "custom_mode": self.mode, "system_status": 4}, 1, 1)

    def say(self, message: Message, in_s: float = 0.01) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(in_s, lambda: self.session and self.session.receive(message, loop.time()))

    def hear(self, message: Message) -> None:
        assert message.name == "COMMAND_LONG"
        self.heard.append(message.fields)
        target = {"target_system": GROUND.sysid, "target_component": GROUND.compid, "progress": 0, "result_param2": 0}
        answer = {"command": message.fields["command"], "result": self.result, **target}
        if self.ack_s < math.inf:
            self.say(Message("COMMAND_ACK", answer, 1, 1), self.ack_s)
        self.obey(self, message.fields)

    async def beat(self) -> None:
        while True:
            await asyncio.sleep(1.0)
            if self.session is not None:
                self.session.receive(self.heartbeat(), asyncio.get_running_loop().time())

    def text(self, words: str, in_s: float, number: int = 0, chunk: int = 0) -> None:
        self.say(Message("STATUSTEXT", {"severity": 2, "text": words, "id": number, "chunk_seq": chunk}, 1, 1), in_s)


def live(vehicle: Vehicle, plan: Plan | None, act: Callable[[FlightVehicle], Awaitable[object]]) -> float:
    """Have the ground station act; returns how long it took, in seconds."""

    async def story() -> float:
        loop = asyncio.get_running_loop()
        vehicle.session = VehicleSession(vehicle.heartbeat(), vehicle.hear)
        beating = asyncio.ensure_future(vehicle.beat())
        ticking = asyncio.ensure_future(_tick(vehicle.session))
        crew = FlightVehicle(vehicle.session, vehicle.behaviour, plan, 0, VehicleView(1), FlightOptions())  # type: ignore[arg-type]
        began_s = loop.time()
        try:
            await act(crew)
            return loop.time() - began_s
        finally:
            beating.cancel()
            ticking.cancel()

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(story())


async def _tick(session: VehicleSession) -> None:
    while True:
        await asyncio.sleep(0.05)
        session.tick(asyncio.get_running_loop().time())


@BOTH
def test_a_mode_is_believed_when_the_heartbeat_shows_it(behaviour: FlightBehaviour) -> None:
    """Both acknowledge modes that they then do not take, PX4 even modes that it does not know."""

    def later(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        asyncio.get_running_loop().call_later(7.3, lambda: setattr(vehicle, "mode", behaviour.land))

    slow = Vehicle(behaviour, obey=later)
    assert 7.3 < live(slow, None, lambda crew: set_mode(crew, behaviour.land)) < 9.0
    with pytest.raises(PeerTimeout, match=f"mode {behaviour.mode_name(behaviour.land)}"):
        live(Vehicle(behaviour), None, lambda crew: set_mode(crew, behaviour.land))


def test_a_mission_has_begun_when_the_heartbeat_shows_its_mode() -> None:
    """ArduPilot accepts MISSION_START where nothing comes of it."""

    def begin(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        assert fields["command"] == MavCommand.MISSION_START
        vehicle.mode = ARDUPILOT.mission

    live(Vehicle(ARDUPILOT, mode=ARDUPILOT.guided, obey=begin), None, start_mission)
    with pytest.raises(PeerTimeout, match="mode AUTO"):
        live(Vehicle(ARDUPILOT, mode=ARDUPILOT.guided), None, start_mission)


@BOTH
@pytest.mark.parametrize("ack_s", [6.0, math.inf])
def test_a_heartbeat_with_the_mode_is_as_good_as_the_acknowledgement(behaviour: FlightBehaviour, ack_s: float) -> None:
    """A PX4 on a busy machine: the mode was sent five times in 3.5 s, the answers came 4 to 7 s later."""

    def later(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        asyncio.get_running_loop().call_later(4.8, lambda: setattr(vehicle, "mode", behaviour.land))

    busy = Vehicle(behaviour, obey=later, ack_s=ack_s)
    assert 4.8 < live(busy, None, lambda crew: set_mode(crew, behaviour.land)) < 6.5
    assert len(busy.heard) == 5
    deaf = Vehicle(behaviour, ack_s=math.inf)
    with pytest.raises(PeerTimeout, match="did not acknowledge MAV_CMD_DO_SET_MODE, sent 5 times"):
        live(deaf, None, lambda crew: set_mode(crew, behaviour.land))


@BOTH
def test_a_mode_that_is_shown_already_is_requested_all_the_same(behaviour: FlightBehaviour) -> None:
    vehicle = Vehicle(behaviour, mode=behaviour.land)
    assert live(vehicle, None, lambda crew: set_mode(crew, behaviour.land)) < 0.5
    assert [fields["command"] for fields in vehicle.heard] == [MavCommand.DO_SET_MODE]


@pytest.mark.parametrize(("result", "reason_s"), [(MavResult.FAILED, -0.1), (MavResult.TEMPORARILY_REJECTED, 0.5)])
def test_reasons_come_before_or_after_a_refusal_and_in_pieces(result: MavResult, reason_s: float) -> None:
    """ArduPilot says why just before or after it refuses, PX4 up to half a second later and in two chunks."""
    vehicle = Vehicle(PX4, mode=PX4.armed_in, result=result)

    async def arm(crew: FlightVehicle) -> None:
        words = "Arming denied: resolve system health failures first"  # 51 letters, a chunk holds 50
        vehicle.text(words[:50], 0.2 + reason_s, number=9)
        vehicle.text(words[50:], 0.25 + reason_s, number=9, chunk=1)
        await asyncio.sleep(0.2)
        await crew.session.command(MavCommand.COMPONENT_ARM_DISARM, 1.0)

    with pytest.raises(CommandRefused, match="it reports: Arming denied: resolve system health failures first"):
        live(vehicle, None, arm)


@BOTH
def test_it_takes_off_in_a_mode_that_flies_no_mission_by_itself(
    behaviour: FlightBehaviour, simulation1_plan: Plan
) -> None:
    """ArduPilot cannot be armed in AUTO, PX4 armed in its mission mode flies off; both want to be armed first."""

    def obey(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        if fields["command"] == MavCommand.DO_SET_MODE:
            vehicle.mode = behaviour.armed_in

    vehicle = Vehicle(behaviour, mode=behaviour.mission, obey=obey)

    async def start(crew: FlightVehicle) -> None:
        await arm_all({1: crew}, Custody({1: crew.session}))
        await take_off(crew)

    live(vehicle, simulation1_plan, start)
    assert [fields["command"] for fields in vehicle.heard] == [
        MavCommand.DO_SET_MODE,
        MavCommand.COMPONENT_ARM_DISARM,
        MavCommand.NAV_TAKEOFF,
    ]
    assert behaviour.armed_in != behaviour.mission
    scenario = simulation1_plan.scenario
    hovering = simulation1_plan.states(np.array([simulation1_plan.phase("takeoff").end_s]))
    hover_m = -float(hovering[0, 0, 2])
    above_m = scenario.origin.alt_amsl_m if behaviour is PX4 else float(simulation1_plan.pads_ned_m[0, 2])
    assert vehicle.heard[-1]["param7"] == pytest.approx(hover_m + above_m, abs=1e-3)


@BOTH
def test_nothing_is_armed_after_what_forbids_it(behaviour: FlightBehaviour, simulation1_plan: Plan) -> None:
    """A critical text that comes while the mode is set: arming is the next order, and it is not given."""

    def obey(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        vehicle.mode = behaviour.armed_in

    def forbid() -> None:
        raise FlightError("vehicle 1 reports: RTL: unsupported MAV_FRAME")

    vehicle = Vehicle(behaviour, obey=obey)
    with pytest.raises(FlightError, match="vehicle 1 reports"):
        live(vehicle, simulation1_plan, lambda crew: arm_all({1: crew}, Custody({1: crew.session}), forbid))
    assert [fields["command"] for fields in vehicle.heard] == [MavCommand.DO_SET_MODE]


def test_no_vehicle_is_armed_whose_last_report_is_old() -> None:
    """It may have rebooted, and send HEARTBEATs only."""

    async def wait(crew: FlightVehicle) -> None:
        watch = TelemetryWatch({1: crew}, Custody({1: crew.session}), lambda *_: None)
        crew.session.receive(
            Message("SYSTEM_TIME", {"time_boot_ms": 60_000, "time_unix_usec": 0}, 1, 1),
            asyncio.get_running_loop().time(),
        )
        await asyncio.sleep(FRESH_S - 0.1)
        watch.refuse_stale()
        await asyncio.sleep(0.2)
        watch.refuse_stale()

    with pytest.raises(FlightError, match=r"vehicle 1 is not armed: its last report is 2\.1 s old \(limit 2 s\)"):
        live(Vehicle(ARDUPILOT), None, wait)


@BOTH
def test_nothing_is_expected_that_was_not_asked_for(behaviour: FlightBehaviour) -> None:
    """ArduPilot sends little but HEARTBEAT until asked, at about nine tenths of the rate; interval 0 switches off."""
    vehicle = Vehicle(behaviour)
    live(vehicle, None, request_telemetry)
    asked = {int(fields["param1"]): fields["param2"] for fields in vehicle.heard}
    assert {fields["command"] for fields in vehicle.heard} == {MavCommand.SET_MESSAGE_INTERVAL}
    wanted = {
        MessageId.LOCAL_POSITION_NED,
        MessageId.SYSTEM_TIME,
        MessageId.RC_CHANNELS,  # a pilot's input
        link_behaviour(autopilot_of(behaviour)).estimator.message,
        *behaviour.health_ids,
    }
    assert wanted <= set(asked)
    assert all(interval_us > 0.0 for interval_us in asked.values())


@BOTH
def test_what_another_station_shows_is_requested_too_and_may_be_refused(behaviour: FlightBehaviour) -> None:
    """`--also-to` is one way: that station cannot request anything itself."""

    async def request(crew: FlightVehicle) -> None:
        await request_telemetry(replace(crew, options=FlightOptions(watched_elsewhere=True)))

    def refuse(vehicle: Vehicle, fields: dict[str, Any]) -> None:
        vehicle.result = MavResult.DENIED if len(vehicle.heard) >= needed else MavResult.ACCEPTED

    needed = 10**6
    vehicle = Vehicle(behaviour, obey=refuse)
    live(vehicle, None, request)
    assert set(WATCHED_IDS) <= {int(fields["param1"]) for fields in vehicle.heard}
    needed = len(vehicle.heard) - len(WATCHED_IDS)
    live(refusing := Vehicle(behaviour, obey=refuse), None, request)
    assert len(refusing.heard) == len(vehicle.heard)
