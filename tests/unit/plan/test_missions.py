"""Every scenario under missions/ ends in a plan that the verifier passes, with the figures asked of Simulation 1."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.plan.trajectory import Plan
from gcs.plan.verify import verify
from gcs.scenario.load import load_scenario

MISSIONS = Path(__file__).resolve().parents[3] / "missions"
SCENARIOS = sorted(str(file.relative_to(MISSIONS)) for file in MISSIONS.glob("*/*.toml"))


def test_the_missions_are_found() -> None:
    folders = {name.split("/")[0] for name in SCENARIOS}
    assert folders == {file.parent.name for file in MISSIONS.glob("*/README.md")}
    assert {"field", "simulation1", "simulation2", "terminal_weighting"} <= folders


@pytest.mark.parametrize("name", SCENARIOS)
def test_it_is_verified(plan_of: Callable[[str], Plan], name: str) -> None:
    plan = plan_of(name)
    report = verify(plan)
    limits = plan.scenario.limits
    assert report.ok, report.failures
    assert report.clearance_min_m >= limits.clearance_min_m - 1e-3
    assert report.window_error_max_m <= 10e-3
    assert report.terminal_error_m <= 1e-3
    if report.separation_min_m is not None:
        assert report.separation_min_m >= limits.separation_min_m - 1e-3


def test_names_are_folders_and_files(repo_root: Path) -> None:
    """Plans are written under the scenario's name: no two may share it."""
    names = [load_scenario(MISSIONS / name).name for name in SCENARIOS]
    assert len(set(names)) == len(names)
    for name, file in zip(names, SCENARIOS, strict=True):
        folder, stem = file.removesuffix(".toml").split("/")
        assert name == (folder if stem == "scenario" else f"{folder}_{stem}")


def test_field_turns_twice_and_changes_its_height_once(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("field/scenario.toml")
    states = plan.states(np.arange(5.0, plan.flight_s - 5.0, 0.1))[plan.leader]
    course = np.degrees(np.unwrap(np.arctan2(states[:, 4], states[:, 3])))
    right, left = course.max() - course[0], course.max() - course[-1]
    assert 60.0 < right < 120.0
    assert 60.0 < left < 120.0
    assert 180.0 <= plan.flight_s <= 240.0
    height = -states[:, 2]
    assert height[-1] - height[0] > 5.0
    assert np.min(np.diff(height)) > -0.01
    places = plan.offsets(np.array([0.0]))[:, 0, :2]
    nearest = np.sort(np.linalg.norm(places[:, None] - places, axis=-1))[:, 1]
    assert nearest == pytest.approx(np.full(6, 5.0), abs=0.01)
