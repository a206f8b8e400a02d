"""Separations while the shape moves, against the distance of closest approach on straight ways."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.trajectory.plan import Plan
from tests.unit.plan.problems import changed
from tests.unit.plan.verification.constraints.even_flights import assert_margin, check_of, even


def in_motion(plan: Plan, start_ned_m: list[list[float]], velocity_mps: list[list[float]]) -> Plan:
    """Every vehicle evenly on a straight line within the shape: places at T0, and velocities."""
    c = np.zeros((2, 1, 2))
    c[0, 0], c[1, 0] = (0.0, 1.0), (1.0, plan.t_start_s)
    tables = np.array([start_ned_m, velocity_mps])
    shape = Shape(PPoly(c, np.array([plan.t_start_s, plan.t_end_s])), tables)
    return replace(even(plan, (0.0, 1.0, -4.0), (1.0, 0.0, 0.0)), shape=shape)


def assert_separation(plan: Plan, least_m: float) -> None:
    assert_margin(check_of(plan, "separation"), least_m - plan.scenario.limits.separation_min_m)


@pytest.mark.parametrize("aside_m", [0.2, 0.5, 3.0])
def test_two_that_pass_each_other(meadow_plan: Plan, aside_m: float) -> None:
    """The third vehicle flies away; the second crosses beside the leader, along a slanted line."""
    start = [[0.0, 0.0, 0.0], [-10.0, aside_m, -10.0], [0.0, 90.0, 0.0]]
    plan = in_motion(meadow_plan, start, [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    assert plan.leader == 0
    assert_separation(plan, aside_m)
    assert check_of(plan, "separation").t_s == pytest.approx(10.0, abs=0.2)


def test_two_that_both_move_are_nearest_by_their_relative_motion(meadow_plan: Plan) -> None:
    first, second = np.array([-9.0, 6.0, 1.0]), np.array([8.0, 7.0, 2.0])
    v_first, v_second = np.array([0.7, 0.3, -0.1]), np.array([-0.5, 0.2, 0.1])
    start = [[0.0, -90.0, 0.0], first.tolist(), second.tolist()]
    plan = in_motion(meadow_plan, start, [[0.0, 0.0, 0.0], v_first.tolist(), v_second.tolist()])
    apart, way = second - first, v_second - v_first
    least_m = float(np.linalg.norm(np.cross(apart, way)) / np.linalg.norm(way))
    assert 0.0 < -apart @ way / (way @ way) < plan.flight_s
    assert_separation(plan, least_m)


def test_a_hundred_and_one_of_whom_one_flies_through_the_rows(meadow_plan: Plan) -> None:
    """A grid of 10 x 10, 3 m apart, and one that flies between two rows, 1.2 m from the nearer one."""
    count = 101
    side = [3.0 * number for number in range(10)]
    grid = [[n, e, 0.0] for n in side for e in side]
    vehicles = [{"sysid": i + 1, "position_m": [n, e, 3.0]} for i, (n, e, _) in enumerate(grid)]
    vehicles.append({"sysid": count, "position_m": [-30.0, 10.2, 3.0]})
    scenario = changed(meadow_plan.scenario, formation={"vehicle": vehicles, "leader": 1})
    plan = in_motion(
        replace(meadow_plan, scenario=scenario, shape=rigid(np.zeros((count, 3)), 0.0, 1.0)),
        [*grid, [-30.0, 10.2, 0.0]],
        [[0.0, 0.0, 0.0]] * 100 + [[3.0, 0.0, 0.0]],
    )
    assert_separation(plan, 1.2)
