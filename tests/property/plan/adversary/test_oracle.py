"""The oracle itself: against figures worked by hand, and against the verdict on valid plans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Check, verify
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import NoFlyZone, Terrain
from tests.property.plan.adversary import humps
from tests.property.plan.adversary.bends import is_length, limit_of, spans_s
from tests.property.plan.adversary.ground import distance_m, height_up_m
from tests.property.plan.adversary.missions import MISSIONS, mission
from tests.property.plan.adversary.oracle import PAD, Oracle, outside_m, window

NOW = np.array([0.0])
LONG = ("stairs", "hills", "ripple")  # to plan


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


@pytest.mark.slow
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


@pytest.mark.parametrize(
    ("name", "by_share", "margin_m"),
    [
        ("breathing", -0.45, 0.0),
        ("breathing", 0.046, -0.12),
        pytest.param("swinging", -0.45, -2.7, marks=pytest.mark.slow),
        ("folding", 0.01, -np.hypot(0.045, 0.0225)),
    ],
)
def test_of_an_automatic_change_every_allowed_shape_is_a_place(name: str, by_share: float, margin_m: float) -> None:
    """A row of five, 6 m to either end: larger by a share. To 1.026 at most where it may shrink; elsewhere, to 1.

    Where it may become a file, a blend of -0.0025 is nearest: 90 m2 of row times 0.01, by 90 and 270 m2 of both shapes.
    """
    plan = mission(name)
    start = plan.offsets(NOW)[:, 0]
    larger = humps.offsets(plan, by_share * start, humps.hump(-1.01, 0.02, 2))
    assert Oracle(larger).margin("place in formation", NOW - 1.0).min() == pytest.approx(margin_m, abs=1e-9)


def assert_honest(plan: Plan) -> int:
    """In each phase: the proved margin is below the oracle's anywhere; near the worst instant both agree."""
    oracle, rng, seen = Oracle(plan), np.random.default_rng(5), 0
    for check in verify(plan).checks:
        span = next((p for p in plan.phases if p.name == check.phase), None)
        if check.name not in oracle.names or span is None or check.t_s is None:
            continue
        low, high = span.start_s + 1e-6, span.end_s - 1e-6
        if check.unit == "of a control's limit" or not any(
            a <= low and high <= b for a, b in spans_s(plan, check.name)
        ):
            continue
        seen += 1
        for start_s in rng.uniform(low, high, 3):
            times = window(float(start_s), min(float(start_s) + 0.004, high))
            assert proved(check) <= oracle.margin(check.name, times).min() + 1e-9, str(check)
        near = window(max(check.t_s - 2e-3, low), min(check.t_s + 2e-3, high))
        least = float(oracle.margin(check.name, near).min())
        assert proved(check) <= least + 1e-9, str(check)
        if check.name.startswith("no-fly zone") and check.worst > 0.0:
            continue  # beside a corner, the distance to the line of an edge is less
        allowed = 1e-3 if is_length(check.name) else 1e-3 * limit_of(plan, check.name)
        assert least <= check.worst + allowed, str(check)
    return seen


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in MISSIONS]
)
def test_what_is_proved_is_no_more_and_what_is_shown_no_less_than_there_is(name: str) -> None:
    assert assert_honest(mission(name)) > 60


@pytest.mark.slow
@pytest.mark.parametrize("name", ["simulation1", "simulation2", "changes", "field", "gap", "ridge"])
def test_of_the_bundled_missions_everything_is_proved(name: str, plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of(f"{name}/scenario.toml")
    report = verify(plan)
    assert [str(check) for check in report.checks if check.verdict != "proved"] == []
    assert assert_honest(plan) > 60


def proved(check: Check) -> float:
    """The lower bound of the margin."""
    return float(getattr(check, "proved", -np.inf))


def test_over_the_ground_it_knows_take_off_and_landing() -> None:
    plan = mission("meadow")
    start, end = plan.t_start_s + 1.0, plan.t_end_s - 1.0
    height = -Oracle(plan).places_ned_m(np.array([start, end]))[..., 2]
    np.testing.assert_allclose(
        Oracle(plan).margin(PAD, np.array([start, end])), height - 0.25 * np.minimum(0.5, height - 0.25), atol=1e-6
    )
