"""Plans keep out of polygons, and of zones that move into the way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.mission.returns.fence_rally import build_fence
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.problems import meadow

WALL: dict[str, Any] = {
    "polygon_m": [[18.0, -3.0], [24.0, -3.0], [24.0, 15.0], [30.0, 15.0], [30.0, 18.0], [18.0, 18.0]]
}
# It crosses the straight way just when the formation would be there, and is gone before and after.
CROSSING: dict[str, Any] = {
    "north_m": 21.0,
    "east_m": 40.0,
    "radius_m": 5.0,
    "moves": [[7.0, 0.0, 0.0], [13.0, 0.0, -64.0]],
}


def with_zone(scenario: Scenario, zone: dict[str, Any]) -> Scenario:
    return meadow(
        scenario,
        limits={"north_m": [-20.0, 80.0], "east_m": [-40.0, 60.0], "separation_min_m": 0.4},
        no_fly=[zone],
    )


@pytest.mark.parametrize(
    "zone", [WALL, pytest.param(CROSSING, marks=pytest.mark.slow)], ids=["a wall with a corner", "a disk that crosses"]
)
def test_a_plan_keeps_out_of_a_zone_that_the_straight_one_enters(simulation1: Scenario, zone: dict[str, Any]) -> None:
    scenario = with_zone(simulation1, zone)
    plan = make_plan(scenario)
    report = verify(plan)
    assert report.ok, report.failures
    straight = make_plan(scenario.model_copy(update={"no_fly": ()}))
    failures = verify(replace(straight, scenario=scenario)).failures
    assert {check.name for check in failures} == {"no-fly zone 1"}
    assert plan.objective > straight.objective


def test_a_zone_that_has_not_come_yet_or_is_gone_is_no_obstacle(simulation1: Scenario) -> None:
    late = with_zone(simulation1, CROSSING | {"moves": [[500.0, 0.0, 0.0], [506.0, 0.0, -64.0]]})
    free = make_plan(late.model_copy(update={"no_fly": ()}))
    assert _track(make_plan(late)) == pytest.approx(_track(free), abs=1e-3)


def _track(plan: Plan) -> Array:
    return plan.states(np.linspace(0.0, 19.9, 50))[plan.leader, :, :3]


@pytest.mark.slow
def test_the_fence_keeps_a_polygon_where_there_is_room_and_no_moving_zone(simulation1: Scenario) -> None:
    walled, crossed = (build_fence(make_plan(with_zone(simulation1, zone))) for zone in (WALL, CROSSING))
    (around, *closed) = walled.geofence.polygons
    assert around.inclusion
    assert closed and not any(polygon.inclusion for polygon in closed)
    assert 0.25 * walled.zones[0].area_m2 < walled.zones[0].fence_area_m2 < walled.zones[0].area_m2
    assert len(crossed.geofence.polygons) == 1 and not crossed.geofence.circles
    assert crossed.zones[0].fence_area_m2 == 0.0
