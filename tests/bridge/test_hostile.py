"""Hostile frames, 100,000 in every run and a million on demand, bring no vehicle down and change nothing it holds."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from gcs.link.protocols.mission.item_messages import with_home
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MavCommand, MavResult, MissionType
from gcs.mission.model import Home, MissionItem
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from sim_bridge.personality import by_name
from sim_bridge.protocol.endpoint_address import EndpointKind, EndpointSpec
from sim_bridge.protocol.switchboard import Arrival
from sim_bridge.sim.traffic import Traffic
from sim_bridge.sim.world import World, WorldOptions
from tests.bridge.hostile import Hostility, checksums
from tests.bridge.test_links import udp_station
from tests.fleets import EPOCH_UNIX_S, running_fleet

FRAMES, MANY = 5_000, 500_000  # for each autopilot
SEEDS = {"ardupilot": 20_250_101, "px4": 20_250_102}
CHUNKS_PER_STEP = 120  # of four and a half frames each
HELD = (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)


class Wire:
    """Stands in for the switchboard: what it is given comes in, what goes out is thrown away."""

    def __init__(self, vehicles: int) -> None:
        self.rows = [tuple(range(vehicles))]
        self.coming: list[bytes] = []
        self.sent = 0

    def receive(self, _timeout_s: float, _now_s: float) -> Iterator[Arrival]:
        coming, self.coming = self.coming, []
        for data in coming:
            yield Arrival(0, data, "somebody")

    def heard(self, *_: object) -> None:
        pass

    def put(self, _row: int, frames: Sequence[bytes]) -> None:
        self.sent += len(frames)

    def flush(self, _now_s: float) -> None:
        pass

    def close(self) -> None:
        pass


def mission(scenario: Scenario) -> tuple[MissionItem, ...]:
    origin = scenario.origin
    lat, lon = round(origin.lat_deg * 1e7), round(origin.lon_deg * 1e7)
    return (
        MissionItem(22, 3, (0.0,) * 4, lat, lon, 4.0),
        *(MissionItem(16, 3, (0.0,) * 4, lat + 100 * n, lon, 5.0) for n in range(1, 10)),
        MissionItem(21, 3, (0.0,) * 4, lat, lon, 0.0),
    )


def upload(wire: Wire, fleet: World, sysid: int, items: Sequence[MissionItem]) -> None:
    """In one go: a vehicle asks for what it has not been sent, and is sent it."""
    codec = Codec(*GROUND)
    to = {"target_system": sysid, "target_component": 1, "mission_type": 0}
    wire.coming.append(codec.encode(Message("MISSION_COUNT", {**to, "count": len(items)})))
    for seq, item in enumerate(items):
        p1, p2, p3, p4 = item.params
        wire.coming.append(
            codec.encode(
                Message(
                    "MISSION_ITEM_INT",
                    {**to, "seq": seq, "frame": item.frame, "command": item.command, "current": 0, "autocontinue": 1}
                    | {"param1": p1, "param2": p2, "param3": p3, "param4": p4}
                    | {"x": item.lat_degE7, "y": item.lon_degE7, "z": item.alt_m},
                )
            )
        )
    fleet.step()


def held(fleet: World) -> list[tuple[tuple[MissionItem, ...], ...]]:
    """Everything that vehicles hold, home apart, which moves with them."""
    shelves = [vehicle.store for vehicle in fleet.vehicles]
    return [tuple(shelf.items(kind)[kind == MissionType.MISSION :] for kind in HELD) for shelf in shelves]


@pytest.fixture(scope="module")
def field(repo_root) -> Scenario:
    return load_scenario(repo_root / "missions" / "field")


@pytest.mark.parametrize("frames", [FRAMES, pytest.param(MANY, marks=pytest.mark.long)])
@pytest.mark.parametrize("autopilot", SEEDS)
def test_hostile_frames_change_nothing(field: Scenario, autopilot: str, frames: int, capsys) -> None:
    options = WorldOptions(
        links=[EndpointSpec(EndpointKind.UDP_IN, shared=True)],
        seed=1,
        personality=by_name(autopilot),
        epoch_unix_s=EPOCH_UNIX_S,
    )
    home = Home(field.origin.lat_deg, field.origin.lon_deg, field.origin.alt_amsl_m)
    items = mission(field)
    with World(field, options) as fleet:
        wire = Wire(len(fleet.sysids))
        fleet._board.close()
        fleet._board = wire
        fleet.traffic = Traffic(wire, fleet.vehicles, fleet.injector)
        for sysid in fleet.sysids:
            upload(wire, fleet, sysid, with_home(items, home) if autopilot == "ardupilot" else items)
        while fleet.t_s < 6.0:
            fleet.step()
        before = held(fleet)
        assert [len(each[0]) for each in before] == [len(items) - (autopilot == "px4")] * 6
        for row in (1, 2, 3):  # some stand, some fly
            vehicle = fleet.vehicles[row]
            vehicle.autopilot.arm(fleet.t_s, fleet.airframes.estimate[row])
            vehicle.autopilot.start_mission(fleet.t_s, fleet.airframes.estimate[row])
        while fleet.t_s < 25.0:
            fleet.step()
        assert sum(vehicle.autopilot.flying for vehicle in fleet.vehicles) == 3
        hostility = Hostility(SEEDS[autopilot], fleet.sysids, len(items) + 1)
        began_s = time.perf_counter()
        for fed, chunk in enumerate(hostility.chunks(frames)):
            wire.coming.append(chunk)
            if fed % CHUNKS_PER_STEP == 0:
                fleet.step()
        fleet.step()
        took_s = time.perf_counter() - began_s
        assert held(fleet) == before
        assert np.isfinite(fleet.airframes.truth).all()
        assert np.isfinite(fleet.airframes.estimate).all()
        codec, heard = Codec(*GROUND), wire.sent
        fields = {"target_system": 1, "target_component": 1, "command": MavCommand.REQUEST_MESSAGE, "confirmation": 0}
        params = {f"param{i}": 148.0 * (i == 1) for i in range(1, 8)}
        answers = fleet.vehicles[0].receive(Message("COMMAND_LONG", fields | params, *GROUND), time.monotonic())
        assert {answer.name for answer in answers} == {"COMMAND_ACK", "AUTOPILOT_VERSION"}
        assert all(codec.encode(answer) for answer in answers)
    with capsys.disabled():
        kinds = ", ".join(f"{count:,} {kind}" for kind, count in hostility.counts.items())
        print(
            f"\n{autopilot}: {sum(hostility.counts.values()):,} hostile frames (seed {hostility.seed}): {kinds}; "
            f"{heard:,} frames in answer; {took_s:.0f} s, to {fleet.t_s:.0f} s of flight"
        )
    assert sum(hostility.counts.values()) >= frames


def test_right_frames_are_right(simulation1: Scenario) -> None:
    """Or the million would only ever prove the checksum."""
    hostility = Hostility(3, (1, 2), 5)
    frames = hostility._frames(2000)
    codec = Codec(1, 1)
    assert sum(len(codec.decode(frame)) for frame in frames) == 2000
    frame = Codec(255, 190).encode(Message("MISSION_COUNT", {"target_system": 1, "target_component": 1, "count": 3}))
    row = np.frombuffer(frame, dtype=np.uint8)[None, :]
    crc = int(checksums(row[:, 1:-2], 221)[0])
    assert (crc & 0xFF, crc >> 8) == (frame[-2], frame[-1])


def test_a_flood_on_one_port_does_not_drown_the_others(simulation1: Scenario) -> None:
    options = WorldOptions(links=[EndpointSpec(EndpointKind.UDP_IN)], speedup=math.inf)
    noise = np.random.default_rng(5).bytes(1200)
    with (
        running_fleet(simulation1, options) as fleet,
        udp_station(fleet.places[2][0].port) as station,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flooder,
    ):
        for _ in range(4000):
            flooder.sendto(noise, ("127.0.0.1", fleet.places[1][0].port))
        assert station.command(2, MavCommand.REQUEST_MESSAGE, 148) == MavResult.ACCEPTED
        began_s = fleet.t_s
        station.hear("HEARTBEAT", 2)
        station.hear("HEARTBEAT", 2)
        assert fleet.t_s > began_s
