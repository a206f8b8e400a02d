"""Emulated vehicles at every kind of endpoint, and what bad links and hostile stations do to them."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gcs.errors import UsageError
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MavCommand, MavResult
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.cli import parse_links
from sim_bridge.cli import run as sim_bridge
from sim_bridge.faults.fault_commands import INJECT_FAILURE, USER_1
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.protocol.endpoint_address import CALL_GROUND, EndpointKind, EndpointSpec
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import running_fleet

TIMEOUT_S = 120.0
BEAT = {"type": 6, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}


class Station:
    """A ground station on one line: bytes out, messages in."""

    def __init__(self, write: Callable[[bytes], object], read: Callable[[], bytes]) -> None:
        self.codec = Codec(*GROUND)
        self._write, self._read = write, read
        self._heard: list[Message] = []
        self.beat()

    def beat(self) -> None:
        self.say("HEARTBEAT", **BEAT)

    def say(self, name: str, **fields: float) -> None:
        self._write(self.codec.encode(Message(name, fields)))

    def hear(self, name: str, sysid: int, **fields: float) -> Message:
        end_s = time.monotonic() + TIMEOUT_S
        while time.monotonic() < end_s:
            while self._heard:
                m = self._heard.pop(0)
                if m.name == name and m.sysid == sysid and all(m.fields[k] == v for k, v in fields.items()):
                    return m
            self._heard += self.codec.decode(self._read())
        raise AssertionError(f"no {name} from {sysid}")

    def command(self, sysid: int, command: int, *params: float) -> int:
        full = {f"param{i + 1}": p for i, p in enumerate((*params, *[0.0] * (7 - len(params))))}
        fields = {"target_system": sysid, "target_component": 1, "command": command, "confirmation": 0}
        self.say("COMMAND_LONG", **fields, **full)
        return int(self.hear("COMMAND_ACK", sysid, command=command).fields["result"])


@contextlib.contextmanager
def udp_station(port: int, *, local: int = 0) -> Iterator[Station]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", local))
        sock.settimeout(TIMEOUT_S)
        yield Station(lambda data: sock.sendto(data, ("127.0.0.1", port)), lambda: sock.recv(65536))


@contextlib.contextmanager
def tcp_station(port: int) -> Iterator[Station]:
    with socket.create_connection(("127.0.0.1", port), TIMEOUT_S) as sock:
        yield Station(sock.sendall, lambda: sock.recv(65536))


@contextlib.contextmanager
def serial_station(path: str) -> Iterator[Station]:
    file = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(file)
        yield Station(lambda data: os.write(file, data), lambda: os.read(file, 65536))
    finally:
        os.close(file)


def station_at(fleet: World, sysid: int) -> contextlib.AbstractContextManager[Station]:
    place = fleet.places[sysid][0]
    if place.kind == EndpointKind.PTY:
        return serial_station(place.address)
    return tcp_station(place.port) if place.kind == EndpointKind.TCP_IN else udp_station(place.port)


@pytest.mark.parametrize("shared", [False, True], ids=["one each", "one for all"])
@pytest.mark.parametrize("kind", [EndpointKind.UDP_IN, EndpointKind.TCP_IN, EndpointKind.PTY])
def test_vehicles_answer_on_every_kind_of_link(simulation1: Scenario, kind: EndpointKind, shared: bool) -> None:
    with running_fleet(simulation1, WorldOptions(links=[EndpointSpec(kind, shared=shared)], speedup=5.0)) as fleet:
        addresses = {places[0].address for places in fleet.places.values()}
        assert len(addresses) == (1 if shared else 6)
        for sysid in (6, 2):
            with station_at(fleet, sysid) as station:
                assert station.command(sysid, MavCommand.REQUEST_MESSAGE, 148) == MavResult.ACCEPTED
                assert bytes(station.hear("AUTOPILOT_VERSION", sysid).fields["uid2"])[11:14] == b"%03d" % sysid
                if shared:
                    station.hear("HEARTBEAT", 1)
                    station.hear("HEARTBEAT", 5)


def test_a_vehicle_may_have_several_links_and_is_heard_on_all(simulation1: Scenario) -> None:
    links = [EndpointSpec(EndpointKind.TCP_IN), EndpointSpec(EndpointKind.UDP_IN, shared=True)]
    with running_fleet(simulation1, WorldOptions(links=links, speedup=5.0)) as fleet:
        tcp, udp = fleet.places[4]
        with tcp_station(tcp.port) as one, udp_station(udp.port) as other:
            assert one.command(4, MavCommand.REQUEST_MESSAGE, 148) == MavResult.ACCEPTED
            assert other.hear("AUTOPILOT_VERSION", 4)


def test_command_lines_name_links() -> None:
    assert parse_links(None, []) == [CALL_GROUND]
    assert parse_links(None, ["tcpin:5760"]) == [EndpointSpec(EndpointKind.TCP_IN, port=5760)]
    both = parse_links("10.0.0.1:9", ["udpin:14540"], bind="0.0.0.0", shared=True)
    assert both == [
        EndpointSpec(EndpointKind.UDP_OUT, "10.0.0.1", 9, shared=True),
        EndpointSpec(EndpointKind.UDP_IN, "0.0.0.0", 14540, shared=True),
    ]


def test_whoever_lets_others_in_is_told_so(
    repo_root: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(repo_root)
    line = [sys.executable, "-m", "sim_bridge", "missions/simulation1", "--until-eof", "--link", "tcpin:0"]
    done = subprocess.run(
        [*line, "--bind", "0.0.0.0"], cwd=repo_root, input="", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert "listening on 0.0.0.0" in done.stderr
    places = json.loads(done.stdout)["places"]
    assert all(place[0].startswith("tcpin:0.0.0.0:") for place in places.values())
    assert sim_bridge([*line[3:-1], "tcpin:0.0.0.0:0"]) == 2
    assert "--bind 0.0.0.0" in capfd.readouterr().err


def test_more_vehicles_than_system_ids_are_refused_in_words(simulation1: Scenario) -> None:
    data = simulation1.model_dump(mode="json")
    data["limits"] |= {"north_m": [-40.0, 1540.0], "east_m": [-40.0, 1540.0]}
    grid = {"name": "grid", "generator": "grid", "spacing_m": 2.0}
    data["formation"] = {"leader": 1, "count": 255, "start_shape": "grid", "shape": [grid]}
    with pytest.raises(UsageError, match="system id 255 of 255 vehicles is above 254"):
        World(Scenario.model_validate(data), WorldOptions(links=[EndpointSpec(EndpointKind.UDP_IN, shared=True)]))


# Bad links


def faulty(scenario: Scenario, *texts: str, speedup: float = 5.0) -> WorldOptions:
    faults = parse_faults(texts, range(1, 7))
    return WorldOptions(links=[EndpointSpec(EndpointKind.UDP_IN, shared=True)], speedup=speedup, faults=faults)


def test_a_dead_link_is_mended_from_outside(simulation1: Scenario) -> None:
    """Live commands are for the emulator: they get through where nothing else does."""
    with (
        running_fleet(simulation1, faulty(simulation1)) as fleet,
        udp_station(fleet.places[3][0].port) as station,
    ):
        station.hear("HEARTBEAT", 3)
        assert station.command(3, INJECT_FAILURE, 105, 1) == MavResult.ACCEPTED  # MAVLink signal off
        sent_s = fleet.t_s
        station.say("COMMAND_LONG", **{f"param{i}": 148.0 * (i == 1) for i in range(1, 8)}, command=512,
                    target_system=3, target_component=1, confirmation=0)  # fmt: skip
        heard: list[str] = []
        while fleet.t_s < sent_s + 3.0:
            heard += [m.name for m in station.codec.decode(station._read()) if m.sysid == 3]
        assert "AUTOPILOT_VERSION" not in heard
        late = len(heard)
        assert station.command(3, INJECT_FAILURE, 105, 0) == MavResult.ACCEPTED
        assert late < 20  # what was under way before
        station.hear("HEARTBEAT", 3)
        assert station.command(3, USER_1, 1, 2.0) == MavResult.DENIED


def test_one_direction_can_be_dead(simulation1: Scenario) -> None:
    with (
        running_fleet(simulation1, faulty(simulation1, "2:up.silent", "5:down.silent")) as fleet,
        udp_station(fleet.places[2][0].port) as station,
    ):
        for sysid in (2, 5):
            station.say(
                "PARAM_SET",
                target_system=sysid,
                target_component=1,
                param_id="RTL_ALT",
                param_value=2000.0,
                param_type=6,
            )
        station.say("PARAM_REQUEST_READ", target_system=1, target_component=1, param_id="RTL_ALT", param_index=-1)
        station.hear("PARAM_VALUE", 1)  # so the others have had theirs
        station.hear("HEARTBEAT", 2)
        return_s = [fleet.vehicles[row].autopilot.path_generator.rtl_height_m for row in (1, 4)]
        assert return_s == [15.0, 20.0]
