"""Six emulated vehicles over real sockets, with pymavlink's mavutil and our own link as ground stations."""

from __future__ import annotations

import asyncio
import json
import math
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from gcs.frames import Origin, from_degE7, geodetic_to_ned, ned_to_geodetic
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.mavlink import CopterMode, EkfFlag, MavCommand, MavResult, MessageId
from gcs.mission.model import Home, MissionItem, VehicleMission
from gcs.scenario.values import si
from gcs.scenario.values.si import local_origin
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.fleet import plain_scenario
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import WorldOptions
from tests.fleets import EPOCH_UNIX_S, free_port, running_fleet, wait_until

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

GUIDED, LAND = CopterMode.GUIDED, CopterMode.LAND
FULL_MASK = 0x800  # position, velocity, acceleration and yaw
STREAM_BEGINS_S = 30.0
TELEMETRY_HZ = {
    MessageId.SYSTEM_TIME: 2.0,
    MessageId.LOCAL_POSITION_NED: 10.0,
    MessageId.GLOBAL_POSITION_INT: 4.0,
    MessageId.EKF_STATUS_REPORT: 2.0,
    MessageId.EXTENDED_SYS_STATE: 4.0,
}


class Station:
    """mavutil as any program would use it."""

    def __init__(self, port: int) -> None:
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
        self.link.mav.heartbeat_send(6, 8, 0, 0, 0) if self.link.clients else None

    def hear(self, name: str, sysid: int | None = None, patience_s: float = 10.0, **fields):
        """The next message of that name, from that vehicle, with those field values."""

        def fits(message) -> bool:
            return sysid in (None, message.get_srcSystem()) and all(
                getattr(message, key) == value for key, value in fields.items()
            )

        for _ in range(100_000):
            message = self.link.recv_match(type=name, blocking=True, timeout=patience_s)
            assert message is not None, f"no {name} from {sysid}"
            if fits(message):
                return message
        raise AssertionError(f"no {name} like {fields}")

    def command(self, sysid: int, command: int, *params: float) -> int:
        self.link.mav.command_long_send(sysid, 1, command, 0, *params, *[0.0] * (7 - len(params)))
        return self.hear("COMMAND_ACK", sysid, command=command).result

    def ask(self, sysid: int) -> None:
        """Without being asked a vehicle like ArduPilot says nothing but HEARTBEAT."""
        self.hear("HEARTBEAT", sysid)
        for number, rate_hz in TELEMETRY_HZ.items():
            assert self.command(sysid, MavCommand.SET_MESSAGE_INTERVAL, number, 1e6 / rate_hz) == MavResult.ACCEPTED

    def armed(self, sysid: int, mode: int, armed: bool) -> None:
        """Wait until the vehicle is armed in a mode, or disarmed in it."""
        while bool(self.hear("HEARTBEAT", sysid, custom_mode=mode).base_mode & 128) != armed:
            pass

    def says(self, sysid: int, start: str) -> str:
        """The next text that begins so."""
        while True:
            text = self.hear("STATUSTEXT", sysid).text
            if text.startswith(start):
                return text

    def ready(self, sysid: int) -> None:
        self.ask(sysid)
        while True:
            flags = self.hear("EKF_STATUS_REPORT", sysid).flags
            if flags & EkfFlag.POS_HORIZ_ABS and not flags & EkfFlag.CONST_POS_MODE:
                return


@pytest.fixture
def station():
    made = []

    def make(port: int) -> Station:
        made.append(Station(port))
        return made[-1]

    yield make
    for each in made:
        each.link.close()


def options(port: int, **kwargs) -> WorldOptions:
    return WorldOptions(links=(call(port),), **kwargs)


def test_six_vehicles_on_one_port_with_clocks_of_their_own(simulation1, station):
    port = free_port()
    with running_fleet(simulation1, options(port, speedup=20.0)) as fleet:
        ground = station(port)
        heard, offsets, ids = set(), {}, {}
        while len(heard) < 6 or len(offsets) < 6:
            message = ground.hear(["HEARTBEAT", "SYSTEM_TIME"])
            if message.get_type() == "HEARTBEAT":
                assert (message.type, message.autopilot) == (2, 3)
                if message.get_srcSystem() not in heard:
                    heard.add(message.get_srcSystem())
                    ground.ask(message.get_srcSystem())
            elif message.time_unix_usec:  # 0 until the receiver has a fix
                assert message.time_unix_usec >= EPOCH_UNIX_S * 1e6
                offsets[message.get_srcSystem()] = message.time_unix_usec - 1000 * message.time_boot_ms
        for sysid in heard:
            ground.link.mav.command_long_send(sysid, 1, MavCommand.REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
            ids[sysid] = bytes(ground.hear("AUTOPILOT_VERSION", sysid).uid2)
        assert heard == set(fleet.ports)
        assert {sender for _, sender in ground.link.clients} == set(fleet.ports.values())
        assert len(set(offsets.values())) == len(set(ids.values())) == 6


def test_arming_is_refused_with_a_reason_until_the_estimator_is_ready(simulation1, station):
    port = free_port()
    with running_fleet(simulation1, options(port, speedup=20.0)):
        ground = station(port)
        ground.hear("HEARTBEAT", 4)
        assert ground.command(4, MavCommand.COMPONENT_ARM_DISARM, 1) == MavResult.FAILED
        assert ground.says(4, "Arm: ")
        ground.ready(4)
        assert ground.command(4, MavCommand.DO_SET_MODE, 1, GUIDED) == MavResult.ACCEPTED
        assert ground.command(4, MavCommand.COMPONENT_ARM_DISARM, 1) == MavResult.ACCEPTED
        assert ground.hear("HOME_POSITION", 4).altitude
        ground.armed(4, GUIDED, True)


def test_takeoff_hover_and_landing(simulation1, station):
    port = free_port()
    with running_fleet(simulation1, options(port, speedup=math.inf)) as fleet:
        ground = station(port)
        ground.ready(2)
        pad = fleet.airframes.truth[1, :3].copy()
        assert ground.command(2, MavCommand.DO_SET_MODE, 1, GUIDED) == MavResult.ACCEPTED
        assert ground.command(2, MavCommand.COMPONENT_ARM_DISARM, 1) == MavResult.ACCEPTED
        assert ground.command(2, MavCommand.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3) == MavResult.ACCEPTED
        ground.hear("EXTENDED_SYS_STATE", 2, landed_state=3)
        ground.hear("EXTENDED_SYS_STATE", 2, landed_state=2)
        place = ground.hear("LOCAL_POSITION_NED", 2)
        assert np.abs([place.x, place.y, place.z + 3.0]).max() < 0.3
        globally = ground.hear("GLOBAL_POSITION_INT", 2)
        origin = Origin(**simulation1.origin.model_dump())
        ned = geodetic_to_ned(from_degE7(globally.lat), from_degE7(globally.lon), globally.alt / 1e3, origin)
        assert np.abs(ned - pad - [0, 0, -3]).max() < 0.3
        assert ground.command(2, MavCommand.DO_SET_MODE, 1, LAND) == MavResult.ACCEPTED
        ground.hear("EXTENDED_SYS_STATE", 2, landed_state=4)
        ground.hear("EXTENDED_SYS_STATE", 2, landed_state=1)
        ground.armed(2, LAND, False)
        assert np.linalg.norm(fleet.airframes.truth[1, :3] - pad) < 0.3


def missions(scenario) -> dict[int, VehicleMission]:
    """A climb, a square of 12 m at its own speed, and a landing, for every vehicle."""
    origin = local_origin(scenario)
    found = {}
    for sysid, pad in zip(si.sysids(scenario), si.pads_ned_m(scenario), strict=True):
        lat, lon, alt = ned_to_geodetic(pad, origin)
        items = [MissionItem(22, 3, (0.0,) * 4, 0, 0, 4.0)]
        for north, east in ((12, 0), (12, 12), (0, 12), (0, 0)):
            lat1, lon1, _ = ned_to_geodetic(pad + np.array([north, east, -4.0]), origin)
            items.append(MissionItem(178, 2, (1.0, 1.0 + 0.1 * sysid, -1.0, 0.0), 0, 0, 0.0))
            items.append(MissionItem(16, 3, (0.0,) * 4, round(float(lat1) * 1e7), round(float(lon1) * 1e7), 4.0))
        items.append(MissionItem(21, 3, (0.0,) * 4, 0, 0, 0.0))
        home = Home(float(lat), float(lon), float(alt))
        found[sysid] = VehicleMission(sysid, home, tuple(items), (None,) * len(items))
    return found


def test_missions_are_stored_as_sent_and_flown_on_board():
    port, scenario = free_port(), plain_scenario(3)

    async def fly() -> None:
        wanted = missions(scenario)
        async with Ground(f"udpin:127.0.0.1:{port}").open() as ground:
            vehicles = await ground.vehicles(wanted, 20.0)
            for sysid, vehicle in vehicles.items():
                await vehicle.upload_mission(wanted[sysid])  # reads back and compares
            reached = []
            vehicles[3].subscribe(
                lambda m: reached.append(m.fields["seq"]) if m.name == "MISSION_ITEM_REACHED" else None
            )
            await vehicles[3].set_message_interval(MessageId.EKF_STATUS_REPORT, 2.0)
            await vehicles[3].wait_for(
                lambda m: m.name == "EKF_STATUS_REPORT" and m.fields["flags"] == 0x33F, 20.0, "readiness"
            )
            await vehicles[3].command(MavCommand.DO_SET_MODE, 1, GUIDED)
            await vehicles[3].command(MavCommand.COMPONENT_ARM_DISARM, 1)
            await vehicles[3].command(MavCommand.MISSION_START)
            await vehicles[3].wait_for(
                lambda m: m.name == "HEARTBEAT" and not m.fields["base_mode"] & 128 and len(reached) > 4,
                120.0,
                "the end of the flight",
            )
            assert reached == [2, 4, 6, 8, 9]

    with running_fleet(scenario, options(port, speedup=math.inf)):
        asyncio.run(fly())


def stream(t_s: np.ndarray) -> np.ndarray:
    """A smooth excursion of 3 m north and east in 20 s, from rest to rest: (N, 3, 2) position to acceleration."""
    s = t_s / 20.0
    return np.stack(
        [
            3.0 * (s**3 * (10 - 15 * s + 6 * s * s)),
            3.0 / 20.0 * (30 * s**2 * (1 - s) ** 2),
            3.0 / 400.0 * (60 * s * (1 - s) * (1 - 2 * s)),
        ],
        axis=-1,
    )


def flown(scenario, speedup: float, station) -> tuple[np.ndarray, np.ndarray]:
    """Simulated times and true states of vehicle 1 (row 0) along a stamped stream; the same start every time."""
    port = free_port()
    fly = options(port, speedup=speedup, record_truth=True, seed=7)
    ground = station(port)
    with running_fleet(scenario, fly, paused=True) as fleet:
        pilot = fleet.vehicles[0].autopilot
        pilot.set_mode(fleet.t_s, GUIDED)
        pilot.arm(fleet.t_s, fleet.airframes.estimate[0])
        pilot.take_off(fleet.t_s, 3.0)
        thread = threading.Thread(target=fleet.run, args=(STREAM_BEGINS_S + 22.0,))
        thread.start()
        ground.ask(1)
        clock = ground.hear("SYSTEM_TIME", 1)
        boot_ms = clock.time_boot_ms - round(clock.time_unix_usec / 1000 - EPOCH_UNIX_S * 1000)
        t_s = np.arange(0.0, 20.02, 0.04)
        stamps_ms = np.rint(1000 * (t_s + STREAM_BEGINS_S)).astype(int) + boot_ms
        sent = 0
        while sent < len(t_s):
            now_ms = ground.hear("LOCAL_POSITION_NED", 1).time_boot_ms
            while sent < len(t_s) and stamps_ms[sent] < now_ms + 700:
                p, v, a = stream(t_s)[sent]
                ground.link.mav.set_position_target_local_ned_send(
                    stamps_ms[sent], 1, 1, 1, FULL_MASK, p, p, -3.0, v, v, 0.0, a, a, 0.0, math.pi / 4, 0.0
                )
                sent += 1
        thread.join(120.0)
        assert not thread.is_alive()
        return fleet.truth.t_s, fleet.truth.state[0]


@pytest.mark.slow  # test_faulty_flights does it with faults
def test_a_stamped_stream_is_flown_the_same_at_any_speedup(simulation1, station):
    t_s, slow = flown(simulation1, 16.0, station)
    fast_t_s, fast = flown(simulation1, math.inf, station)
    np.testing.assert_array_equal(t_s, fast_t_s)
    np.testing.assert_array_equal(slow, fast)
    wanted = stream(np.clip(t_s - STREAM_BEGINS_S, 0.0, 20.0))[:, 0]
    error = slow[:, :2] - si.pads_ned_m(simulation1)[0, :2] - wanted[:, None]
    assert np.abs(error[t_s > STREAM_BEGINS_S]).max() < 0.15


def test_a_vehicle_that_dies_falls_and_says_no_more(simulation1, station):
    port = free_port()
    faults = parse_faults(["5:die@12", "6:silent"], si.sysids(simulation1))
    with running_fleet(simulation1, options(port, speedup=20.0, faults=faults)) as fleet:
        ground = station(port)
        ground.ready(5)
        ground.command(5, MavCommand.DO_SET_MODE, 1, GUIDED)
        ground.command(5, MavCommand.COMPONENT_ARM_DISARM, 1)
        ground.command(5, MavCommand.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3)
        wait_until(lambda: fleet.vehicles[4].dead)
        wait_until(lambda: bool(fleet.airframes.landed[4]))
        heard = set()
        while len(heard) < 4 or fleet.t_s < 25.0:
            heard.add(ground.hear("HEARTBEAT").get_srcSystem())
        assert not fleet.vehicles[4].autopilot.armed
        assert 6 not in heard


def test_the_reject_fault_reaches_the_ground_as_a_refusal(simulation1):
    port = free_port()

    async def try_it() -> None:
        async with Ground(f"udpin:127.0.0.1:{port}").open() as ground:
            vehicles = await ground.vehicles([2], 20.0)
            with pytest.raises(MissionRefused):
                await vehicles[2].upload_mission(missions(simulation1)[2])

    with running_fleet(simulation1, options(port, speedup=20.0, faults=parse_faults(["2:reject-mission"], [2]))):
        asyncio.run(try_it())


def sim_bridge(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", "import sys; from sim_bridge.cli import run; sys.exit(run())", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["end of input", "SIGINT", "SIGTERM"])
def test_the_command_says_when_it_is_ready_and_leaves_the_truth(repo_root, tmp_path, ending):
    truth = tmp_path / "truth.npz"
    process = sim_bridge(
        str(repo_root / "missions" / "simulation1"),
        f"--udp=127.0.0.1:{free_port()}",
        f"--truth={truth}",
        "--until-eof",
        "--speedup=5",
    )
    ready = json.loads(process.stdout.readline())
    assert ready["ready"]
    assert len(set(ready["ports"].values())) == 6
    if ending == "end of input":
        process.stdin.close()
    else:
        process.send_signal(signal.Signals[ending])
    assert process.wait(600.0) == 0
    assert process.stderr.read() == ""
    with np.load(truth) as record:
        vehicles, instants, _ = record["state"].shape
        assert (vehicles, instants) == (6, len(record["t_s"]))
        assert record["armed"].shape == (6, instants)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["missions/nowhere"], 3, "nowhere"),
        (["missions/simulation1", "--speedup", "fast"], 2, "--speedup"),
        (["missions/simulation1", "--fault", "9:silent"], 2, "9:silent"),
        (["missions/simulation1", "--sped", "3"], 2, "--sped"),
        (["missions/simulation1", "--udp", "no.such.host.invalid:1"], 7, "no.such.host.invalid"),
    ],
)
def test_mistakes_are_told_in_one_sentence(repo_root, capfd, monkeypatch, arguments, code, words):
    from sim_bridge.cli import run

    monkeypatch.chdir(repo_root)
    assert run(arguments) == code
    told = capfd.readouterr().err
    assert words in told
    assert "Traceback" not in told
