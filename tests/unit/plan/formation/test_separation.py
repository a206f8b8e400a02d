"""The least distance is exact: against dense sampling, closed cases, and at any number of vehicles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from gcs.plan.formation.separation import least_distance, least_gap, near_point, pairs_nearer_than


def test_two_that_change_places_meet_in_the_middle() -> None:
    here = np.array([[0.0, 0.0, 0.0], [9.0, 9.0, 9.0], [4.0, 0.0, 0.0]])
    there = np.array([[4.0, 0.0, 0.0], [9.0, 9.0, 9.0], [0.0, 0.0, 0.0]])
    assert least_distance(here, there) == (0.0, 0, 2)
    assert pairs_nearer_than(here, there, 1e-6).tolist() == [[0, 2]]


def test_crossing_paths_are_nearest_where_calculus_says() -> None:
    """Relative way from (3, 4) to (3, -2): nearest beside each other, 3 m apart."""
    here = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    there = np.array([[10.0, 5.0, 0.0], [13.0, 3.0, 0.0]])
    assert least_distance(here, there) == (3.0, 0, 1)


def test_those_that_part_or_stay_are_nearest_at_an_end() -> None:
    here = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert least_distance(here, 3.0 * here)[0] == 1.0
    assert least_distance(3.0 * here, here)[0] == 1.0
    assert least_distance(here, here)[0] == 1.0


@pytest.mark.parametrize("count", [2, 3, 40, 129, 260])
def test_it_is_the_least_of_all_instants(count: int) -> None:
    random = np.random.default_rng(count)
    here, there = random.normal(size=(2, count, 3)) * count ** (1 / 3) * 3.0
    distance, i, j = least_distance(here, there)
    share = np.linspace(0.0, 1.0, 401)
    ways = here[:, None] + share[:, None] * (there - here)[:, None]
    sampled = np.array([pdist(ways[:, k]).min() for k in range(len(share))])
    assert distance <= sampled.min() + 1e-12
    assert i < j
    pair = np.linalg.norm(
        here[j]
        - here[i]
        + np.linspace(0, 1, 100001)[:, None] * (there - here)[[j]]
        - np.linspace(0, 1, 100001)[:, None] * (there - here)[[i]],
        axis=1,
    )
    assert distance == pytest.approx(pair.min(), rel=1e-5)
    near = pairs_nearer_than(here, there, 1.2 * distance)
    assert [i, j] in near.tolist()
    assert not len(pairs_nearer_than(here, there, 0.999 * distance))


def test_a_rigid_shape_is_as_tight_as_its_nearest_two() -> None:
    places = np.random.default_rng(8).normal(size=(300, 3))
    distance, i, j = least_gap(places)
    assert distance == pytest.approx(pdist(places).min())
    assert np.linalg.norm(places[i] - places[j]) == pytest.approx(distance)
    assert least_distance(places, places) == (pytest.approx(distance), i, j)


def test_two_in_the_same_place_and_one_alone() -> None:
    assert least_gap(np.array([[5.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])) == (0.0, 1, 2)
    assert least_gap(np.zeros((1, 3)))[0] == np.inf
    assert least_distance(np.zeros((1, 3)), np.ones((1, 3)))[0] == np.inf
    assert len(pairs_nearer_than(np.zeros((1, 3)), np.ones((1, 3)), 1.0)) == 0


def test_ways_past_a_point_that_stays() -> None:
    here = np.array([[-3.0, 2.0, 0.0], [5.0, 0.0, 0.0]])
    there = np.array([[3.0, 2.0, 0.0], [9.0, 0.0, 0.0]])
    np.testing.assert_allclose(near_point(here, there, np.zeros(3)), [2.0, 5.0])
