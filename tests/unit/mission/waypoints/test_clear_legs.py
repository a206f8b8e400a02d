"""Legs over slopes: aside by the tolerance may be lower by much more."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gcs.mission.flight_limits import limits_of
from gcs.mission.waypoints.mission_items import timed_legs
from gcs.mission.waypoints.placement import Deviation, SampledFlight, clear_legs, waypoint_indices
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.sources.load import load_scenario

T = np.linspace(0.0, 40.0, 401)


def test_a_leg_across_a_slope_is_split_where_its_deviation_alone_would_not(
    repo_root: Path,
) -> None:
    scenario = load_scenario(repo_root / "missions/gap/scenario.toml")
    around = np.linspace(-0.3, 0.3, len(T))  # 25 m east of the summit, where the ground is steepest
    north_m, east_m = 200.0 + 45.0 * np.sin(around), 46.0 - 25.0 * np.cos(around)
    up_m = ground_height_m(scenario.terrain, north_m, east_m) + scenario.limits.clearance_min_m
    for _ in range(20):  # a place whose distance to the slope, not whose height above it, is the clearance
        up_m += scenario.limits.clearance_min_m - ground_distance_m(scenario.terrain, north_m, east_m, up_m, 20.0)
    places = np.stack([north_m, east_m, -up_m], axis=-1)[None]
    limits, allowed = Deviation(2.0, 100.0), clear_legs(scenario, T, places)
    free = waypoint_indices(SampledFlight(T, places), limits)
    clear = waypoint_indices(SampledFlight(T, places, allowed=allowed), limits)
    assert not allowed(free[0], free[1])
    assert len(free) < len(clear) < 40
    assert all(allowed(first, last) for first, last in pairwise(clear))


@pytest.mark.slow
def test_the_legs_of_gap_keep_the_clearance(plan_of: Callable[[str], Plan]) -> None:
    """Two of its vehicles would be 0.3 m too low over the mountains."""
    plan = plan_of("gap/scenario.toml")
    t_s = timed_legs(plan).t_s
    fine_s = np.linspace(t_s[0], t_s[-1], 5001)
    corners = plan.states(t_s)[..., POSITION]
    legs = np.stack([[np.interp(fine_s, t_s, one[:, axis]) for axis in range(3)] for one in corners])  # (V, 3, N)
    limit_m = limits_of(plan.scenario).clearance_m
    away_m = ground_distance_m(plan.scenario.terrain, legs[:, 0], legs[:, 1], -legs[:, 2], 2.0 * limit_m)
    assert away_m.min() >= limit_m
