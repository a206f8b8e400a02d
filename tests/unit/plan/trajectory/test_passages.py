"""When the leader is at the points of its route: numbers, names, holds, and the points that are still ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.physics.states import POSITION
from gcs.plan.trajectory.passages import passages, passages_contradiction
from gcs.plan.trajectory.plan import Plan
from tests.unit.plan.routed import with_route

FLIGHT_S = (0.0, 20.0)


@pytest.fixture(scope="module")
def routed(meadow_plan: Plan) -> Plan:
    return with_route(meadow_plan, {5.0: {"name": "gate"}, 9.0: {"hold_s": 2.0}, 14.0: {}})


def test_passages_are_numbered_from_one_and_have_the_names_of_their_points(routed: Plan) -> None:
    assert [str(passage.title) for passage in routed.passages] == ['point 1 ("gate")', "point 2", "point 3"]
    assert [passage.times_s for passage in routed.passages] == [(5.0,), (9.0, 11.0), (14.0,)]
    leader = routed.leader_trajectory.state(np.array(routed.route_s))[:, POSITION]
    np.testing.assert_allclose([passage.position_ned_m for passage in routed.passages], leader, atol=1e-12)


def test_a_plan_that_begins_in_the_air_has_the_last_points_of_the_last_round(routed: Plan) -> None:
    twice = routed.scenario.model_copy(update={"loops": 2})
    rest = passages(twice, (3.0, 8.0))
    assert [(passage.number, passage.point) for passage in rest] == [(5, twice.route[1]), (6, twice.route[2])]
    with pytest.raises(ValueError, match="7 times for 6 route points"):
        passages(twice, tuple(map(float, range(7))))


@pytest.mark.parametrize(
    ("route_s", "in_the_air", "said"),
    [
        ((5.0, 9.0, 14.0), False, ""),
        ((9.0, 14.0), True, ""),
        ((), True, ""),
        ((-1.0, 14.0), True, ""),  # it has hovered there for a second
        ((-1.0, 9.0, 14.0), True, 'the time of point 1 ("gate"), -1 s, is not within its flight'),
        ((-2.5, 14.0), True, "the time of point 2, -2.5 s, is not within its flight"),
        ((9.0, 14.0), False, "it has 2 times for 3 route points"),
        ((1.0, 5.0, 9.0, 14.0), True, "it has 4 times for 3 route points"),
        ((5.0, 9.0, 10.5), False, "the leader would be at point 3 before it leaves point 2"),
        ((9.0, 5.0, 14.0), False, 'the leader would be at point 2 before it leaves point 1 ("gate")'),
        ((5.0, 9.0, 20.5), False, "the time of point 3, 20.5 s, is not within its flight"),
        ((5.0, float("nan"), 14.0), False, "the time of point 2, nan s, is not within its flight"),
    ],
)
def test_times_that_no_planner_makes_are_named(
    routed: Plan, route_s: tuple[float, ...], in_the_air: bool, said: str
) -> None:
    assert passages_contradiction(routed.scenario, route_s, FLIGHT_S, in_the_air=in_the_air) == said


def test_the_hash_has_the_times_of_a_route_and_only_those(meadow_plan: Plan, routed: Plan) -> None:
    assert replace(meadow_plan, route_s=()).hash == meadow_plan.hash
    assert replace(routed, route_s=(5.0, 9.0, 15.0)).hash != routed.hash
