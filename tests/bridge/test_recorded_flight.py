"""A short flight of emulated vehicles is recorded, and shown, drawn and sent again."""

from __future__ import annotations

import asyncio
import json
import os
import select
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from pymavlink import mavutil

from gcs.autopilots.traits import flight_behaviour
from gcs.cli.main import run
from gcs.flight.monitoring.progress import Event
from gcs.flight.recording.flight_record import FlightRecord
from gcs.flight.recording.flight_state import FlightState, write_flight_state
from gcs.flight.recording.load_recording import load_recording
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.session.linked_fleet import LinkedFleet as GroundFleet
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mavlink import MavCommand
from gcs.physics.states import POSITION
from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from sim_bridge.fleet import Fleet
from tests.fleets import StillFleet, in_their_time
from tests.kept import GCS

HEIGHT_M = 4.0


async def hop_up_and_down(session: VehicleSession, fleet: Fleet) -> None:
    behaviour = flight_behaviour(session.sysid, session.autopilot, session.kind)
    await session.command(MavCommand.DO_SET_MODE, *behaviour.mode_parameters(behaviour.guided))
    await session.command(MavCommand.COMPONENT_ARM_DISARM, 1.0)
    await session.command(MavCommand.NAV_TAKEOFF, *behaviour.takeoff_parameters(HEIGHT_M, 0.0))
    await fleet.until(lambda: fleet.state(session.sysid).position_ned_m[2] < -HEIGHT_M + 0.3)
    await session.command(MavCommand.DO_SET_MODE, *behaviour.mode_parameters(behaviour.land))
    await fleet.until(lambda: not session.armed)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two vehicles go up and down again; the log has their own time."""
    path = tmp_path_factory.mktemp("recorded") / "hop.tlog"

    async def scene() -> None:
        with StillFleet(vehicles=2, one_port=True, seed=5) as vehicles:
            await vehicles.until(lambda: vehicles.t_s > 6.0)
            ground: GroundFleet | None = None

            def time_s() -> float | None:
                known = [s.clock.now_unix_s(asyncio.get_running_loop().time()) for s in ground.sessions.values()]
                return max((t for t in known if t is not None), default=None)

            with FlightRecord(path.parent, pytest.fail, time_s, path.name) as record:

                def note(direction: FrameDirection, frame: bytes) -> None:
                    if ground is not None:
                        record.write_frame(direction, frame)

                async with GroundFleet(f"udpout:{vehicles.places[1][0].address}", on_frame=note).open() as ground:
                    sessions = await ground.vehicles((1, 2), 20.0)
                    for session in sessions.values():
                        for number, period_s in ((33.0, 0.1), (32.0, 0.1), (2.0, 1.0)):
                            await session.command(MavCommand.SET_MESSAGE_INTERVAL, number, 1e6 * period_s)
                    await asyncio.gather(*(hop_up_and_down(session, vehicles) for session in sessions.values()))

    in_their_time(scene())
    return path


def test_other_programs_read_the_log(log: Path) -> None:
    read = mavutil.mavlink_connection(str(log))
    seen: dict[str, int] = {}
    while (message := read.recv_match()) is not None:
        seen[message.get_type()] = seen.get(message.get_type(), 0) + 1
    assert "BAD_DATA" not in seen
    assert seen["GLOBAL_POSITION_INT"] > 100
    assert seen["COMMAND_ACK"] >= 8


def test_the_flight_is_there_again(log: Path) -> None:
    recording = load_recording(log).recording
    assert recording.sysids == (1, 2)
    assert recording.notes == ()
    for track in recording.tracks:
        assert -track.position_ned_m[:, 2].min() == pytest.approx(HEIGHT_M, abs=1.0)
        assert not track.armed[0]
        assert track.armed.any()
    changes = [one.what for one in recording.remarks if one.sysid == 1 and not one.what.startswith("reports")]
    assert changes[-3:] == ["is armed", "is in LAND", "is disarmed"]
    first, last = recording.span_s
    assert 10.0 < last - first < 60.0  # of the vehicles' time


def test_it_is_told_line_by_line(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", str(log), "--speed", "max"]) == 0
    text = capsys.readouterr().out
    assert "vehicle 2 is armed" in text
    lines = [line for line in text.splitlines() if "of 2 vehicles heard" in line]
    assert len(lines) == 11
    stamps = [float(line.split()[2]) for line in text.splitlines() if line.startswith("t = ")]
    assert stamps == sorted(stamps)
    assert any(", 2 armed, height" in line for line in lines)
    assert run(["replay", str(log), "--speed", "max", "--from", "3", "--to", "4.5", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["from_s"], told["to_s"], told["sent"]) == (3.0, 4.5, 0)
    assert [v["sysid"] for v in told["vehicles"]] == [1, 2]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--from", "900"), 2, "--from 900: nothing to show"),
        (("--speed", "0"), 2, "--speed 0: not a speed"),
        (("--speed", "max", "--to-link", "udpout:127.0.0.1:9"), 2, "frames at their times"),
        (("--to-link", "udpin:127.0.0.1:9"), 2, "this link cannot call a ground station"),
        (("--picture", "flight.doc"), 2, "flight.doc is not the name of a picture"),
        (("--picture", "/dev/null/a.png"), 2, "/dev/null/a.png cannot be written"),
    ],
)
def test_what_cannot_be_is_refused(
    log: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], code: int, words: str
) -> None:
    assert run(["replay", str(log), *arguments]) == code
    assert words in capsys.readouterr().err


def test_what_is_no_flight_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", str(tmp_path / "none")]) == 6
    assert run(["replay", str(tmp_path)]) == 6
    assert f"{tmp_path} has no telemetry" in capsys.readouterr().err


def test_pictures_are_drawn_whole_or_not_at_all(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    png, svg = tmp_path / "hop.png", tmp_path / "new" / "hop.svg"
    assert run(["replay", str(log), "--picture", str(png)]) == 0
    assert np.ptp(image.imread(png)[..., :3]) > 0.5
    before = png.read_bytes()
    damaged = tmp_path / "damaged.tlog"
    damaged.write_bytes(b"\xfd" * 50 + log.read_bytes()[200:-9])
    assert run(["replay", str(damaged), "--picture", str(svg)]) == 0
    assert "note: damaged.tlog is damaged" in capsys.readouterr().out
    assert svg.read_text().rstrip().endswith("</svg>")
    damaged.write_bytes(b"nothing")
    assert run(["replay", str(damaged), "--picture", str(png)]) == 6
    assert png.read_bytes() == before
    assert {entry.name for entry in tmp_path.iterdir()} == {"hop.png", "new", "damaged.tlog"}


def test_another_ground_station_hears_what_vehicles_said_in_order_and_in_time(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames: list[bytes] = []
    times: list[float] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        over = threading.Event()

        def listen() -> None:
            while not over.is_set() or select.select([ear], [], [], 0.0)[0]:
                if select.select([ear], [], [], 0.05)[0]:
                    frames.append(ear.recv(400))
                    times.append(time.monotonic())

        listener = threading.Thread(target=listen)
        listener.start()
        link = f"udpout:127.0.0.1:{ear.getsockname()[1]}"
        assert run(["replay", str(log), "--from", "2", "--until", "8", "--speed", "6", "--to-link", link]) == 0
        over.set()
        listener.join()
    recalled = load_recording(log)
    chosen = (recalled.t_s >= 2.0) & (recalled.t_s <= 8.0)
    assert frames == [recalled.frames[n] for n in np.flatnonzero(chosen)]
    assert {frame[5] for frame in frames} == {1, 2}  # what the ground station said stays here
    assert f"{len(frames)} frames sent to {link}" in capsys.readouterr().out
    assert times[-1] - times[0] > 0.8  # six seconds, six times as fast


def test_a_flight_is_shown_beside_its_plan(
    simulation1_plan: Plan, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The telemetry of two of the plan's vehicles, which hop on their pads where the plan has them take off."""
    plan = simulation1_plan
    recalled = load_recording(log)
    t0_unix_s = recalled_start_unix_s(log) - plan.t_start_s
    save_plan(plan, verify(plan), tmp_path / "plan.skein")
    (tmp_path / "telemetry.tlog").write_bytes(log.read_bytes())
    book = FlightState("simulation1", plan.hash, (), {}, "stream", False, "flying", t0_unix_s, os.getpid())
    write_flight_state(tmp_path, book)
    with FlightRecord(tmp_path, pytest.fail, lambda: None, "telemetry-2.tlog") as record:
        event = Event(t0_unix_s, plan.t_start_s + 5.0, 2, "battery low", "A vehicle with a low battery returns")
        record.write_event(event)
    (tmp_path / "telemetry-2.tlog").unlink()
    with (tmp_path / "events.jsonl").open("a") as file:
        file.write('{"unix_s": 17')  # its writer was killed
    assert run(["replay", str(tmp_path), "--speed", "max"]) == 0
    text = capsys.readouterr().out
    assert "vehicle 2 battery low. A vehicle with a low battery returns" in text
    assert "2 of 6 vehicles heard" in text
    assert "position error at most" in text
    recording = load_recording(tmp_path).recording
    assert len(recording.events) == 1
    pads = np.stack([track.position_ned_m[0] for track in recording.tracks[:2]])
    assert pads == pytest.approx(plan.pads_ned_m[:2], abs=0.3)
    planned = recording.planned(np.array([plan.t_start_s + 20.0]))
    assert planned is not None
    assert planned[0][:, 0] == pytest.approx(plan.states(np.array([plan.t_start_s + 20.0]))[:, 0, POSITION])
    assert run(["replay", str(tmp_path), "--picture", str(tmp_path / "beside.png")]) == 0
    assert np.ptp(image.imread(tmp_path / "beside.png")[..., :3]) > 0.5
    assert recalled.recording.plan is None


def recalled_start_unix_s(log: Path) -> float:
    from gcs.flight.recording.tlog import load_tlog

    return float(load_tlog(log).unix_s[0])


@pytest.mark.slow
def test_ctrl_c_ends_it(log: Path) -> None:
    process = subprocess.Popen(
        [*GCS, "replay", str(log), "--speed", "0.01"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("t = ")
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=600.0)
    assert process.returncode == 130
    assert said.splitlines() == ["stopped"]
