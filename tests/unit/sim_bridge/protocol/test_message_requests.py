"""REQUEST_MESSAGE as recorded: PX4 denies what it has sent already, ArduCopter accepts everything; RC and arming."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.frames import Origin
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MavCommand, MavResult, MessageId
from gcs.mavlink_names import SENSORS
from gcs.scenario.sources.load import load_scenario
from sim_bridge.personality import ARDUPILOT, PX4, Personality
from sim_bridge.sim.vehicle_factory import VehicleFactory
from tests.replay.harness import Harness

# Of ten requests, each made when the message of the one before was there: accepted, least and most as recorded.
RECORDED = {
    MessageId.AUTOPILOT_VERSION: (10, 10),
    MessageId.SYS_STATUS: (4, 5),
    MessageId.ESTIMATOR_STATUS: (5, 5),
    MessageId.GPS_RAW_INT: (1, 3),
    MessageId.GLOBAL_POSITION_INT: (4, 5),
    MessageId.HOME_POSITION: (10, 10),
    MessageId.GPS_GLOBAL_ORIGIN: (10, 10),
    MessageId.LOCAL_POSITION_NED: (1, 2),
    MessageId.EXTENDED_SYS_STATE: (10, 10),
    MessageId.SYSTEM_TIME: (10, 10),
}
NEVER_OLD = {number for number, (least, _) in RECORDED.items() if least == 10}


class Asked:
    """A ready vehicle that is asked for messages, by a script that waits for each before it asks again."""

    def __init__(self, personality: Personality, repo_root: Path) -> None:
        scenario = load_scenario(repo_root / "missions" / "field")
        origin = scenario.origin
        home = Origin(origin.lat_deg, origin.lon_deg, origin.alt_amsl_m)
        self.harness = Harness(
            personality, scenario, Station(1, 1), home, boots_s=None, epoch_unix_s=1.8e9, standing=frozenset()
        )
        self.ground = Codec(255, 190)

    def heard(self, name: str) -> bool:
        return any(told.message.name == name for told in self.harness.told)

    def command(self, number: int, *params: float) -> int:
        values = {f"param{n}": float(v) for n, v in enumerate((*params, *(0.0,) * 7)[:7], start=1)}
        fields = {"target_system": 1, "target_component": 1, "command": int(number), "confirmation": 0}
        before = len(self.harness.told)
        self.harness.receive(self.ground.encode(Message("COMMAND_LONG", fields | values)), self.harness.t_s)
        acks = (told.message for told in self.harness.told[before:] if told.message.name == "COMMAND_ACK")
        return int(next(acks).fields["result"])

    def accepted_of_ten(self, number: MessageId) -> list[int]:
        results = []
        for _ in range(10):
            self.harness.told.clear()
            results.append(self.command(MavCommand.REQUEST_MESSAGE, number))
            until_s = self.harness.t_s + 0.3
            while not self.heard(number.name) and self.harness.t_s < until_s:
                self.harness.run_until(self.harness.t_s)
        return results


@pytest.mark.parametrize("number", RECORDED)
def test_px4_denies_what_it_has_sent_already(repo_root: Path, number: MessageId) -> None:
    vehicle = Asked(PX4, repo_root)
    for streamed in (MessageId.SYS_STATUS, MessageId.GLOBAL_POSITION_INT):  # as the recorded script did
        vehicle.command(MavCommand.SET_MESSAGE_INTERVAL, streamed, 500_000.0)
    vehicle.harness.run_until(1.13)
    results = vehicle.accepted_of_ten(number)
    assert set(results) <= {MavResult.ACCEPTED, MavResult.DENIED}
    accepted, (least, most) = results.count(MavResult.ACCEPTED), RECORDED[number]
    if number in NEVER_OLD:
        assert accepted == 10
    else:
        assert least - 2 <= accepted <= most + 2


@pytest.mark.parametrize("number", sorted({*RECORDED, MessageId.EKF_STATUS_REPORT} - {MessageId.ESTIMATOR_STATUS}))
def test_arducopter_accepts_every_request(repo_root: Path, number: MessageId) -> None:
    assert Asked(ARDUPILOT, repo_root).accepted_of_ten(number) == [MavResult.ACCEPTED] * 10


def test_the_same_seed_denies_the_same_requests(repo_root: Path) -> None:
    first, again = (Asked(PX4, repo_root).accepted_of_ten(MessageId.SYS_STATUS) for _ in range(2))
    assert first == again


@pytest.mark.parametrize(("personality", "ailing"), [(PX4, {"radio control"}), (ARDUPILOT, set())])
def test_without_remote_control_it_arms_all_the_same(
    repo_root: Path, personality: Personality, ailing: set[str]
) -> None:
    asked = Asked(personality, repo_root)
    asked.harness.run_until(1.0)
    asked.command(MavCommand.REQUEST_MESSAGE, MessageId.SYS_STATUS)
    fields = next(told.message.fields for told in asked.harness.told if told.message.name == "SYS_STATUS")
    bits = fields["onboard_control_sensors_enabled"] & ~fields["onboard_control_sensors_health"]
    assert {name for bit, name in enumerate(SENSORS) if bits >> bit & 1} - {"arming checks"} == ailing
    flight = personality.autopilot.traits.flight
    asked.command(MavCommand.DO_SET_MODE, *flight.mode_parameters(flight.armed_in))
    assert asked.command(MavCommand.COMPONENT_ARM_DISARM, 1.0) == MavResult.ACCEPTED


@pytest.mark.parametrize("personality", [PX4, ARDUPILOT])
def test_the_sticks_of_a_remote_control_are_streamed_where_there_is_one(
    repo_root: Path, personality: Personality
) -> None:
    asked = Asked(personality, repo_root)
    assert asked.command(MavCommand.SET_MESSAGE_INTERVAL, MessageId.RC_CHANNELS, 500_000.0) == MavResult.ACCEPTED
    asked.harness.run_until(3.0)
    assert not asked.heard("RC_CHANNELS")
    asked.harness.vehicle.autopilot.channels_us = (1500, 1500, 1000, 1500)
    asked.harness.run_until(6.0)
    fields = [told.message.fields for told in asked.harness.told if told.message.name == "RC_CHANNELS"]
    assert 5 <= len(fields) <= 7
    assert (fields[0]["chancount"], fields[0]["chan3_raw"], fields[0]["chan5_raw"]) == (4, 1000, 65535)


@pytest.mark.parametrize(("personality", "name"), [(PX4, "BAT1_CAPACITY"), (ARDUPILOT, "BATT_CAPACITY")])
def test_it_is_set_to_the_battery_of_its_scenario(repo_root: Path, personality: Personality, name: str) -> None:
    scenario = load_scenario(repo_root / "missions" / "field")
    vehicle = VehicleFactory(scenario, personality, 1, 1.8e9).vehicle(0)
    asked = Message(
        "PARAM_REQUEST_READ", {"target_system": 1, "target_component": 1, "param_id": name, "param_index": -1}
    )
    (message,) = Codec(9, 9).decode(Codec(255, 190).encode(asked))
    (value,) = [m.fields["param_value"] for m in vehicle.receive(message, 0.0) if m.name == "PARAM_VALUE"]
    assert scenario.vehicle.power is not None
    assert value == pytest.approx(1000.0 * scenario.vehicle.power.battery_Wh / (4 * 3.7))
    assert personality.autopilot.traits.link.capacity_parameter == name


def test_a_charge_in_percent_is_not_rounded_up_for_the_error_of_a_sum(repo_root: Path) -> None:
    told = []
    for percent in (99, 57, 29, 18, 7):
        asked = Asked(ARDUPILOT, repo_root)
        asked.harness.run_until(1.0)
        asked.harness.airframes.battery.drain(np.array([percent / 100.0]))
        asked.harness.told.clear()
        asked.command(MavCommand.REQUEST_MESSAGE, MessageId.SYS_STATUS)
        told += [
            one.message.fields["battery_remaining"] for one in asked.harness.told if one.message.name == "SYS_STATUS"
        ]
    assert told == [99, 57, 29, 18, 7]
