"""`gcs fly --sim` over real sockets, as a user starts it: processes, files, exit codes, what is said."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil

from gcs.cli.main import run as gcs
from gcs.flight.assessment.judge import load_truth
from gcs.mission.export.setpoint_stream import build_stream
from gcs.plan.plan_file import load_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tests.bridge.flying import step_aside
from tests.fleets import CLOCK, emulated, free_port, running_fleet, still_commands
from tests.kept import GCS


def fly(*arguments: object, timeout_s: float = 300.0, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*GCS, "fly", *map(str, arguments)], capture_output=True, text=True, timeout=timeout_s, check=False, **options
    )


def simulators_running_under(folder: Path) -> list[str]:
    """Command lines of emulators that were given a file in `folder`."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = entry.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if "sim_bridge" in line and str(folder) in line:
            found.append(line)
    return found


@pytest.fixture(scope="session")
def aside(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("aside") / "scenario.json"
    path.write_text(step_aside(load_scenario(repo_root / "missions" / "field")).model_dump_json())
    return path


@pytest.fixture(scope="session", params=["short", pytest.param("simulation1", marks=pytest.mark.slow)])
def flight(
    request: pytest.FixtureRequest, repo_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[subprocess.CompletedProcess[str], Path]:
    """The README's first command, as fast as the machine can, with --json; and a shorter one of two vehicles."""
    root = tmp_path_factory.mktemp("flights")
    mission = repo_root / "missions" / "simulation1"
    if request.param == "short":
        mission = request.getfixturevalue("aside")
    return fly(mission, "--sim", "--speedup", "max", "--json", "--to", root, timeout_s=900.0), root


def test_it_is_planned_uploaded_flown_and_held(
    flight: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    done, root = flight
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads(done.stdout)
    assert report["ok"] is True
    assert (report["mode"], report["navigator"]) == ("stream", None)
    figures = {c["name"]: c for c in report["criteria"]}
    assert figures["position error (RMS)"]["value"] <= 0.15
    assert (
        figures["position error (RMS)"]["value"] > 0.005
    )  # bodies with rotors and an estimator, not points on the plan
    assert figures["separation"]["value"] >= 0.3
    assert figures["clearance above ground"]["value"] > 0.0
    assert figures["arrival time"]["value"] <= 0.5
    assert figures["arrival position"]["value"] <= 0.3
    (folder,) = root.iterdir()
    sysids = sysids_of(folder)
    assert set(report["late_s"]) == {str(sysid) for sysid in sysids}
    assert 0.0 <= report["skew_s"] <= 0.05
    sent = [{"vehicle": sysid, "sent_as": "file", "why": "it reports MAVLink FTP"} for sysid in sysids]
    assert report["missions"] == json.loads((folder / "flight.json").read_text())["missions"] == sent
    assert simulators_running_under(root) == []


def test_a_flight_leaves_a_folder_that_others_can_read(
    flight: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    _, root = flight
    (folder,) = root.iterdir()
    names = {p.name for p in folder.iterdir()}
    wanted = {"plan.skein", "export", "telemetry.tlog", "truth.npz", "report.json", "report.md"}
    assert wanted | {"tracks.png", "map.png", "formation.png"} <= names
    report = (folder / "report.md").read_text()
    assert "| gusts | none |" in report
    assert "To fly it again in this folder, the same to the last bit: `gcs refly .`" in report
    data = json.loads((folder / "report.json").read_text())
    assert all(f"- **{criterion['name']}**: " in report for criterion in data["criteria"])
    assert all((folder / name).stat().st_size > 10_000 for name in ("tracks.png", "map.png", "formation.png"))
    log = mavutil.mavlink_connection(str(folder / "telemetry.tlog"))
    seen: dict[str, int] = {}
    while (message := log.recv_match()) is not None:
        seen[message.get_type()] = seen.get(message.get_type(), 0) + 1
    items = json.loads((folder / "export" / "index.json").read_text())["items"]
    assert min(read_back_items(folder).values()) >= items + 1  # with home
    plan, _ = load_plan(folder / "plan.skein")
    setpoints = len(plan.sysids) * len(build_stream(plan, plan.scenario.mission.setpoint_rate_hz).t_s)
    # A loaded machine leaves out what has grown stale.
    assert 0.95 * setpoints < seen["SET_POSITION_TARGET_LOCAL_NED"] <= setpoints
    assert seen["LOCAL_POSITION_NED"] > len(plan.sysids) * plan.scenario.time.flight_s * 5
    assert "BAD_DATA" not in seen


def test_nothing_arms_before_every_mission_was_read_back(
    flight: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    _, root = flight
    (folder,) = root.iterdir()
    items = json.loads((folder / "export" / "index.json").read_text())["items"]
    before = read_back_items(folder, until_arming=True)
    assert before.keys() == set(sysids_of(folder))
    assert min(before.values()) >= items + 1


def sysids_of(folder: Path) -> tuple[int, ...]:
    return load_plan(folder / "plan.skein")[0].sysids


def read_back_items(folder: Path, *, until_arming: bool = False) -> dict[int, int]:
    """Mission items that came back from each vehicle, in files over MAVLink FTP: ACKs (128) of reads (5) and bursts."""
    log = mavutil.mavlink_connection(str(folder / "telemetry.tlog"))
    octets: dict[int, int] = {}
    while (message := log.recv_match(type=["FILE_TRANSFER_PROTOCOL", "COMMAND_LONG"])) is not None:
        if message.get_type() == "COMMAND_LONG":
            if message.command == 400 and until_arming:
                break
            continue
        opcode, size, asked = message.payload[3], message.payload[4], message.payload[5]
        if message.get_srcSystem() != 255 and opcode == 128 and asked in (5, 15):
            octets[message.get_srcSystem()] = octets.get(message.get_srcSystem(), 0) + size
    return {sysid: (count - 10) // 38 for sysid, count in octets.items()}


@pytest.mark.slow
def test_the_same_flight_at_any_speed_up(aside: Path, tmp_path: Path) -> None:
    errors = {}
    for speedup in ("8", "max"):
        done = fly(aside, "--sim", "--speedup", speedup, "--json", "--to", tmp_path / speedup)
        assert done.returncode == 0, done.stdout + done.stderr
        report = json.loads(done.stdout)
        truth = load_truth(Path(report["folder"]) / "truth.npz")
        t_s = truth.unix_s - report["times"]["t0_unix_s"]
        errors[speedup] = [np.interp(np.arange(-1.0, 12.5, 0.5), t_s, truth.states[0, :, i]) for i in range(3)]
    # Same motion; the noise of the sensors falls on other instants, because T0 is another second.
    assert np.abs(np.subtract(errors["8"], errors["max"])).max() < 0.1


@pytest.mark.long
def test_waypoint_missions_hold_with_the_ideal_navigator_and_are_another_flight_with_the_autopilots_own(
    short_mission: Path, tmp_path: Path
) -> None:
    """Which model flew is said, and seen: the ideal one keeps the times of the plan, a real one does not."""
    scenario = json.loads(short_mission.read_text())
    for vehicle in scenario["formation"]["vehicle"]:  # apart as far as real navigators need
        vehicle["position_m"] = [4.0 * vehicle["position_m"][0], 4.0 * vehicle["position_m"][1], 3.0]
    scenario["start"]["position_m"] = scenario["formation"]["vehicle"][0]["position_m"]
    scenario["end"]["position_m"][0] += 6.0
    scenario["end"]["position_m"][1] += 3.0
    wide = tmp_path / "scenario.json"
    wide.write_text(json.dumps(scenario))
    errors_m, ends = {}, {}
    for nav, chosen in (("ideal", ()), ("own", ("--nav", "own"))):  # this autopilot would be late
        arguments = ("--sim", "--mode", "mission", *chosen, "--speedup", "max", "--json", "--to", tmp_path / nav)
        done = fly(wide, *arguments, timeout_s=900.0)
        report, ends[nav] = json.loads(done.stdout), done.returncode
        assert (report["mode"], report["navigator"]) == ("mission", nav), report
        assert f"mode mission with the {nav} navigator." in (Path(report["folder"]) / "report.md").read_text()
        errors_m[nav] = max(report["position_rms_m"].values())
    assert ends["ideal"] == 0
    assert errors_m["own"] > 2.0 * errors_m["ideal"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        ("3:reject-mission", 8, ("vehicle 3",)),
        ("2:die@10", 9, ("vehicle 2", "lost")),
    ],
)
def test_a_fault_ends_in_one_sentence(
    hop_skein: Path, tmp_path: Path, fault: str, code: int, words: tuple[str, ...]
) -> None:
    done = fly(hop_skein, "--sim", "--fault", fault, "--to", tmp_path)
    assert done.returncode == code, done.stdout + done.stderr
    sentence = next(line for line in done.stderr.splitlines() if line.startswith("error: "))
    assert all(word in sentence for word in words), done.stderr
    assert "next: " in done.stderr
    assert "Traceback" not in done.stderr
    assert simulators_running_under(tmp_path) == []


@pytest.mark.slow
def test_px4_is_flown_as_well(aside: Path, tmp_path: Path) -> None:
    data = json.loads(aside.read_text())
    data["mission"]["autopilot"] = "px4"
    mission = tmp_path / "scenario.json"
    mission.write_text(json.dumps(data))
    done = fly(mission, "--sim", "--speedup", "max", "--json", "--to", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    folder = Path(json.loads(done.stdout)["folder"])
    log = mavutil.mavlink_connection(str(folder / "telemetry.tlog"))
    streamed: set[int] = set()
    obeying: set[int] = set()
    while (message := log.recv_match(type=["SET_POSITION_TARGET_LOCAL_NED", "HEARTBEAT"])) is not None:
        if message.get_type() != "HEARTBEAT":
            streamed.add(message.target_system)
        elif message.custom_mode == 6 << 16:
            obeying.add(message.get_srcSystem())
            assert message.get_srcSystem() in streamed
    assert obeying == {1, 2}


@pytest.mark.slow
def test_ctrl_c_stops_everything(hop_skein: Path, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "5", "--to", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    while "take-off" not in (line := process.stdout.readline()):
        assert line, "it ended before the take-off"
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=600.0)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert simulators_running_under(tmp_path) == []


@pytest.mark.slow
def test_a_killed_ground_station_leaves_no_vehicles_behind(hop_skein: Path, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "5", "--to", str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    while "take-off" not in (line := process.stdout.readline()):
        assert line, "it ended before the take-off"
    assert len(simulators_running_under(tmp_path)) == 1
    process.kill()
    process.wait()
    deadline = time.monotonic() + 120.0
    while simulators_running_under(tmp_path) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert simulators_running_under(tmp_path) == []


@pytest.fixture
def vehicles_out_there(hop: Plan) -> Iterator[tuple[World, str]]:
    """Vehicles that `gcs fly` did not start, and the link they can be flown by."""
    port = free_port()
    with running_fleet(hop.scenario, WorldOptions(links=(call(port),), speedup=10.0)) as fleet:
        yield fleet, f"udpin:127.0.0.1:{port}"


@pytest.fixture
def still(hop: Plan) -> Iterator[tuple[World, str]]:
    """The same; they and commands of this process have virtual time."""
    port = free_port()
    with still_commands(), emulated(hop.scenario, WorldOptions(links=(call(port),)), CLOCK) as world:
        yield world, f"udpin:127.0.0.1:{port}"


@pytest.mark.long
def test_a_link_is_flown_like_the_simulation(
    hop_skein: Path, tmp_path: Path, still: tuple[World, str], capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, link = still
    code = gcs(["fly", str(hop_skein), "--link", link, "--yes-arm", "--to", str(tmp_path)])
    said = capsys.readouterr()
    assert code == 0, said
    assert "landed" in said.out
    assert re.search(r"^ +GO *$", said.out, re.M)
    assert "parameters restored" in said.out
    goal = np.array([60.0, 20.0])
    leader = fleet.airframes.truth[0, :2]
    assert np.linalg.norm(leader - goal) < 0.5


def test_a_silent_vehicle_is_named(
    hop_skein: Path, tmp_path: Path, still: tuple[World, str], capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, link = still
    fleet.injector.add(0, parse_faults(["1:silent"], [1])[1][0], fleet.t_s)
    assert gcs(["fly", str(hop_skein), "--link", link, "--yes-arm", "--to", str(tmp_path)]) == 8
    said = capsys.readouterr().err
    sentence = next(line for line in said.splitlines() if line.startswith("error: "))
    assert "vehicle 1" in sentence
    assert "next: " in said
    assert "Traceback" not in said


def test_a_low_battery_is_a_no_go_and_nothing_is_uploaded(
    hop_skein: Path, tmp_path: Path, still: tuple[World, str], capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, link = still
    fleet.injector.add(1, parse_faults(["2:battery=0.2"], [2])[2][0], fleet.t_s)
    assert gcs(["fly", str(hop_skein), "--link", link, "--yes-arm", "--to", str(tmp_path)]) == 9
    said = capsys.readouterr()
    assert "NO-GO" in said.out
    assert "no-go: vehicle 2: battery: has 20%" in said.err
    (folder,) = tmp_path.iterdir()
    assert f"\nfolder: {folder}\n" in said.err
    assert all(vehicle.autopilot.progress.items == () for vehicle in fleet.vehicles)


def test_without_the_word_nothing_is_uploaded(
    hop_skein: Path,
    tmp_path: Path,
    still: tuple[World, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fleet, link = still
    (tmp_path / "typed").write_text("yes\n")
    with (tmp_path / "typed").open() as typed:
        monkeypatch.setattr("sys.stdin", typed)
        code = gcs(["fly", str(hop_skein), "--link", link, "--to", str(tmp_path / "flights")])
    said = capsys.readouterr()
    assert code == 2, said
    table, asked, after = said.out.partition("This arms and flies 3 vehicles")
    assert asked
    assert re.search(r"^ +GO *$", table, re.M)  # it is seen before an answer
    assert "upload" not in after
    assert "not armed" in said.err
    assert all(vehicle.autopilot.progress.items == () for vehicle in fleet.vehicles)


@pytest.mark.slow
def test_ctrl_c_lands_vehicles_that_are_not_ours(
    hop_skein: Path, tmp_path: Path, vehicles_out_there: tuple[World, str]
) -> None:
    fleet, link = vehicles_out_there
    process = subprocess.Popen(
        [*GCS, "fly", str(hop_skein), "--link", link, "--to", str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdin is not None
    assert process.stdout is not None
    while not (line := process.stdout.readline()).startswith("This arms and flies"):
        assert line, "it ended before it asked"
    process.stdin.write("arm\n")
    process.stdin.flush()
    while not (line := process.stdout.readline()).startswith("flying: "):
        assert line, "it ended before it flew"
    assert not fleet.airframes.landed.any()
    process.send_signal(signal.SIGINT)
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)  # as people do
    said, _ = process.communicate(timeout=600.0)
    assert process.returncode == 130
    assert fleet.airframes.landed.all()
    for sysid in fleet.sysids:
        assert f"vehicle {sysid} still in the air" in said


@pytest.mark.slow
def test_ctrl_c_ends_the_wait_for_vehicles(hop_skein: Path, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [
            *GCS,
            "fly",
            str(hop_skein),
            "--link",
            f"udpin:127.0.0.1:{free_port()}",
            "--yes-arm",
            "--to",
            str(tmp_path),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    while "exported" not in (line := process.stdout.readline()):
        assert line, "it ended before it waited"
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=600.0)
    assert process.returncode == 130
    assert "Traceback" not in said


def test_a_port_in_use_is_said(hop_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        line = ["fly", str(hop_skein), "--link", f"udpin:127.0.0.1:{port}", "--yes-arm", "--to", str(tmp_path)]
        assert gcs(line) == 7
    said = capsys.readouterr().err
    assert str(port) in said
    assert "Traceback" not in said


def test_say_what_to_fly(short_mission: Path) -> None:
    done = fly(short_mission)
    assert done.returncode == 2
    assert "--sim" in done.stderr
