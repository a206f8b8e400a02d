"""The longest way is as short as can be, whoever is asked: every permutation of few, and a thousand."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from gcs.plan.formation.assignment import bottleneck, least_squares
from gcs.types import Array


@st.composite
def tables(draw: st.DrawFn) -> Array:
    """Distances between up to 8 vehicles and places; few values, so that many answers are equally good."""
    count = draw(st.integers(1, 8))
    values = draw(st.sampled_from(["few", "places"]))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if values == "few":
        return random.integers(0, 5, size=(count, count)).astype(float)
    return np.asarray(cdist(random.normal(size=(count, 2)), random.normal(size=(count, 2))))


@settings(max_examples=60, deadline=None)
@given(tables())
def test_no_permutation_is_better(distance_m: Array) -> None:
    rows = np.arange(len(distance_m))
    ways = distance_m[rows, list(permutations(rows))]  # (V!, V)
    longest, squares = ways.max(axis=1), (ways**2).sum(axis=1)
    first, second = bottleneck(distance_m), least_squares(distance_m)
    assert first is not None
    assert second is not None
    assert sorted(first) == sorted(second) == rows.tolist()
    assert distance_m[rows, first].max() == pytest.approx(longest.min(), rel=1e-8)
    equally_good = squares[longest <= longest.min() * (1 + 1e-9)]
    assert (distance_m[rows, first] ** 2).sum() == pytest.approx(equally_good.min(), rel=1e-7)
    assert (distance_m[rows, second] ** 2).sum() == pytest.approx(squares.min(), rel=1e-8)


def test_the_two_answers_differ_where_the_paper_wants_time() -> None:
    """Both stay: 1.9 at most and 7.22 in squares. They exchange: 2 at most, and 4."""
    distance_m = np.array([[1.9, 2.0], [0.0, 1.9]])
    assert bottleneck(distance_m).tolist() == [0, 1]  # type: ignore[union-attr]
    assert least_squares(distance_m).tolist() == [1, 0]  # type: ignore[union-attr]


def test_forbidden_ways_are_not_taken() -> None:
    distance_m = np.array([[0.0, 5.0], [1.0, 0.0]])
    distance_m[0, 0] = np.inf
    for assign in (bottleneck, least_squares):
        assert assign(distance_m).tolist() == [1, 0]  # type: ignore[union-attr]
        for blocked in (np.array([[np.inf, 5.0], [np.inf, 0.0]]), np.full((2, 2), np.inf)):
            assert assign(blocked) is None


@pytest.mark.slow
def test_a_thousand_find_the_longest_way_no_shorter_answer_has() -> None:
    random = np.random.default_rng(5)
    here, there = random.uniform(0, 100, size=(2, 1000, 2))
    distance_m = np.asarray(cdist(here, there))
    found = bottleneck(distance_m)
    assert found is not None
    longest = distance_m[np.arange(1000), found].max()
    assert sorted(found) == list(range(1000))
    assert bottleneck(np.where(distance_m < longest * (1 - 1e-8), distance_m, np.inf)) is None
