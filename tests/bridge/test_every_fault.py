"""Every kind of fault by command line, by file and by MAVLink: it acts on its vehicle, and on no other."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import CopterMode, MavResult
from sim_bridge.faults import fault_spec as f
from sim_bridge.faults.fault_commands import USER_1
from sim_bridge.faults.fault_spec import Fault, parse_fault, parse_faults, read_fault_file
from sim_bridge.faults.lossy_link import LinkImpairment
from sim_bridge.fleet import plain_scenario
from sim_bridge.protocol.endpoint_address import EndpointKind, EndpointSpec
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import EPOCH_UNIX_S

STRIKES_S, LOOK_S = 14.0, 18.0
HEIGHT_M = 4.0


def impairment(**wanted: float) -> Callable[[World, int], bool]:
    def ails(fleet: World, row: int) -> bool:
        radio = fleet.injector.radios.get(row)
        return radio is not None and radio.up.impairment == radio.down.impairment == LinkImpairment(**wanted)

    return ails


def off_m(fleet: World, row: int) -> np.ndarray:
    """How far the receiver is off."""
    return fleet.airframes.gnss_ned[row, :3] - fleet.airframes.truth[row, :3]


def stuck(fleet: World, row: int) -> bool:
    sensors, truth = fleet.airframes.sensors, fleet.airframes.truth.T
    return bool(sensors.read_baro(truth)[row] == sensors.read_baro(truth)[row])


def crept(fleet: World, row: int) -> bool:
    """Whether it was slow on the way that both were sent."""
    return not fleet.airframes.landed[row] and bool(np.hypot(*fleet.airframes.truth[row, 3:5]) < 0.7)


EFFECTS: dict[str, Callable[[World, int], bool]] = {
    "loss=0.25": impairment(loss=0.25),
    "duplicate=0.25": impairment(duplicate=0.25),
    "reorder=0.25": impairment(reorder=0.25),
    "corrupt=0.25": impairment(corrupt=0.25),
    "delay=0.5,0.25": impairment(delay_s=0.5, jitter_s=0.25),
    "silent": impairment(loss=1.0),
    "die": lambda fleet, row: fleet.vehicles[row].dead and bool(fleet.airframes.landed[row]),
    "reject-mission": lambda fleet, row: fleet.vehicles[row].store.rejects,
    "reboot": lambda fleet, row: fleet.vehicles[row].on_from_s > 0.0 and bool(fleet.airframes.landed[row]),
    "gnss-outage": lambda fleet, row: (
        bool(fleet.airframes.estimator.coasting[row]) and not fleet.airframes.gnss_fix[row]
    ),
    "gnss-jump=6,-5,2": lambda fleet, row: bool(np.abs(off_m(fleet, row) - [6.0, -5.0, 2.0]).max() < 0.5),
    "motor=3,0.2": lambda fleet, row: bool(
        fleet.airframes.rotors_radps[row, 2] > 1.05 * fleet.airframes.rotors_radps[row].min()
    ),
    "battery=0.3": lambda fleet, row: fleet.airframes.battery.remaining[row] < 0.31,
    "stuck=barometer": stuck,
    "slow=0.5": crept,
    "wind=0,4,-1": lambda fleet, row: fleet.airframes.wind_ned_mps[row].tolist() == [0.0, 4.0, -1.0],
    "refuse-commands": lambda fleet, row: fleet.vehicles[row].commands.refuses,
    "refuse-arming": lambda fleet, row: fleet.vehicles[row].autopilot.arming.refuses,
    "sag=2": lambda fleet, row: fleet.vehicles[row].instruments.sag_V == 2.0,
    "fail-checks": lambda fleet, row: fleet.vehicles[row].autopilot.arming.fails_checks,
    "ignore-commands": lambda fleet, row: fleet.vehicles[row].commands.ignores,
    "wrong-crc": lambda fleet, row: fleet.vehicles[row].files.wrong_checksums,
    "clock-jump=20": lambda fleet, row: fleet.vehicles[row].instruments.gnss_ahead_s == 20.0,
    "slow-down=late": lambda fleet, row: fleet.vehicles[row].autopilot.reaction == 1,
    "push=0,5": lambda fleet, row: bool(fleet.airframes.truth[row, 4] > 0.5),
}


IDS = range(1, len(EFFECTS) + 1)  # each has a fault of its own; one more vehicle has none


def in_the_air(faults: dict[int, tuple[Fault, ...]]) -> World:
    options = WorldOptions(links=[EndpointSpec(EndpointKind.UDP_IN)], seed=4, epoch_unix_s=EPOCH_UNIX_S, faults=faults)
    fleet = World(plain_scenario(len(EFFECTS) + 1), options)
    while not all(vehicle.autopilot.readiness.ready for vehicle in fleet.vehicles):
        fleet.step()
    for row, vehicle in enumerate(fleet.vehicles):
        pilot = vehicle.autopilot
        pilot.set_mode(fleet.t_s, CopterMode.GUIDED)
        assert pilot.arm(fleet.t_s, fleet.airframes.estimate[row]) == MavResult.ACCEPTED
        pilot.take_off(fleet.t_s, HEIGHT_M)
    while fleet.t_s < STRIKES_S - 0.2:
        fleet.step()
    return fleet


def send_on(fleet: World) -> None:
    """Have all vehicles fly north."""
    for row, vehicle in enumerate(fleet.vehicles):
        there = np.append(fleet.airframes.truth[row, :3] + [40.0, 0.0, 0.0], fleet.airframes.truth[row, 8])
        vehicle.autopilot.reposition(fleet.t_s, there, change_mode=False)


def strike(fleet: World, sysid: int, text: str) -> None:
    """As a ground station does."""
    _, fault = parse_fault(f"{sysid}:{text}")
    params = [float(fault.kind.number), *fault.values]
    fields = {f"param{i + 1}": value for i, value in enumerate([*params, *[0.0] * (7 - len(params))])}
    head = {"target_system": sysid, "target_component": 1, "command": USER_1, "confirmation": 0}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.settimeout(60.0)
        ground.sendto(Codec(*GROUND).encode(Message("COMMAND_LONG", head | fields)), ("127.0.0.1", fleet.ports[sysid]))
        fleet.step()
        heard = Codec(*GROUND).decode(ground.recv(4096))
    (ack,) = [message for message in heard if message.name == "COMMAND_ACK"]
    assert (ack.fields["command"], ack.fields["result"]) == (USER_1, MavResult.ACCEPTED)


def who_suffers(fleet: World) -> list[tuple[str, int]]:
    """Effects, and the vehicles that show them."""
    return [(text, sysid) for text, effect in EFFECTS.items() for sysid in fleet.sysids if effect(fleet, sysid - 1)]


@pytest.mark.parametrize("way", ["command line", "file", "MAVLink"])
def test_a_fault_strikes_its_vehicle_and_no_other(way: str, tmp_path: Path) -> None:
    assert {parse_fault(f"1:{text}")[1].kind for text in EFFECTS} == set(f.KINDS)
    texts = [f"{sysid}:{text}@start:{STRIKES_S:g}" for sysid, text in zip(IDS, EFFECTS, strict=True)]
    if way == "file":
        path = tmp_path / "faults.toml"
        lines = [f'{sysid} = ["{text}@start:{STRIKES_S:g}"]' for sysid, text in zip(IDS, EFFECTS, strict=True)]
        path.write_text("\n".join(["[faults]", *lines]))
        assert read_fault_file(path) == texts
        return
    with in_the_air({} if way == "MAVLink" else parse_faults(texts, IDS)) as fleet:
        send_on(fleet)
        assert {text for text, _ in who_suffers(fleet)} == {"slow=0.5"}  # all vehicles still stand
        while fleet.t_s < STRIKES_S:
            fleet.step()
        if way == "MAVLink":
            for sysid, text in zip(IDS, EFFECTS, strict=True):
                strike(fleet, sysid, text)
        while fleet.t_s < LOOK_S:
            fleet.step()
        expected = [(text, sysid) for sysid, text in zip(IDS, EFFECTS, strict=True)]
        assert who_suffers(fleet) == expected
