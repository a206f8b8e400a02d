"""Re-plans on a route: from any state through the points ahead, around new zones, out of a hold."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.physics.states import POSITION
from gcs.plan.planner import make_plan
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.types import Array
from tests.unit.plan.route_flights import CORNER, FAR, flight_through, route_ned_m

OFF = np.array([2.0, -3.0, -0.5, 0.3, -0.2, 0.0, *[0.0] * 6])


@pytest.fixture(scope="module")
def plan(simulation1: Scenario) -> Plan:
    """Three points in 90 s, with a hold at the second."""
    points = CORNER, {**FAR, "hold_s": 8.0, "name": "gate"}, {"position_m": [40.0, 100.0, 6.0]}
    return make_plan(flight_through(simulation1, *points, time={"flight_s": 100.0}, vehicles=2))


@pytest.fixture(scope="module")
def replanner(plan: Plan) -> Replanner:
    return Replanner(plan)


def state(plan: Plan, t_s: float) -> Array:
    return np.array(plan.leader_trajectory.state(t_s))


def off_m(new: Plan) -> Array:
    """Distances of the leader from the points that the plan still passes."""
    places = route_ned_m(new.scenario)[-len(new.route_s) :]
    at = new.leader_trajectory.state(np.array(new.route_s))[:, POSITION]
    return np.asarray(np.linalg.norm(at - places, axis=1))


def verified(new: Plan) -> Plan:
    report = verify(new)
    assert report.ok, [str(check) for check in report.failures]
    return new


def test_from_a_disturbed_state_all_points_ahead_are_passed(plan: Plan, replanner: Replanner) -> None:
    at_s = 10.0
    new = verified(replanner.replan(state(plan, at_s) + OFF, at_s))
    assert len(new.route_s) == 3
    assert off_m(new).max() < 1e-4
    np.testing.assert_allclose(new.leader_trajectory.state(at_s), state(plan, at_s) + OFF, atol=1e-6)
    assert new.phase("mission").end_s == plan.phase("mission").end_s


@pytest.mark.slow
def test_a_leader_on_its_track_flies_on_as_planned(plan: Plan, replanner: Replanner) -> None:
    at_s = plan.route_s[0] + 5.0
    new = verified(replanner.replan(state(plan, at_s), at_s))
    assert new.route_s == pytest.approx(plan.route_s[1:], abs=0.2)
    t_s = np.linspace(at_s, plan.t_end_s - 1e-6, 300)
    np.testing.assert_allclose(new.states(t_s)[..., POSITION], plan.states(t_s)[..., POSITION], atol=0.3)


@pytest.mark.long
def test_a_new_zone_between_two_points_is_passed(plan: Plan, replanner: Replanner) -> None:
    at_s = 10.0
    middle = state(plan, 0.5 * (plan.route_s[0] + plan.route_s[1]))
    zone = NoFlyZone(north_m=float(middle[0]), east_m=float(middle[1]), radius_m=6.0)
    new = verified(replanner.replan(state(plan, at_s), at_s, [zone]))
    t_s = np.arange(at_s, plan.flight_s, 0.05)
    places = new.states(t_s)
    assert outside_m(zone, t_s, places[..., 0], places[..., 1]).min() >= 0.0
    assert off_m(new).max() < 1e-4


@pytest.mark.slow
def test_a_hold_that_has_begun_ends_with_the_replan(plan: Plan, replanner: Replanner) -> None:
    at_s = plan.route_s[1] + 3.0
    new = verified(replanner.replan(state(plan, at_s) + 0.3 * OFF, at_s))
    assert len(new.route_s) == 1
    assert off_m(new).max() < 1e-4


@pytest.mark.slow
def test_shortly_before_a_point_the_leader_does_not_turn_back(plan: Plan, replanner: Replanner) -> None:
    at_s = plan.route_s[0] - 1.0
    new = verified(replanner.replan(state(plan, at_s) + OFF, at_s))
    assert len(new.route_s) == 2
    t_s = np.linspace(at_s, at_s + 20.0, 400)
    east_mps = new.leader_trajectory.state(t_s)[:, 4]
    assert east_mps.min() > -0.5  # the next point is in the east


def test_a_new_zone_over_a_point_is_refused_by_name(plan: Plan, replanner: Replanner) -> None:
    zone = NoFlyZone(north_m=60.0, east_m=61.0, radius_m=5.0)
    with pytest.raises(
        Infeasible, match=r'point 2 \("gate"\) of the route cannot be passed: a vehicle would be'
    ) as told:
        replanner.replan(state(plan, 10.0), 10.0, [zone])
    assert "no plan from t = 10 s" in told.value.message
