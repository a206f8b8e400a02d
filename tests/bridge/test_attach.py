"""A ground station is killed in the middle of a flight; another process takes the flight up."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import run as gcs
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.scenario.sources.load import load_scenario
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tests.bridge.flying import hop_scenario
from tests.fleets import free_port, running_fleet
from tests.kept import GCS

SPEEDUP = 8.0


@pytest.fixture(scope="module")
def hop_mission(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("hop") / "scenario.json"
    path.write_text(hop_scenario(load_scenario(repo_root / "missions" / "field")).model_dump_json())
    return path


@pytest.fixture(params=["stream"])
def left_alone(hop_mission: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[tuple[World, Path]]:
    """Vehicles in the air whose ground station was killed, and the folder of flights."""
    port = free_port()
    scenario = load_scenario(hop_mission)
    with running_fleet(scenario, WorldOptions(links=(call(port),), speedup=SPEEDUP)) as world:
        line = [*GCS, "fly", str(hop_mission), "--link", f"udpin:127.0.0.1:{port}", "--yes-arm", "--to", str(tmp_path)]
        line += ["--mode", request.param]
        process = subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
        assert process.stdout is not None
        while not (said := process.stdout.readline()).startswith("flying: "):
            assert said, "it ended before it flew"
        while world.airframes.truth[0, 0] < 5.0:
            assert process.poll() is None
        process.kill()
        process.wait()
        process.stdout.close()
        yield world, tmp_path


def attach(*arguments: str) -> dict[str, object]:
    done = subprocess.run(
        [*GCS, "attach", *arguments, "--json"], capture_output=True, text=True, timeout=600.0, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


@pytest.mark.slow
def test_it_is_found_shown_and_flown_to_its_end(left_alone: tuple[World, Path]) -> None:
    world, flights = left_alone
    shown = attach("--to", str(flights))
    assert shown["was"] == "flying"
    assert not world.airframes.landed.any()
    attach("--to", str(flights), "--resume")
    assert world.airframes.landed.all()
    assert np.linalg.norm(world.airframes.truth[0, :2] - [60.0, 20.0]) < 1.0
    nothing = subprocess.run([*GCS, "attach", "--to", str(flights)], capture_output=True, text=True, check=False)
    assert nothing.returncode == 2  # it is over
    assert "unfinished" in nothing.stderr


@pytest.mark.slow
@pytest.mark.parametrize("left_alone", ["mission"], indirect=True)
def test_missions_on_board_go_on_with_the_tracks_that_were_predicted(left_alone: tuple[World, Path]) -> None:
    world, flights = left_alone
    (folder,) = flights.iterdir()
    line = [*GCS, "attach", str(folder), "--resume"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=600.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "WARNING" not in done.stderr
    assert world.airframes.landed.all()
    assert PredictedTracks.load(folder / "predicted.npz").sysids == (1, 2, 3)


@pytest.mark.slow
def test_it_returns(left_alone: tuple[World, Path]) -> None:
    world, flights = left_alone
    attach("--to", str(flights), "--return")
    assert world.airframes.landed.all()
    pads = np.array([[0.0, 0.0], [-4.33, -2.5], [-4.33, 2.5]])
    assert np.abs(world.airframes.truth[:, :2] - pads).max() < 1.0


@pytest.mark.long
def test_it_lands(left_alone: tuple[World, Path]) -> None:
    world, flights = left_alone
    (folder,) = flights.iterdir()
    attach(str(folder), "--land")
    assert world.airframes.landed.all()
    assert 4.0 < world.airframes.truth[0, 0] < 55.0


def test_a_flight_that_is_still_flown_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    book = {
        "format": "skein-flight-1",
        "mission": "hop",
        "plan_hash": "",
        "links": ["udpin:127.0.0.1:1"],
        "mode": "stream",
    }
    book |= {"systems": {}, "follow": False, "step": "flying", "t0_unix_s": 1.0, "pid": os.getppid()}
    folder = tmp_path / "now"
    folder.mkdir()
    (folder / "flight.json").write_text(json.dumps(book))
    assert gcs(["attach", "--to", str(tmp_path)]) == 2
    assert f"still flown by process {os.getppid()}" in capsys.readouterr().err
