"""A flight at one height above a hill: planned, verified, and looked at with other means."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.physics.states import POSITION
from gcs.plan.planner import make_plan
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.sources.load import load_scenario
from tests.hill import hill_scenario


def test_the_leader_follows_the_ground(tmp_path: Path) -> None:
    plan = make_plan(load_scenario(hill_scenario(tmp_path)))
    report = verify(plan)
    assert report.ok, [str(check) for check in report.failures]
    flown = plan.leader_trajectory.state(np.arange(0.0, plan.flight_s, 0.003))[:, POSITION]
    above_m = -flown[:, 2] - ground_height_m(plan.scenario.terrain, flown[:, 0], flown[:, 1])
    assert np.abs(above_m - 30.0).max() <= 1.0 + 1e-3
    assert np.ptp(flown[:, 2]) > 15.0
    assert all(line.ground is not None and line.limits.height_m == 1.0 for line in plan.lines)
    # As a re-plan may fly: a tenth of a millimetre from the limit, which is decided.
    times = (0.0, *(passage.arrives_s for passage in plan.passages), plan.flight_s)
    near = []
    for line, (begin_s, end_s) in zip(plan.lines, pairwise(times), strict=True):
        off_m = line.off(plan.leader_trajectory.state(np.arange(begin_s, end_s, 1e-3)))[:2]
        beside_m, above_m = (float(off.max()) + 1e-4 - 0.8e-3 for off in off_m)  # less the tolerance of lengths
        near.append(replace(line.limits, corridor_m=beside_m, height_m=above_m))
    report = verify(replace(plan, leg_limits=tuple(near)))
    assert report.ok, [str(check) for check in report.failures]


@pytest.mark.slow
def test_a_ground_that_is_too_rough_is_said_with_the_leg(tmp_path: Path) -> None:
    rough = "[terrain]\nripple = { a = 0.0, b = 2.0, c = 0.0, d = 0.0, e = 0.0, f = 0.0, g = 0.0 }"
    with pytest.raises(Infeasible, match=r"leg 1.*the ground below varies by \d\.\d m within metres.*within 1 m"):
        make_plan(load_scenario(hill_scenario(tmp_path, ("[terrain]", rough))))
