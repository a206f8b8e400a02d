"""Conflicts seen before they happen, and none where the plan is flown as it was verified."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.flight.contingency.conflict_prediction import SeparationWatch
from gcs.flight.monitor import VehicleView
from gcs.physics.quadrotor import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan

T0 = 1_700_000_000.0
ALL = (1, 2, 3, 4, 5, 6)


def views_at(plan: Plan, t_s: float, age_s: float = 0.1, noise_m: float = 0.0, seed: int = 0) -> dict[int, VehicleView]:
    """What six vehicles that fly the plan tell at `t_s`, a little old."""
    rng = np.random.default_rng(seed)
    states = plan.states(np.array([t_s - age_s]))[:, 0]
    return {
        sysid: VehicleView(
            sysid,
            states[row, POSITION] + rng.normal(0.0, noise_m, 3),
            states[row, VELOCITY] + rng.normal(0.0, noise_m, 3),
            T0 + t_s - age_s,
        )
        for row, sysid in enumerate(plan.sysids)
    }


def test_a_verified_plan_flown_with_noise_has_no_conflicts(simulation1_plan: Plan) -> None:
    ours = SeparationWatch(simulation1_plan, 0.3)
    for n, t_s in enumerate(np.arange(-15.0, 275.0, 1.0)):
        views = views_at(simulation1_plan, t_s, noise_m=0.02, seed=n)
        assert ours.look(views, t_s, T0 + t_s, ALL, ALL) == []


def test_two_who_drift_together_are_seen_in_time(simulation1_plan: Plan) -> None:
    plan, ours = simulation1_plan, SeparationWatch(simulation1_plan, 0.3)
    found = []
    for t_s in np.arange(50.0, 50.31, 0.1):
        views = views_at(plan, t_s)
        between = views[2].position_ned_m - views[5].position_ned_m
        views[5].position_ned_m = views[5].position_ned_m + 0.25 * between / np.linalg.norm(between)
        found = ours.look(views, t_s, T0 + t_s, ALL, ALL)
        if t_s < 50.15:
            assert found == []  # one sample is no conflict
    (conflict,) = found
    assert conflict.pair == (2, 5)
    assert conflict.distance_m == pytest.approx(0.25, abs=0.02)
    assert conflict.in_s == 0.0


def test_who_stands_in_the_way_is_seen_seconds_ahead(simulation1_plan: Plan) -> None:
    plan, ours = simulation1_plan, SeparationWatch(simulation1_plan, 0.3)
    ahead = plan.states(np.array([52.0]))[3, 0, POSITION]
    for t_s in (50.0, 50.1, 50.2):
        views = views_at(plan, t_s)
        views[6] = VehicleView(6, ahead, np.zeros(3), T0 + t_s)
        found = ours.look(views, t_s, T0 + t_s, ALL[:5], ALL)
    mine = next(c for c in found if c.pair == (4, 6))
    assert 1.4 < mine.in_s < 2.0
    assert ours.look(views, t_s, T0 + t_s, ALL[:5], ALL[:5]) == []  # once it is down, it is no conflict
