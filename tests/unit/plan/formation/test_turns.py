"""Lanes in time: who would pass too near flies one after another, and whoever stands is passed with room."""

from __future__ import annotations

from itertools import chain, pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs.plan.formation.reshape import reshape
from gcs.plan.formation.separation import least_distance, least_gap
from gcs.plan.formation.turns import find_turns
from gcs.types import Array


def test_who_crosses_waits_and_the_leader_never_moves() -> None:
    """Two cross below a leader so far above them that no lane leads past it: one flies, then the other."""
    here = np.array([[0.0, 0.0, 0.0], [-4.0, 0.0, 1.2], [0.0, -4.0, 1.2]])
    there = np.array([[0.0, 0.0, 0.0], [4.0, 0.3, 1.2], [0.3, 4.0, 1.2]])
    stops = find_turns(here, there, 1.1)
    assert stops is not None and len(stops) == 3
    np.testing.assert_array_equal(stops[0], here)
    np.testing.assert_array_equal(stops[-1], there)
    assert all(least_distance(a, b)[0] >= 1.1 for a, b in pairwise(stops))


def test_two_who_change_places_with_each_other_have_no_order() -> None:
    here = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 6.0, 0.0]])
    assert find_turns(here, here[[0, 2, 1]], 1.0) is None


def test_a_place_that_another_leaves_is_taken_afterwards() -> None:
    """In step they would keep their distance, but a third would be passed too near."""
    here = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 6.0, 0.0], [-3.0, 7.0, 0.0]])
    there = np.array([[0.0, 0.0, 0.0], [0.0, 6.0, 0.0], [0.0, 9.0, 0.0], [6.0, 7.0, 0.0]])
    stops = find_turns(here, there, 1.5)
    assert stops is not None
    moved = [np.flatnonzero((a != b).any(axis=1)).tolist() for a, b in pairwise(stops)]
    assert sorted(chain.from_iterable(moved)) == [1, 2, 3]
    assert moved.index(next(m for m in moved if 2 in m)) <= moved.index(next(m for m in moved if 1 in m))


def places(seed: int, count: int, separation_m: float) -> Array:
    dice = np.random.default_rng(seed)
    cells = dice.choice(5 * 5 * 2, count, replace=False)
    grid = np.stack(np.unravel_index(cells, (5, 5, 2)), axis=1).astype(float)
    return np.asarray(separation_m * 1.2 * (grid - grid[0]) + 0.0)


@given(seed=st.integers(0, 10**6), count=st.integers(2, 14))
def test_any_order_that_is_found_keeps_the_separation(seed: int, count: int) -> None:
    separation_m = 1.5
    here, there = places(seed, count, separation_m), places(seed + 1, count, separation_m)
    stops = find_turns(here, there, separation_m)
    if stops is None:
        return
    for before, after in pairwise(stops):
        assert least_distance(before, after)[0] >= separation_m
        still = (before == after).all(axis=1) | (after == there).all(axis=1)
        assert still.all()
    assert least_gap(stops[-1])[0] >= separation_m
    np.testing.assert_array_equal(stops[-1], there)
    assert reshape(here, there, 0, separation_m).least_distance_m >= separation_m - 1e-9
