"""What turning with the course costs the planner: the work of all its solves, counted, not timed."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import gcs
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import MeshRound
from tools.bench_maps import FOUR

ZONE_M = "[[100.0, 130.0], [160.0, 110.0], [190.0, 170.0], [140.0, 200.0]]"  # of FOUR


@pytest.mark.slow
def test_four_vehicles_in_the_course_frame_take_about_the_work_of_the_inertial_one(tmp_path: Path) -> None:
    """Iterations of all routes times unknowns. An iteration with the heading among them takes up to twice as long.

    In one place of the zone, the last bit decides how often a plan is refined: 0.6 to 3.5 times the work of the
    inertial frame were counted at eleven places, metres apart. The sum over several places is another matter.
    """
    assert ZONE_M in FOUR
    work = {"inertial": 0, "course": 0}
    for aside_m in (-4.0, -2.0, 0.0, 2.0, 4.0):
        zone_m = str([[north_m + aside_m, east_m - aside_m] for north_m, east_m in ast.literal_eval(ZONE_M)])
        for frame in work:
            file = tmp_path / f"{frame}.toml"
            file.write_text(FOUR.replace("FRAME", frame).replace(ZONE_M, zone_m))
            rounds: list[MeshRound] = []
            plan = make_plan(gcs.load_scenario(file), rounds.append)
            assert gcs.verify(plan).ok
            work[frame] += sum(done.iterations * done.unknowns for done in rounds)
    assert work["course"] < 1.5 * work["inertial"]
