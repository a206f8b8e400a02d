"""Re-planning a formation that turns with its course: it faces its new course too, and lands as it was planned to."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.plan.planner import make_plan
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.places import NoFlyZone
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.route_flights import CORNER, flight_through


@pytest.fixture(scope="module")
def turning(simulation1: Scenario) -> Plan:
    """Three vehicles round a corner of 90 degrees, in 75 s."""
    limits = {"accel_max_mps2": 2.0}
    formation = {"frame": "course", "change_speed_mps": 2.0, "change_accel_mps2": 1.0}
    plan = make_plan(
        flight_through(
            simulation1, CORNER, vehicles=3, formation=formation, limits=limits, time={"flight_s": 75.0},
            end={"position_m": [60.0, 80.0, 5.0]},
        )
    )  # fmt: skip
    assert verify(plan).ok, verify(plan)
    return plan


def state(plan: Plan, t_s: float) -> np.ndarray:
    return plan.leader_trajectory.state(t_s)


@pytest.mark.parametrize(
    "at_s", [pytest.param(2.0, marks=pytest.mark.slow), 30.0, pytest.param(55.0, marks=pytest.mark.slow)]
)
def test_the_new_plan_faces_its_course_and_is_verified(turning: Plan, at_s: float) -> None:
    new = Replanner(turning).replan(state(turning, at_s), at_s)
    report = verify(new)
    assert report.ok, [str(check) for check in report.failures]
    assert "heading along the course" in {check.name for check in report.checks}
    np.testing.assert_allclose(new.landing_points_ned_m, turning.landing_points_ned_m, atol=1e-3)
    begin, end = (new.offsets(np.array([t_s]))[:, 0] for t_s in (at_s, new.flight_s))
    np.testing.assert_allclose(begin, turning.offsets(np.array([at_s]))[:, 0], atol=1e-3)  # nobody jumps
    np.testing.assert_allclose(end, turning.offsets(np.array([new.flight_s]))[:, 0], atol=1e-3)
    assert f"leader 1 from ({state(turning, at_s)[0]:.1f}" in str(new)  # not where it would have been at T0


@pytest.mark.long
def test_it_turns_with_the_detour_round_a_new_zone(turning: Plan) -> None:
    ahead = state(turning, 25.0)
    zone = NoFlyZone(north_m=float(ahead[0]), east_m=float(ahead[1]) + 2.0, radius_m=2.0)
    new = Replanner(turning).replan(state(turning, 5.0), 5.0, [zone])
    assert verify(new).ok, verify(new)
    assert new.zone_distances_m(np.arange(5.0, new.flight_s, 0.2)).min() > 0.0


@pytest.mark.slow
def test_what_leaves_no_time_is_refused_with_a_reason(turning: Plan) -> None:
    off = state(turning, 69.0) + np.eye(12)[1] * 15.0
    with pytest.raises(Infeasible, match=r"no plan.* from t = 69 s in the remaining 6 s"):
        Replanner(turning).replan(off, 69.0)
