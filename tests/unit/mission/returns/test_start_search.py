"""The search for the nearest two vehicles between the first instants: ways that jump, and a brute comparison."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_returns import RoutedReturns, instants_s, nearest_pairs, nearest_return, routed_returns
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.mission.returns.test_pair_returns import ENDS_S, flown

SPEEDS = ReturnSpeeds(2.0, 5.0, 1.5, 5.0)


def test_instants_close_in_on_where_the_way_jumps(simulation1: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicles pass behind a wall: from one instant on they return round its other end. It is found to 1 ms."""
    leader = np.zeros((2, 1, 3))
    leader[:, 0] = (0.0, 3.0, 0.0), (150.0, -60.0, -20.0)
    tables, still = np.zeros((1, 2, 3)), PPoly(np.ones((1, 1, 1)), np.array([0.0, ENDS_S]))
    tables[0, 1, 0] = 8.0
    wall = [[60.0, -25.0], [60.0, 50.0], [70.0, 50.0], [70.0, -25.0]]
    plan = flown(simulation1, leader, np.array([0.0, ENDS_S]), still, tables, no_fly=[{"polygon_m": wall}])
    routes, looked = ReturnRoutes(plan), []

    def recorded(plan: Plan, routes: ReturnRoutes, t_s: Array) -> list[RoutedReturns]:
        looked.append(t_s)
        return routed_returns(plan, routes, t_s)

    monkeypatch.setattr("gcs.mission.returns.routed_returns.routed_returns", recorded)
    first = routed_returns(plan, routes, instants_s(plan, 1.0))
    nearest_return(plan, routes, first, np.array([-30.0, -40.0]), SPEEDS)
    corners = first[0].kinds()[:, :, 1]
    t_s = np.unique(np.concatenate([first[0].t_s, *looked]))
    for row in range(2):
        jump = int(np.flatnonzero(np.abs(np.diff(corners[:, row])) > 50.0)[0])
        begin_s, end_s = first[0].t_s[jump], first[0].t_s[jump + 1]
        inside = t_s[(t_s >= begin_s) & (t_s <= end_s)]
        assert np.diff(inside).min() <= 1e-3


def test_no_instant_between_is_nearer(plan_of: Callable[[str], Plan]) -> None:
    """Returns of `field` every 50 ms around the least distance, and 150 random instants: none is nearer by 5 cm."""
    plan = plan_of("field/scenario.toml")
    returns = plan_returns(plan, Autopilot.PX4)
    assert returns.routed is not None
    random = np.random.default_rng(17)
    last_s = float(np.nextafter(plan.t_end_s, -np.inf))
    around_s = returns.routed.t_s + np.arange(-1.5, 1.5, 0.05)
    t_s = np.sort(np.concatenate([around_s, random.uniform(plan.t_start_s, last_s, 150)])).clip(plan.t_start_s, last_s)
    top_down_m = plan.pads_ned_m[:, 2] - np.array(returns.altitudes_m)
    for case in routed_returns(plan, ReturnRoutes(plan), t_s):
        least_m, _ = nearest_pairs(case, top_down_m, returns.speeds, plan.scenario.limits.separation_min_m)
        assert least_m.min() >= returns.routed.distance_m - 0.05
