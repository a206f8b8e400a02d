"""A thinned line stays within its tolerance, and a track loses its take-off and landing only."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs.mission.drawings.to_scenario.placed_route import airborne, thinned
from gcs.types import Array

points = arrays(float, st.tuples(st.integers(2, 30), st.just(3)), elements=st.floats(-500.0, 500.0))


@settings(deadline=None, max_examples=60)
@given(points, st.floats(0.01, 100.0))
def test_no_point_is_farther_from_the_line_than_the_tolerance(places_m: Array, tolerance_m: float) -> None:
    stays = thinned(places_m, tolerance_m, np.zeros(len(places_m), dtype=bool))
    rows = np.flatnonzero(stays)
    assert (rows[0], rows[-1]) == (0, len(places_m) - 1)
    for first, last in itertools.pairwise(rows):
        share = np.linspace(0.0, 1.0, 400)[:, None]
        line_m = places_m[first] + share * (places_m[last] - places_m[first])
        step_m = np.linalg.norm(places_m[last] - places_m[first]) / 399.0
        for place in places_m[first + 1 : last]:
            assert np.linalg.norm(line_m - place, axis=1).min() <= tolerance_m + step_m


def test_a_level_line_is_thinned_as_shapely_thins_it() -> None:
    north_m = np.linspace(0.0, 300.0, 61)
    places_m = np.column_stack([north_m, 40.0 * np.sin(north_m / 40.0), np.full(61, 20.0)])
    stays = thinned(places_m, 2.0, np.zeros(61, dtype=bool))
    expected = shapely.simplify(shapely.LineString(places_m[:, :2]), 2.0, preserve_topology=False)
    assert places_m[stays][:, :2] == pytest.approx(np.array(expected.coords))


def test_points_that_must_stay_stay() -> None:
    places_m = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    kept = np.array([False, False, True, False, False])
    assert thinned(places_m, 0.1, kept).tolist() == [True, False, True, False, True]


def test_a_hill_in_the_height_alone_stays() -> None:
    places_m = np.array([[0.0, 0.0, 10.0], [50.0, 0.0, 30.0], [100.0, 0.0, 10.0]])
    assert thinned(places_m, 5.0, np.zeros(3, dtype=bool)).all()


@pytest.mark.parametrize(("up_m", "rows"), [((0, 5, 10, 10, 10, 5, 0), (2, 4)), ((10, 10, 10, 10, 10, 10, 10), (0, 6))])
def test_a_take_off_and_a_landing_are_vertical(up_m: tuple[float, ...], rows: tuple[int, int]) -> None:
    north_m = [0.0, 0.1, 0.2, 100.0, 200.0, 200.1, 200.0]
    assert airborne(np.column_stack([north_m, np.zeros(7), up_m])) == rows


def test_a_slope_is_no_take_off() -> None:
    places_m = np.column_stack([np.arange(0.0, 100.0, 10.0), np.zeros(10), np.arange(0.0, 50.0, 5.0)])
    assert airborne(places_m) == (0, 9)
