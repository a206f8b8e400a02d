"""Ground below return tracks that stands between all samples, and a brute oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.mission.returns.ground_below import GAP_M, highest_along_m, highest_below_returns_m
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.mission.returns.rtl_cases import ReturnSpeeds, highest_ground_m, return_cases
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.mission.returns.test_pair_returns import ENDS_S, flown, turning
from tests.unit.plan.problems import changed

SPEEDS = ReturnSpeeds(2.0, 5.0, 1.5, 5.0)


def over(scenario: Scenario, summits_m: Array, heights_m: Array, spread_m: float) -> Plan:
    """One vehicle that flies in a curve, 100 m east of its leader; mountains (M, 2) of these heights."""
    tables, still = np.zeros((1, 2, 3)), PPoly(np.ones((1, 1, 1)), np.array([0.0, ENDS_S]))
    tables[0, 1, 1] = 100.0
    plan = flown(scenario, turning(), np.array([0.0, ENDS_S]), still, tables)
    mountains = {
        "height_m": heights_m.tolist(),
        "north_m": summits_m[:, 0].tolist(),
        "east_m": summits_m[:, 1].tolist(),
        "spread_north_m": [spread_m] * len(heights_m),
        "spread_east_m": [spread_m] * len(heights_m),
    }
    return replace(plan, scenario=changed(plan.scenario, terrain={"mountains": mountains}))


def track_places(plan: Plan, t_s: Array, shares: Array) -> Array:
    """Places (V, T, S, 2) of tracks home, at shares of them, of returns that begin at these instants."""
    starts = plan.leader_trajectory.state(t_s)[None, :, None, :2] + plan.offsets(t_s)[:, :, None, :2]
    homes = plan.pads_ned_m[:, None, None, :2]
    return np.asarray(starts + shares[:, None] * (homes - starts))


def sampled_m(plan: Plan, rally: Array) -> float:
    return highest_ground_m(plan, return_cases(plan, Autopilot.ARDUPILOT, SPEEDS, 2.0, rally_ned_m=rally))


@pytest.mark.parametrize(("at_s", "share"), [(21.07, 0.437), (33.1, 0.21)])
def test_a_needle_between_samples_raises_the_return(simulation1: Scenario, at_s: float, share: float) -> None:
    """A peak of 0.4 m radius and 40 m height stands below a track that begins between two sampled instants."""
    flat = over(simulation1, np.array([[0.0, 0.0]]), np.array([0.0]), 1.0)
    needle_m = track_places(flat, np.array([at_s]), np.array([share]))[0, 0]
    plan = over(simulation1, needle_m, np.array([40.0]), 0.2)
    rally = plan.landing_points_ned_m[:, None]
    assert sampled_m(plan, rally) < 1.0
    assert 40.0 - 1e-9 <= highest_below_returns_m(plan, Autopilot.ARDUPILOT, rally, -np.inf) <= 40.0 + 2 * GAP_M
    found = plan_returns(plan, Autopilot.ARDUPILOT)
    assert found.ground_max_m >= 40.0 - 1e-9
    assert min(found.altitudes_m) >= 40.0


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 3))])
def test_no_ground_below_a_track_is_above_the_bound(simulation1: Scenario, seed: int) -> None:
    """40 mountains in the way: 4,000 instants, and 400 places of each track."""
    random = np.random.default_rng(seed)
    plan = over(simulation1, random.uniform(-20.0, 220.0, (40, 2)), random.uniform(2.0, 20.0, 40), 8.0)
    rally = plan.pads_ned_m[:, None] + np.array([[[9e5, 0.0, 0.0]]])
    places = track_places(plan, np.linspace(0.0, ENDS_S - 1e-6, 4000), np.linspace(0.0, 1.0, 400))
    brute_m = float(ground_height_m(plan.scenario.terrain, places[..., 0], places[..., 1]).max())
    bound_m = highest_below_returns_m(plan, Autopilot.ARDUPILOT, rally, -np.inf)
    assert brute_m <= bound_m <= brute_m + 2.5 * GAP_M
    given_m = bound_m + 5.0
    assert highest_below_returns_m(plan, Autopilot.ARDUPILOT, rally, given_m) == given_m


def test_legs_round_zones_are_bounded_between_samples(simulation1: Scenario) -> None:
    plan = over(simulation1, np.array([[52.1, 0.0]]), np.array([30.0]), 0.3)
    begin_m, end_m = np.array([[0.0, 0.0], [0.0, 2.0]]), np.array([[100.0, 0.0], [100.0, 2.0]])
    assert highest_along_m(plan, begin_m, end_m, -np.inf) == pytest.approx(30.0, abs=2 * GAP_M)
    assert highest_along_m(plan, begin_m[1:], end_m[1:], -np.inf) == pytest.approx(0.0, abs=2 * GAP_M)


def test_flat_ground_is_where_it_is(simulation1: Scenario) -> None:
    """The bound adds nothing: return altitudes over a flat field are the round ones."""
    plan = over(simulation1, np.array([[0.0, 0.0]]), np.array([0.0]), 1.0)
    assert highest_below_returns_m(plan, Autopilot.ARDUPILOT, plan.landing_points_ned_m[:, None], 0.0) == 0.0
