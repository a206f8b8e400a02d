"""`gcs refly` flies an emulated flight again, to the last bit, beside whatever else the machine does."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import gcs
from gcs.flight.recording.emulation_record import TRUTH, first_difference_s
from gcs.plan.plan_file import load_plan
from gcs.scenario.sources.load import load_scenario
from tests.bridge.flying import step_aside
from tests.kept import GCS


@pytest.fixture(scope="module")
def flown(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short flight in gusts, on a lossy link, by the command."""
    root = tmp_path_factory.mktemp("refly")
    scenario = root / "scenario.json"
    scenario.write_text(step_aside(load_scenario(repo_root / "missions" / "field")).model_dump_json())
    how = ["--seed", "5", "--wind", "2@200", "--gusts", "light", "--fault", "2:loss=0.1", "--speedup", "max"]
    done = subprocess.run(
        [*GCS, "fly", str(scenario), "--sim", *how, "--to", str(root / "flights"), "--json"],
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return Path(json.loads(done.stdout)["folder"])


@pytest.mark.slow
def test_a_flight_is_flown_again_beside_busy_programs(flown: Path) -> None:
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        done = subprocess.run(
            [*GCS, "refly", str(flown), "--speedup", "20", "--json"],
            capture_output=True,
            text=True,
            timeout=300.0,
            check=False,
        )
    finally:
        for one in busy:
            one.kill()
            one.wait()
    assert done.returncode == 0, done.stdout + done.stderr
    said = json.loads(done.stdout)
    assert said["ok"] is True
    assert said["differs_from_s"] is None
    assert (Path(said["folder"]) / TRUTH).read_bytes() == (flown / TRUTH).read_bytes()


@pytest.mark.slow
def test_the_program_flies_what_the_command_has_flown(flown: Path, tmp_path: Path) -> None:
    plan, _ = load_plan(flown / "plan.skein")
    how = gcs.Emulated(speedup="max", seed=5, faults=("2:loss=0.1",), wind="2@200", gusts="light")
    assert first_difference_s(flown, gcs.fly(plan, emulated=how, to=tmp_path).folder) is None
    other = gcs.Emulated(speedup="max", seed=6, faults=("2:loss=0.1",), wind="2@200", gusts="light")
    assert first_difference_s(flown, gcs.fly(plan, emulated=other, to=tmp_path).folder) is not None
