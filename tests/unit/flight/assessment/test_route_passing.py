"""How vehicles passed route points, in closed form: the plan itself, a flight aside of it, a late one, a hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.flight.assessment.criterion import CriterionName
from gcs.flight.assessment.route_passing import points_passed
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array
from tests.unit.flight.assessment.test_judge import judged, named
from tests.unit.plan.routed import with_route

AT_S = (60.0, 130.0)


@pytest.fixture(scope="module")
def routed(simulation1_plan: Plan) -> Plan:
    return with_route(simulation1_plan, {60.0: {"name": "gate"}, 130.0: {"radius_m": 20.0}})


def flown(plan: Plan, late_s: float = 0.0, aside_ned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    return np.asarray(plan.states(np.arange(0.0, 270.0, 0.1) - late_s)[..., POSITION] + np.array(aside_ned_m))


def test_a_flight_as_planned_passes_every_point(routed: Plan) -> None:
    criterion = named(judged(routed), CriterionName.ROUTE_POINTS)
    assert criterion.ok
    assert criterion.value < 0.01
    assert criterion.limit == routed.scenario.judge.arrival_position_m
    assert CriterionName.ROUTE_POINTS not in {c.name for c in judged(replace(routed, route_s=())).criteria}


def test_a_vehicle_that_missed_a_point_fails_the_flight(routed: Plan) -> None:
    def change(times_s: Array, states: Array) -> None:
        states[3, np.abs(times_s - 130.0) <= 20.0, 2] -= 8.0

    verdict = judged(routed, change)
    criterion = named(verdict, CriterionName.ROUTE_POINTS)
    assert not criterion.ok
    assert criterion.value == pytest.approx(8.0, abs=0.2)
    assert (criterion.sysid, criterion.t_s) == (routed.sysids[3], 130.0)


@pytest.mark.parametrize("late_s", [-1.3, 0.0, 2.1])
def test_lateness_and_distance_are_those_of_the_nearest_point(routed: Plan, late_s: float) -> None:
    t_s = np.arange(0.0, 270.0, 0.1)
    sysid = routed.sysids[1]
    passed = points_passed(routed, {sysid: (t_s, flown(routed, late_s, (0.0, 0.0, 2.5))[1])})
    for each, due_s in zip(passed, AT_S, strict=True):
        assert each.late_s[sysid] == pytest.approx(late_s, abs=0.15)
        assert each.distance_m[sysid] == pytest.approx(2.5, abs=0.05)
        assert each.passage.arrives_s == due_s


def test_what_is_flown_long_after_does_not_count(routed: Plan) -> None:
    t_s, leader = np.arange(0.0, 270.0, 0.1), routed.sysids[routed.leader]
    (first, _) = points_passed(routed, {leader: (t_s, flown(routed, 10.0)[routed.leader])})
    places = routed.leader_trajectory.state(np.array([53.0, 60.0]))[:, POSITION]
    assert first.distance_m[leader] == pytest.approx(float(np.linalg.norm(places[1] - places[0])), abs=0.05)
    (gone, _) = points_passed(routed, {leader: (t_s[:100], flown(routed)[routed.leader, :100])})
    assert np.isnan(gone.distance_m[leader])
    assert gone.farthest is None
    assert gone.data(leader)["leader_late_s"] is None


def test_at_a_hold_lateness_is_that_of_the_arrival(simulation1_plan: Plan) -> None:
    joints = np.array([-60.0, 0.0, 50.0, 60.0, 400.0])
    state = np.zeros((2, 4, 12))
    state[0, :, 0], state[1, :, 0], state[1, :, 2] = (0.0, 2.0, 0.0, 2.0), (0.0, 0.0, 100.0, 100.0), -60.0
    motion = Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 4, 4)), joints))
    plan = with_route(replace(simulation1_plan, leader_trajectory=motion), {50.0: {"hold_s": 10.0}})
    t_s, leader = np.arange(0.0, 270.0, 0.1), plan.sysids[plan.leader]
    track = motion.state(t_s - 1.5)[:, POSITION]
    (passed,) = points_passed(plan, {leader: (t_s, track)})
    assert passed.distance_m[leader] == pytest.approx(0.0, abs=1e-6)
    assert passed.late_s[leader] == pytest.approx(1.5, abs=0.15)
