"""All vehicles return at once, flown by the ground station: what was verified is what is flown, from any instant."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.manoeuvres import MotionReference, MotionStart, return_reference
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.mission.returns.rtl_cases import ReturnTo
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

STEP_S = 0.1


@pytest.fixture(scope="module")
def field(plan_of: Callable[[str], Plan]) -> Plan:
    return plan_of("field/scenario.toml")


@pytest.fixture(scope="module")
def returns(field: Plan) -> ReturnPlan:
    return plan_returns(field, Autopilot.PX4)


def flown(plan: Plan, returns: ReturnPlan, t_s: float) -> Array:
    """Places (V, N, 3) of all vehicles that return home at this instant, every `STEP_S`, until they stand."""
    routes = ReturnRoutes(plan)
    state = plan.leader_trajectory.state(np.array([t_s]))
    places = state[:, POSITION] + plan.offsets(np.array([t_s]))[:, 0]
    velocities = state[:, VELOCITY] + plan.offsets(np.array([t_s]), 1)[:, 0]
    courses: list[MotionReference] = []
    for row, home in enumerate(plan.pads_ned_m):
        top_down_m = float(home[2]) - returns.altitudes_m[row]
        course = return_reference(
            MotionStart(places[row], velocities[row], 0.0, t_s), routes, home, top_down_m, returns.speeds, 0.0
        )
        assert course is not None
        courses.append(course)
    looks = np.arange(t_s, max(course.end_s for course in courses), STEP_S)
    return np.array([[course.at(0, float(t))[:3] for t in looks] for course in courses])


def least_m(places: Array) -> float:
    return min(
        float(np.linalg.norm(places[a] - places[b], axis=1).min())
        for a, b in itertools.combinations(range(len(places)), 2)
    )


@pytest.mark.parametrize("t_s", [7.3, 52.0, 96.6, 141.9, 203.2, 260.0])
def test_no_instant_is_worse_than_was_verified(field: Plan, returns: ReturnPlan, t_s: float) -> None:
    assert returns.routed is not None
    assert returns.routed.distance_m >= field.scenario.judge.separation_min_m
    places = flown(field, returns, t_s)
    assert least_m(places) >= returns.routed.distance_m - 0.05
    north, east = places[..., 0], places[..., 1]
    begin = places[:, :1]
    for zone in field.scenario.no_fly:
        outside = outside_m(zone, np.zeros(1), north, east)
        # A plan may lead along an edge; from there returns lead away.
        assert (outside >= np.minimum(outside_m(zone, np.zeros(1), begin[..., 0], begin[..., 1]), 0.5) - 0.02).all()
    cruising = places[..., 2] < begin[..., 2] - 1.0
    above = -places[..., 2] - ground_height_m(field.scenario.terrain, north, east)
    high = cruising & (np.hypot(north - north[:, -1:], east - east[:, -1:]) > 1.0)
    assert above[high].min() >= min(field.scenario.limits.clearance_min_m, float(above[:, 0].min())) - 1e-6


def test_the_worst_return_is_as_near_as_was_verified(field: Plan, returns: ReturnPlan) -> None:
    worst = returns.routed
    assert worst is not None
    assert worst.ends is ReturnTo.HOME
    assert least_m(flown(field, returns, worst.t_s)) == pytest.approx(worst.distance_m, abs=0.1)


def test_a_wall_leaves_no_way_and_is_told(field: Plan) -> None:
    wall = NoFlyZone(polygon_m=((345.0, -500.0), (345.0, 500.0), (355.0, 500.0), (355.0, -500.0)))
    plan = replace(field, scenario=field.scenario.model_copy(update={"no_fly": (wall,)}))
    returns = plan_returns(plan, Autopilot.PX4)
    assert {gap.sysid for gap in returns.no_way} == set(plan.sysids)
    t_s = np.array([gap.from_s for gap in returns.no_way])
    beyond = plan.states(np.clip(t_s + 1.0, plan.t_start_s, plan.t_end_s - 1e-6))[0, :, 0]
    assert (beyond > 340.0).all()
    assert all(gap.to_s == pytest.approx(plan.t_end_s, abs=1.0) for gap in returns.no_way)
