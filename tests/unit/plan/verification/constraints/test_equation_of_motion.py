"""The bound on windows of Eq. 1, against the same windows flown by a library's integrator."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly

from gcs.errors import OutOfTime
from gcs.physics.quadrotor import equations_of_motion
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.constraints.equation_of_motion import reintegrated
from gcs.types import Array
from gcs.util.long_work import within


def flown_error_m(plan: Plan, begin_s: float) -> float:
    """How far Eq. 1 leads from the plan within 5 s."""
    part, q = plan.leader_trajectory, plan.quadrotor
    joints = part.joints_s
    end_s = min(begin_s + 5.0, plan.t_end_s)
    stops = [begin_s, *joints[(joints > begin_s + 1e-9) & (joints < end_s)], end_s]
    x, worst = part.state(np.array([begin_s]))[0], 0.0
    for low, high in pairwise(stops):
        inner = 0.5 * (low + high)  # the control of this polynomial, at its ends too
        piece = int(np.searchsorted(part.control.x, inner, side="right")) - 1
        c, x0 = part.control.c[:, piece], part.control.x[piece]

        def slope(t_s: float, x: Array, c: Array = c, x0: float = float(x0)) -> Array:
            u = [np.polyval(c[:, i], t_s - x0) for i in range(4)]
            return np.array(equations_of_motion(x, u, q), dtype=np.float64)

        times = np.linspace(low, high, 9)
        found = solve_ivp(slope, (low, high), x, method="DOP853", rtol=1e-10, atol=1e-11, t_eval=times)
        at = np.clip(times, low, np.nextafter(high, low))
        worst = max(worst, float(np.linalg.norm(found.y[:3].T - part.state(at)[:, :3], axis=1).max()))
        x = found.y[:, -1]
    return worst


def less_thrust(plan: Plan, share: float) -> Plan:
    old = plan.leader_trajectory
    c = old.control.c.copy()
    c[:, :, 0] *= 1.0 - share
    return replace(plan, leader_trajectory=Trajectory(old.state, PPoly(c, old.control.x)))


@pytest.mark.parametrize("share", [0.0, 3e-5, 1e-3])
def test_the_bound_is_no_less_than_the_error_and_hardly_more(meadow_plan: Plan, share: float) -> None:
    plan = less_thrust(meadow_plan, share)
    found = reintegrated(plan)
    assert found.complete
    worst = max(flown_error_m(plan, begin_s) for begin_s in np.arange(plan.t_start_s, plan.t_end_s - 4.0, 2.0))
    assert flown_error_m(plan, found.start_s) <= found.error_m
    assert worst <= found.error_m
    assert found.error_m <= flown_error_m(plan, found.start_s) * 1.25 + 2e-3


def test_thrust_that_is_missing_lets_it_fall_as_in_vacuum(meadow_plan: Plan) -> None:
    """Over 5 s, 1/2 a t^2 of the missing acceleration; drag takes less than a third of it."""
    share = 1e-3
    error_m = reintegrated(less_thrust(meadow_plan, share)).error_m
    vacuum_m = 0.5 * share * meadow_plan.quadrotor.gravity_mps2 * 25.0
    assert 0.65 * vacuum_m < error_m < 1.1 * vacuum_m


def test_it_ends_at_a_time_limit(meadow_plan: Plan) -> None:
    with within(-1.0), pytest.raises(OutOfTime, match=r"while integrating Eq\. 1 again: from t = -8 s to 30 s"):
        reintegrated(meadow_plan)
