"""Generated shapes: right for any number of vehicles, and the shapes their names promise."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from gcs.scenario.schema.formation_table import Generator
from gcs.scenario.values.formations import places_up_m

GENERATORS: tuple[Generator, ...] = get_args(Generator)
FLAT: tuple[Generator, ...] = tuple(g for g in GENERATORS if g != "sphere")
counts = st.integers(1, 300)


@given(st.sampled_from(GENERATORS), counts, st.floats(0.1, 100.0))
def test_every_shape_has_the_leader_at_its_origin_and_neighbours_one_spacing_apart(
    generator: Generator, count: int, spacing_m: float
) -> None:
    places = places_up_m(generator, count, spacing_m)
    assert places.shape == (count, 3)
    assert np.array_equal(places[0], np.zeros(3))
    if count > 1:
        assert pdist(places).min() == pytest.approx(spacing_m, rel=1e-9)


@given(st.sampled_from(FLAT), counts)
def test_all_but_the_sphere_are_level_and_nobody_is_ahead_of_the_leader(generator: Generator, count: int) -> None:
    places = places_up_m(generator, count, 1.0)
    assert not places[:, 2].any()
    assert places[:, 0].max() <= 1e-12


@given(counts)
def test_a_line_is_abreast_and_fills_both_sides_evenly(count: int) -> None:
    east = np.sort(places_up_m("line", count, 2.0)[:, 1])
    assert not places_up_m("line", count, 2.0)[:, 0].any()
    assert np.allclose(np.diff(east), 2.0)
    assert east.max() + east.min() in (0.0, 2.0)


@given(counts)
def test_a_column_is_behind_the_leader(count: int) -> None:
    places = places_up_m("column", count, 3.0)
    assert np.array_equal(places[:, 0], -3.0 * np.arange(count))
    assert not places[:, 1:].any()


@given(st.integers(1, 25))
def test_a_full_triangle_has_rows_of_one_two_three(rows: int) -> None:
    places = places_up_m("triangle", rows * (rows + 1) // 2, 1.0)
    north, numbers = np.unique(places[:, 0].round(9), return_counts=True)
    assert numbers[::-1].tolist() == list(range(1, rows + 1))
    assert np.allclose(np.diff(north), np.sqrt(0.75))
    for row in north:  # each row is centred behind the leader
        assert abs(places[np.isclose(places[:, 0], row), 1].sum()) < 1e-9


def test_a_triangle_of_six_by_hand() -> None:
    h = np.sqrt(0.75)
    expected = [[0, 0], [-h, -0.5], [-h, 0.5], [-2 * h, -1], [-2 * h, 0], [-2 * h, 1]]
    assert np.allclose(places_up_m("triangle", 6, 1.0)[:, :2], expected)


@given(counts)
def test_a_vee_has_two_arms_at_45_degrees(count: int) -> None:
    north, east, _ = places_up_m("vee", count, 1.0).T
    assert np.allclose(north, -np.abs(east))
    right, left = int((east > 0).sum()), int((east < 0).sum())
    assert right - left in (0, 1)


@given(counts)
def test_a_grid_is_as_square_as_the_number_allows(count: int) -> None:
    north, east, _ = places_up_m("grid", count, 1.0).T
    rows, columns = len(np.unique(north)), len(np.unique(east))
    assert columns == int(np.ceil(np.sqrt(count)))
    assert (rows - 1) * columns < count <= rows * columns
    assert len({*zip(north, east, strict=True)}) == count


@given(st.integers(2, 300))
def test_a_circle_is_round_and_the_leader_is_in_front(count: int) -> None:
    places = places_up_m("circle", count, 1.0)
    centre = places.mean(axis=0)
    radius = np.linalg.norm(places - centre, axis=1)
    assert np.allclose(radius, radius[0])
    assert centre[0] < 0 and abs(centre[1]) < 1e-9
    steps = np.linalg.norm(np.diff(places, axis=0, append=places[:1]), axis=1)
    assert np.allclose(steps, 1.0)


@given(st.integers(4, 300))
def test_a_sphere_is_round_and_the_leader_is_at_its_bottom(count: int) -> None:
    places = places_up_m("sphere", count, 1.0)
    # The sphere through all places: |p|² = 2 c.p + k is linear in its centre c.
    system = np.column_stack([2.0 * places, np.ones(count)])
    solution, _, rank, _ = np.linalg.lstsq(system, (places**2).sum(axis=1), rcond=None)
    assert rank == 4  # not in one plane
    radius = np.linalg.norm(places - solution[:3], axis=1)
    assert np.allclose(radius, radius[0], rtol=1e-6)
    assert places[:, 2].min() == 0.0
    # Even enough: places as dense as can be on a sphere, one apart, need 0.26 sqrt(count).
    assert radius[0] < 0.34 * np.sqrt(count)
