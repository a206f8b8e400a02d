"""What turning with the course costs the planner: the work of all its solves, counted, not timed."""

from __future__ import annotations

from pathlib import Path

import pytest

import gcs
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import MeshRound
from tools.bench_maps import FOUR


@pytest.mark.slow
def test_four_vehicles_in_the_course_frame_take_about_the_work_of_the_inertial_one(tmp_path: Path) -> None:
    """Iterations of all routes times unknowns. An iteration with the heading among them takes up to twice as long."""
    work = {}
    for frame in ("inertial", "course"):
        file = tmp_path / f"{frame}.toml"
        file.write_text(FOUR.replace("FRAME", frame))
        rounds: list[MeshRound] = []
        plan = make_plan(gcs.load_scenario(file), rounds.append)
        assert gcs.verify(plan).ok
        work[frame] = sum(done.iterations * done.unknowns for done in rounds)
    assert work["course"] < 1.5 * work["inertial"]
