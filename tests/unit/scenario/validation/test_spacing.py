"""Pairs too near each other, against all distances there are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist, squareform

from gcs.scenario.validation.spacing import Pair, close_pairs, nearest_pair

# Coarse, so that places coincide and distances are equal.
points = st.lists(st.tuples(*[st.integers(-3, 3)] * 3), max_size=40).map(
    lambda p: np.array(p, dtype=float).reshape(-1, 3)
)


@given(points, st.floats(0.1, 8.0))
def test_pairs_found_are_pairs_too_near(places: np.ndarray, least: float) -> None:
    distances = squareform(pdist(places)) if len(places) > 1 else np.zeros((len(places),) * 2)
    found = close_pairs(places, least)
    assert len({(p.first, p.second) for p in found}) == len(found)
    for pair in found:
        assert pair.first < pair.second
        assert pair.distance_m == pytest.approx(distances[pair.first, pair.second])
        assert pair.distance_m < least
    assert [p.distance_m for p in found] == pytest.approx(sorted(p.distance_m for p in found))
    near = np.triu(distances < least - 1e-6, 1)
    if len(places) <= 8:
        assert len(found) >= near.sum()
    lonely = set(range(len(places))) - {row for p in found for row in (p.first, p.second)}
    assert not (near | near.T)[list(lonely)].any()


@given(points)
def test_the_nearest_pair_is_nearest(places: np.ndarray) -> None:
    found = nearest_pair(places)
    if len(places) < 2:
        assert found is None
    else:
        assert found is not None
        assert found.first < found.second
        assert found.distance_m == pytest.approx(pdist(places).min())
        assert found.distance_m == pytest.approx(np.linalg.norm(places[found.first] - places[found.second]))


def test_of_equal_pairs_the_first_in_the_list_is_told() -> None:
    row = np.zeros((5, 3))
    row[:, 1] = np.array([0.0, 0.1, 0.2, 0.3, 0.4]) * 3.0
    assert close_pairs(row, 0.4)[0] == Pair(0, 1, pytest.approx(0.3))
    found = nearest_pair(row)
    assert found is not None
    assert (found.first, found.second) == (0, 1)


def test_a_distance_kept_exactly_is_kept() -> None:
    assert close_pairs(np.array([[0.1, 0.0, 0.0], [0.4, 0.0, 0.0]]), 0.3) == []
