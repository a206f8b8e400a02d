"""Least distances of straight motions: closed forms, and two ways of finding the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.mission.predicted import closest_approach as module
from gcs.mission.predicted.closest_approach import closest_approach, least_distance
from gcs.mission.predicted.planned_flight import PredictedFlight


def flight(*knots: tuple[float, float, float, float], ends_s: float = math.inf) -> PredictedFlight:
    table = np.array(knots)
    item = np.zeros(len(table))
    return PredictedFlight(table[:, 0], table[:, 1:], item, float(table[0, 0]), float(table[-1, 0]), ends_s)


def test_two_that_cross() -> None:
    """North at 1 m/s and east at 1 m/s, 10 m apart when each crosses the other's line: nearest in the middle."""
    north = flight((0, -50, 0, -10), (100, 50, 0, -10))
    east = flight((0, 0, -40, -10), (100, 0, 60, -10))
    found = closest_approach([north, east])
    assert found is not None
    assert found.distance_m == pytest.approx(10 / math.sqrt(2))
    assert found.t_s == pytest.approx(45.0)
    assert found.pair == (0, 1)


def test_a_wait_moves_the_encounter() -> None:
    north = flight((0, -50, 0, -10), (10, -50, 0, -10), (110, 50, 0, -10))
    east = flight((0, 0, -50, -12), (100, 0, 50, -12))
    found = closest_approach([north, east])
    assert found is not None
    assert found.distance_m == pytest.approx(math.hypot(10 / math.sqrt(2), 2))
    assert found.t_s == pytest.approx(55.0)


def test_on_the_ground_nobody_counts() -> None:
    """Pads 0.5 m apart: before the first lifts off and after the last has landed their distance means nothing."""
    first = flight((0, 0, 0, 0), (5, 0, 0, -10), (20, 100, 0, -10), (30, 100, 0, 0), ends_s=30.0)
    second = flight((0, 0.5, 0, 0), (40, 0.5, 0, 0), ends_s=0.0)
    found = closest_approach([first, second])
    assert found is not None
    assert found.distance_m == pytest.approx(0.5)
    assert found.t_s < 5.0
    assert closest_approach([second, second]) is None


def test_one_vehicle_meets_nobody() -> None:
    assert closest_approach([flight((0, 0, 0, 0), (5, 0, 0, -10))]) is None


def test_vectors_that_stand_pass_and_leave() -> None:
    start = np.array([[3.0, 4.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    end = np.array([[3.0, 4.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0]])
    distance, share = least_distance(start, end)
    assert distance == pytest.approx([5.0, 1.0, 1.0])
    assert share[1:] == pytest.approx([0.5, 0.0])


def test_a_large_fleet_is_searched_by_a_tree_with_the_same_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(7)
    fleet = [
        flight(*((t, *random.uniform(-200, 200, 3)) for t in (0, *sorted(random.uniform(1, 60, 4))))) for _ in range(30)
    ]
    exact = closest_approach(fleet)
    monkeypatch.setattr(module, "_ALL_PAIRS", 1)
    monkeypatch.setattr(module, "_ALIKE_S", 1e-9)
    by_tree = closest_approach(fleet)
    assert exact is not None
    assert by_tree is not None
    assert by_tree.pair == exact.pair
    assert by_tree.distance_m == pytest.approx(exact.distance_m, abs=1e-9)
    assert by_tree.t_s == pytest.approx(exact.t_s, abs=1e-6)
    assert closest_approach(fleet, exact.distance_m * 0.9) is None
