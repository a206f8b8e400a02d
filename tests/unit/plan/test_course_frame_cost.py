"""What turning with the course costs the planner: the work of all its solves, counted, not timed."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import gcs
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import MeshRound
from gcs.scenario.schema.scenario import Scenario
from tests.kept import kept

FOUR = """
schema_version = 1
name = "four"
title = "four quadrotors past a zone"
vehicle_type = "quad500"
origin = { lat_deg = 47.39, lon_deg = 8.54, alt_amsl_m = 0.0 }
time = { flight_s = 120.0 }
start = { position_m = [0.0, 0.0, 15.0], roll_pitch_yaw_deg = [0.0, 0.0, 45.0] }
end = { position_m = [282.84, 282.84, 15.0], roll_pitch_yaw_deg = [0.0, 0.0, 45.0] }
no_fly = [{ polygon_m = [[100.0, 130.0], [160.0, 110.0], [190.0, 170.0], [140.0, 200.0]] }]
[limits]
north_m = [-140.0, 410.0]
east_m = [-130.0, 420.0]
height_m = [0.0, 40.0]
clearance_min_m = 5.0
separation_min_m = 4.0
[formation]
count = 4
start_shape = "line"
shape = [
    { name = "line", generator = "line", spacing_m = 8.0, heading_deg = 45.0 },
    { name = "column", generator = "column", spacing_m = 8.0, heading_deg = 45.0 },
]
change = [{ kind = "reshape", to = "column", at_s = 30.0 }]
change_speed_mps = 2.0
change_accel_mps2 = 1.0
frame = "FRAME"
"""
ZONE_M = "[[100.0, 130.0], [160.0, 110.0], [190.0, 170.0], [140.0, 200.0]]"  # of FOUR


def work_of(scenario: Scenario) -> int:
    """Iterations of all routes times unknowns, for a plan that holds."""
    rounds: list[MeshRound] = []
    assert gcs.verify(make_plan(scenario, rounds.append)).ok
    return sum(done.iterations * done.unknowns for done in rounds)


@pytest.mark.parametrize(
    ("aside_m", "most"),
    [
        pytest.param((0.0,), 3.5, marks=pytest.mark.slow, id="one place"),
        pytest.param((-4.0, -2.0, 0.0, 2.0, 4.0), 1.5, marks=pytest.mark.long, id="five places"),
    ],
)
def test_four_vehicles_in_the_course_frame_take_about_the_work_of_the_inertial_one(
    tmp_path: Path, aside_m: tuple[float, ...], most: float
) -> None:
    """Counted by `work_of`. An iteration with the heading among them takes up to twice as long.

    In one place of the zone, the last bit decides how often a plan is refined: 0.6 to 3.5 times the work of the
    inertial frame were counted at eleven places, metres apart. The sum over several places is another matter.
    """
    assert ZONE_M in FOUR
    work = {"inertial": 0, "course": 0}
    for off_m in aside_m:
        zone_m = str([[north_m + off_m, east_m - off_m] for north_m, east_m in ast.literal_eval(ZONE_M)])
        for frame in work:
            file = tmp_path / f"{frame}.toml"
            file.write_text(FOUR.replace("FRAME", frame).replace(ZONE_M, zone_m))
            work[frame] += kept(work_of)(gcs.load_scenario(file))
    assert work["course"] < most * work["inertial"]
