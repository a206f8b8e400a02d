"""The oracle itself: against figures worked by hand, and against the verdict on valid plans."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.verification.verify import Check, verify
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import NoFlyZone, Terrain
from tests.property.plan.adversary.bends import is_length, limit_of, spans_s
from tests.property.plan.adversary.ground import distance_m, height_up_m
from tests.property.plan.adversary.missions import MISSIONS, mission
from tests.property.plan.adversary.oracle import GROUND, Oracle, outside_m, window

NOW = np.array([0.0])


def test_over_level_ground_the_distance_is_the_height() -> None:
    places = np.array([[3.0, -2.0, -4.5], [0.0, 0.0, -0.001], [1.0, 1.0, 0.25]])
    np.testing.assert_allclose(distance_m(Terrain(), places), [4.5, 0.001, -0.25], atol=1e-9)


def test_beside_a_needle_it_is_the_distance_to_its_tip_or_its_side() -> None:
    thin = {"north_m": [0.0], "east_m": [0.0], "height_m": [5.0], "spread_north_m": [1e-3], "spread_east_m": [1e-3]}
    needle = Terrain.model_validate({"mountains": thin})
    over = np.array([[0.3, 0.4, -6.2]])
    np.testing.assert_allclose(distance_m(needle, over), [1.3], atol=2e-3)
    beside = np.array([[0.3, 0.4, -4.0]])
    np.testing.assert_allclose(distance_m(needle, beside), [0.5], atol=2e-3)


def test_over_a_slope_it_is_the_height_times_the_cosine() -> None:
    """The relief of "hills" beside a pixel, seen from 5 cm: there it is a plane."""
    terrain = mission("hills").scenario.terrain
    rng = np.random.default_rng(3)
    north, east = rng.uniform(-10.0, 40.0, 40), rng.uniform(-10.0, 10.0, 40)
    inner = (np.abs(north % 1.0 - 0.5) < 0.35) & (np.abs(east % 1.0 - 0.5) < 0.35)
    north, east = north[inner], east[inner]
    up = height_up_m(terrain, north, east)
    slope = [
        (height_up_m(terrain, north + a, east + b) - height_up_m(terrain, north - a, east - b)) / 2e-4
        for a, b in ((1e-4, 0.0), (0.0, 1e-4))
    ]
    places = np.column_stack([north, east, -up - 0.05])
    expected = 0.05 / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    np.testing.assert_allclose(distance_m(terrain, places), expected, atol=2e-4)


@pytest.mark.parametrize("name", MISSIONS)
def test_the_ground_is_that_of_the_scenario(name: str) -> None:
    terrain = mission(name).scenario.terrain
    north, east = np.random.default_rng(4).uniform(-15.0, 45.0, (2, 500))
    np.testing.assert_allclose(
        height_up_m(terrain, north, east), ground_height_m(terrain, north, east), rtol=1e-12, atol=1e-9
    )


def test_the_distance_from_a_polygon_counts_its_corners() -> None:
    corners = [[0, 0], [4, 0], [4, 4], [0, 4]]
    square = NoFlyZone.model_validate({"polygon_m": corners, "moves": [[0, 0, 0], [10, 10, 0]]})
    places = np.array([[-3.0, -4.0, 0.0], [2.0, 2.0, 0.0], [2.0, 3.9, 0.0], [5.0, 2.0, 0.0]])[:, None]
    np.testing.assert_allclose(outside_m(square, NOW, places)[:, 0], [5.0, -2.0, -0.1, 1.0])
    later = outside_m(square, np.array([5.0]), places)[:, 0]
    np.testing.assert_allclose(later, [np.hypot(8.0, 4.0), 3.0, 3.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("name", MISSIONS)
def test_what_the_verifier_proves_is_no_more_and_what_it_shows_no_less_than_there_is(name: str) -> None:
    """In each phase: the proved margin is below the oracle's anywhere; near the worst instant both agree."""
    plan, rng = mission(name), np.random.default_rng(5)
    oracle, seen = Oracle(plan), 0
    for check in verify(plan).checks:
        if check.name not in oracle.names or check.phase == "all" or check.t_s is None:
            continue
        if check.name == "rotor speed":
            continue  # a verdict without a common unit: how much more a rotor could give
        seen += 1
        span = next(p for p in plan.phases if p.name == check.phase)
        low, high = span.start_s + 1e-6, span.end_s - 1e-6
        if not any(a <= low and high <= b for a, b in spans_s(plan, check.name)):
            continue
        for start_s in rng.uniform(low, high, 3):
            times = window(float(start_s), min(float(start_s) + 0.004, high))
            assert proved(check) <= oracle.margin(check.name, times).min() + 1e-9, str(check)
        near = window(max(check.t_s - 2e-3, low), min(check.t_s + 2e-3, high))
        least = float(oracle.margin(check.name, near).min())
        if check.name in ("no-fly zone 1", "no-fly zone 2") and check.worst > 0.0:
            continue  # beside a corner, the distance to the line of an edge is less
        allowed = 1e-3 if is_length(check.name) else 1e-3 * limit_of(plan, check.name)
        assert proved(check) <= least + 1e-9, str(check)
        assert least <= check.worst + allowed, str(check)
    assert seen > 20


def proved(check: Check) -> float:
    """The lower bound of the margin."""
    return float(getattr(check, "proved", -np.inf))


def test_over_the_ground_it_knows_take_off_and_landing() -> None:
    plan = mission("meadow")
    start, end = plan.t_start_s + 1.0, plan.t_end_s - 1.0
    height = -Oracle(plan).places_ned_m(np.array([start, end]))[..., 2]
    np.testing.assert_allclose(
        Oracle(plan).margin(GROUND[1], np.array([start, end])), height - 0.5 * np.minimum(0.5, height), atol=1e-6
    )
