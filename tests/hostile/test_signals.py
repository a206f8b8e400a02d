"""Signals at every step of a flight: what is in the air lands, parameters are restored, the exit code tells it."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest

from sim_bridge.sim.world import World
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments

HUP, INT, TERM = signal.SIGHUP, signal.SIGINT, signal.SIGTERM
IN_BACKGROUND = ("sh", "-c", 'trap "" INT; exec "$@"', "sh")  # as `&` in a script starts it
SLOW = pytest.mark.long


def processes_with(words: str) -> list[str]:
    """Return the command lines with these words."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            line = entry.read_bytes().replace(b"\0", b" ").decode(errors="replace")
            if words in line:
                found.append(line)
    return found


def parameters(world: World) -> set[tuple[int, str, float]]:
    """Return all parameters of all vehicles, but the lengths of what is on board."""
    every = [(n, vehicle._params._values) for n, vehicle in enumerate(world.vehicles)]
    return {(n, key, value) for n, values in every for key, value in values.items() if not key.endswith("_TOTAL")}


def catches(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    status = Path(f"/proc/{pid}/status").read_text()
    mask = next(line.split()[1] for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(mask, 16) >> number - 1 & 1)


@pytest.mark.parametrize(
    ("step", "number"),
    [
        pytest.param("waiting for readiness", TERM, marks=SLOW),
        pytest.param("upload and read back", HUP, marks=SLOW),
        pytest.param("upload and read back", TERM, marks=SLOW),
        pytest.param("take-off", HUP, marks=SLOW),
        pytest.param("take-off", TERM, marks=SLOW),
        pytest.param("flying", HUP, marks=SLOW),
        pytest.param("flying", TERM, marks=pytest.mark.slow),
        pytest.param("landing", HUP, marks=SLOW),
        pytest.param("landing", TERM, marks=SLOW),
    ],
)
def test_a_signal_lands_what_is_in_the_air(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, step: str, number: signal.Signals
) -> None:
    world, port = vehicles()
    before = parameters(world)
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until(step)
        ground.signal(number)
        ground.signal(number)  # closing a terminal sends two
        done = ground.ended()
    assert done.code == 128 + number, done.output
    assert done.output.splitlines()[-1] == "stopped"
    assert "Traceback" not in done.output
    assert all_down(world)
    assert parameters(world) ^ before == set()


@SLOW
def test_a_job_in_the_background_of_a_script_lands_at_sigint(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path), by=IN_BACKGROUND) as ground:
        ground.until("flying")
        ground.signal(INT)
        done = ground.ended()
    assert done.code == 130, done.output
    assert all_down(world)


@SLOW
def test_under_nohup_the_flight_outlives_its_terminal(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path), by=("nohup",)) as ground:
        for step in ("waiting for readiness", "take-off", "flying", "landing"):
            ground.until(step)
            ground.signal(HUP)
        done = ground.ended()
    assert done.code == 0, done.output
    assert "landed. Telemetry: " in done.output
    assert all_down(world)


@SLOW
@pytest.mark.parametrize("number", [TERM, HUP])
def test_attach_lands_at_a_signal_too(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, number: signal.Signals
) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        ground.process.kill()
        ground.process.wait()
    with Ground("attach", "--resume", "--to", tmp_path) as ground:
        ground.until("nearest plan time")
        ground.signal(number)
        done = ground.ended()
    assert done.code == 128 + number, done.output
    if not all_down(world):  # it was stopped before it had taken the vehicles up: they are as they were
        with Ground("attach", "--land", "--to", tmp_path) as ground:
            assert ground.ended().code == 0
    assert all_down(world)


@SLOW
def test_emulated_vehicles_land_first_and_end_with_the_flight(hop_file: Path, tmp_path: Path) -> None:
    """The signal goes to the whole group of processes, as a terminal's does."""
    with Ground("fly", hop_file, "--sim", "--to", tmp_path, start_new_session=True) as ground:
        ground.until("flying")
        os.killpg(ground.process.pid, HUP)
        done = ground.ended()
    assert done.code == 128 + HUP, done.output
    assert done.output.splitlines()[-1] == "stopped"
    (folder,) = tmp_path.iterdir()
    assert (folder / "truth.npz").is_file()  # the simulator ended by itself
    assert processes_with(str(tmp_path)) == []


def test_a_plan_in_the_making_leaves_no_file(repo_root: Path, tmp_path: Path) -> None:
    mission = repo_root / "missions" / "simulation1"
    with Ground("plan", mission, "--to", tmp_path / "plan.skein", env={"TMPDIR": tmp_path}) as ground:
        while not catches(ground.process.pid, TERM):
            time.sleep(0.02)
        ground.signal(TERM)
        done = ground.ended()
    assert done.code == 128 + TERM, done.output
    assert done.output == "stopped"
    assert list(tmp_path.iterdir()) == []


@SLOW
def test_an_upload_is_rolled_back(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    before = parameters(world)
    with Ground("upload", hop_file, "--link", f"udpin:127.0.0.1:{port}", "--to", tmp_path) as ground:
        ground.until("has its mission")
        ground.signal(TERM)
        done = ground.ended()
    assert done.code == 128 + TERM, done.output
    assert all(vehicle.autopilot.progress.items == () for vehicle in world.vehicles)
    assert parameters(world) ^ before == set()
