"""Rally points keep straight returns out of no-fly zones: each autopilot flies to the nearest of them and home."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely

from gcs.autopilots.traits import Autopilot
from gcs.mission.returns.fence_areas import inclusion_corners, planned_places_m
from gcs.mission.returns.rtl_altitudes import plan_returns, return_warnings
from gcs.mission.returns.rtl_cases import ReturnTo, rally_points_ned_m
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import Array


@pytest.fixture(scope="module")
def field(plan_of: Callable[[str], Plan]) -> Plan:
    return plan_of("field/scenario.toml")


def crossing_s(plan: Plan, rally: Array) -> Array:
    """For how long (V,) a straight return to the nearest of home and rally points would cross a no-fly zone."""
    t_s = np.arange(plan.t_start_s, plan.t_end_s, 1.0)
    found = np.zeros(len(rally))
    for row, track in enumerate(plan.states(t_s)[..., POSITION][..., :2]):
        ends = np.concatenate([plan.pads_ned_m[row, None, :2], rally[row, :, :2]])
        for start in track:
            end = ends[np.argmin(np.linalg.norm(ends - start, axis=1))]
            north, east = (start + np.linspace(0.0, 1.0, 200)[:, None] * (end - start)).T
            zones = plan.scenario.no_fly
            found[row] += min(outside_m(z, np.zeros(1), north, east).min() for z in zones) < -1.0
    return found


def test_hardly_any_straight_return_crosses_a_zone(field: Plan) -> None:
    rally = rally_points_ned_m(field, 7)
    before, after = crossing_s(field, field.landing_points_ned_m[:, None]), crossing_s(field, rally)
    assert before.min() > 100.0  # with landing points alone
    assert after.max() <= 5.0
    assert rally.shape == (6, 6, 3)
    assert np.array_equal(rally[:, 0], field.landing_points_ned_m)


def test_rally_points_are_apart_flat_and_allowed(field: Plan) -> None:
    rally = rally_points_ned_m(field, 7)
    ends = np.concatenate([field.pads_ned_m[:, None], rally], axis=1)[..., :2]
    away_m = np.linalg.norm(ends[:, None, :, None] - ends[None, :, None, :], axis=-1)  # by vehicles, by points
    away_m[np.arange(6), np.arange(6)] = np.inf
    assert away_m.min() >= field.scenario.limits.separation_min_m
    fence = shapely.Polygon(inclusion_corners(planned_places_m(field)))
    north, east = rally[..., 0], rally[..., 1]
    assert shapely.contains_properly(fence, shapely.points(rally[..., :2].reshape(-1, 2))).all()
    assert min(outside_m(zone, np.zeros(1), north, east).min() for zone in field.scenario.no_fly) >= 3.0 - 1e-6
    np.testing.assert_allclose(-rally[:, 1:, 2], ground_height_m(field.scenario.terrain, north, east)[:, 1:], atol=1e-6)


def test_one_place_is_the_landing_point(field: Plan) -> None:
    assert np.array_equal(rally_points_ned_m(field, 1), field.landing_points_ned_m[:, None])


@pytest.mark.parametrize(("firmware", "words"), [(Autopilot.PX4, "GF_ACTION 2"), (Autopilot.ARDUPILOT, "FENCE_ACTION")])
def test_what_still_crosses_is_told_with_what_the_fence_does(field: Plan, firmware: Autopilot, words: str) -> None:
    returns = plan_returns(field, firmware)
    assert {len(points) for points in returns.rally_ned_m} <= {6, 7}
    told = [text for text in return_warnings(field, returns, firmware) if "crosses no-fly zone" in text]
    assert len(told) == len(returns.crossings) >= 2
    assert all(words in text and "vehicle 1, 2" in text for text in told if "to home" in text)
    home_s, nearest_s = (sum(c.to_s - c.from_s for c in returns.crossings if c.ends is ends) for ends in ReturnTo)
    assert home_s > 300.0
    assert nearest_s < 15.0
