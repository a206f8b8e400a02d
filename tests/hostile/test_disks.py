"""The disk of the ground station in flight: full, deleted, replaced. The vehicles fly their plan to its end.

The limit of a file's size (RLIMIT_FSIZE) of the running process is set from outside: it stops root too, as a full disk
does.
"""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
from pathlib import Path

import pytest

from gcs.cli.main import run
from tests.hostile.conftest import MakeStill, MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments
from tests.kept import GCS

FULL = "File too large"


def limit_file_size(ground: Ground, size: int) -> None:
    resource.prlimit(ground.process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def gcs(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*GCS, *map(str, arguments)], capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_a_disk_that_is_full_in_flight_and_has_room_again(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        limit_file_size(ground, 4096)
        told = ground.until("telemetry.tlog cannot be written")
        ground.until("landing: t = ")
        limit_file_size(ground, resource.RLIM_INFINITY)
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
    assert f"{FULL}. The flight goes on; its record is incomplete" in told
    assert done.output.count("telemetry.tlog cannot be written") == 1
    assert "the record of this flight is incomplete: telemetry.tlog lacks" in done.output
    (folder,) = tmp_path.iterdir()
    assert f"landed. Telemetry: {folder / 'telemetry.tlog'}" in done.output
    state = json.loads((folder / "flight.json").read_text())
    assert state["step"] == "landed"
    gaps = {gap["file"]: gap for gap in state["incomplete"]}
    assert gaps["telemetry.tlog"]["lost"] > 100
    for command in ("report", "replay"):
        assert run([command, str(folder), *(["--speed", "max"] if command == "replay" else [])]) == 0
        assert "telemetry.tlog lacks" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize("what_is_there_now", ["nothing", "a file"])
def test_a_flight_whose_folder_is_deleted(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, what_is_there_now: str
) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        (folder,) = tmp_path.iterdir()
        shutil.rmtree(folder)
        if what_is_there_now == "a file":
            folder.write_text("")
        ground.until("telemetry.tlog cannot be written: it was deleted")
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
    last = done.output.partition("landed.")[2]
    if what_is_there_now == "nothing":
        assert "there is no" not in done.output
        assert (folder / "plan.skein").is_file()
        assert json.loads((folder / "flight.json").read_text())["step"] == "landed"
        assert f"Telemetry: {folder / 'telemetry.tlog'}" in last
        assert gcs("report", folder).returncode == 0
    else:
        assert f"the record of this flight is lost: its folder {folder} is gone" in done.output
        assert "telemetry.tlog" not in last


@pytest.mark.long
def test_attach_lands_a_flight_whose_folder_was_deleted_and_whose_disk_is_full(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        (folder,) = tmp_path.iterdir()
        shutil.rmtree(folder)
        ground.until("telemetry.tlog is written again")
        ground.process.kill()
        ground.process.wait()
    with Ground("attach", "--land", "--to", tmp_path) as ground:
        limit_file_size(ground, 16)
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
    assert "all vehicles have landed" in done.output


def test_without_room_nothing_is_uploaded(
    still: MakeStill, hop_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, port = still()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (512_000, before[1]))
    try:
        code = run(list(map(str, fly_arguments(hop_file, port, tmp_path / "flights"))))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    said = capsys.readouterr().err
    assert code == 9, said
    assert "no-go: files of this process may grow to 0.5 MB; the record of this flight may need " in said
    assert "Nothing was uploaded" in said
    assert all(vehicle.autopilot.progress.items == () for vehicle in fleet._world.vehicles)
    assert list(tmp_path.glob("flights/*")) == []


@pytest.mark.parametrize("root", ["file/below", "/proc/nothing/here"])
def test_a_folder_that_cannot_be_written_is_a_refusal(
    still: MakeStill, hop_file: Path, tmp_path: Path, root: str, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, port = still()
    (tmp_path / "file").write_text("")
    assert run(list(map(str, fly_arguments(hop_file, port, tmp_path / root)))) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: no-go: the flight's folder cannot be written: ")
    assert "next: name another folder with --to" in said
    assert all(vehicle.autopilot.progress.items == () for vehicle in fleet._world.vehicles)
