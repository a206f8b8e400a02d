"""The surveying mission, as its README flies it: along all passes and back to the pads."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from tests.kept import GCS


@pytest.fixture(scope="module")
def survey(plan_of: Callable[[str], Plan], tmp_path_factory: pytest.TempPathFactory) -> Path:
    plan = plan_of("survey/scenario.toml")
    path = tmp_path_factory.mktemp("survey") / "survey.skein"
    save_plan(plan, verify(plan), path)
    return path


@pytest.mark.parametrize(
    "mode", [pytest.param("mission", marks=pytest.mark.slow), pytest.param("stream", marks=pytest.mark.long)]
)
def test_every_pass_is_flown(survey: Path, mode: str, tmp_path: Path) -> None:
    arguments = ["fly", str(survey), "--sim", "--speedup", "max", "--mode", mode, "--json", "--to", str(tmp_path)]
    done = subprocess.run([*GCS, *arguments], capture_output=True, text=True, timeout=900.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads(done.stdout)
    assert (report["ok"], report["mode"]) == (True, mode)
    figures = {criterion["name"]: criterion for criterion in report["criteria"]}
    assert 0.1 < figures["route points"]["value"] <= 5.0  # bodies with GNSS, not points on the plan
    assert figures["arrival position"]["value"] <= 5.0
