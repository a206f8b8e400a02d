"""Convex pieces of what is outside an area: half-planes beyond its hull, and parts of its notches."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gcs.scenario.environment.convex_pieces import pieces_outside

CORNERS = st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=3, max_size=9, unique=True)


@settings(max_examples=60, deadline=None)
@given(CORNERS)
def test_pieces_cover_all_outside_and_nothing_inside(corners: list[tuple[int, int]]) -> None:
    area = shapely.Polygon(corners)
    assume(area.is_valid and area.area > 0.5)
    north, east = np.meshgrid(np.linspace(-60.0, 60.0, 61) + 0.137, np.linspace(-60.0, 60.0, 61) + 0.291)
    points = shapely.points(north, east)
    away = shapely.distance(area.exterior, points)
    told = np.min([piece.outside_m(north, east) for piece in pieces_outside(area)], axis=0)
    far = away > 1e-6
    assert np.array_equal((told < 0.0)[far], ~shapely.contains(area, points)[far])
    assert np.all(told[far & (told > 0.0)] <= away[far & (told > 0.0)] + 1e-9)


@pytest.mark.parametrize(
    ("corners", "notches"),
    [
        ([(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)], 0),
        ([(0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (10.0, 10.0), (10.0, 40.0), (0.0, 40.0)], 1),
        ([(0.0, 0.0), (30.0, 0.0), (30.0, 30.0), (20.0, 30.0), (20.0, 10.0), (10.0, 10.0), (10.0, 30.0), (0, 30)], 1),
    ],
)
def test_pieces_are_as_few_as_edges_of_the_hull_and_notches(corners: list[tuple[float, float]], notches: int) -> None:
    area = shapely.Polygon(corners)
    pieces = pieces_outside(area)
    assert len(pieces) == len(area.convex_hull.exterior.coords) - 1 + notches
    beyond = [piece for piece in pieces if not piece.corners_m]
    assert len(beyond) == len(pieces) - notches
    assert all(not np.any(piece.facing(np.array([500.0]), np.array([7.0]))) for piece in beyond)


def test_a_half_plane_has_its_true_distance_everywhere() -> None:
    square = shapely.box(-10.0, -10.0, 10.0, 10.0)
    rng = np.random.default_rng(3)
    north, east = rng.uniform(-40.0, 40.0, (2, 500))
    told = np.min([piece.outside_m(north, east) for piece in pieces_outside(square)], axis=0)
    assert told == pytest.approx(10.0 - np.maximum(np.abs(north), np.abs(east)), abs=1e-12)
