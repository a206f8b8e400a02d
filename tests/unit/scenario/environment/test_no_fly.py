"""No-fly zones: disks and polygons of any shape, standing and moving, and what is wrong with some."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from gcs.scenario.environment.no_fly import Convex, displacement_m, outline, outside_m, pieces
from gcs.scenario.schema.scenario import NoFlyZone

L_SHAPE = ((0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (10.0, 10.0), (10.0, 40.0), (0.0, 40.0))
STAR = tuple(
    (float(r * np.cos(a)), float(r * np.sin(a)))
    for r, a in zip([20.0, 8.0] * 5, np.linspace(0.0, 2.0 * np.pi, 10, endpoint=False), strict=True)
)


def zone(**keys: Any) -> NoFlyZone:
    return NoFlyZone.model_validate(keys)


@pytest.mark.parametrize(("corners", "count"), [(L_SHAPE, 2), (STAR, 6), (L_SHAPE[:3], 1)])
def test_a_polygon_is_inside_exactly_where_it_is(corners: tuple[tuple[float, float], ...], count: int) -> None:
    area = zone(polygon_m=corners)
    assert len(pieces(area)) <= count
    rng = np.random.default_rng(1)
    north, east = rng.uniform(-30.0, 50.0, (2, 4000))
    away = shapely.distance(outline(area), shapely.points(north, east))
    told = outside_m(area, np.array(0.0), north, east)
    assert np.array_equal(told < 0.0, away == 0.0)
    assert np.all(told <= away + 1e-9)
    assert np.all(told[away > 0.0] >= 0.15 * away[away > 0.0] - 1e-9)  # beside a corner less, and not without limit


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=3, max_size=9, unique=True))
def test_pieces_cover_any_polygon_and_nothing_else(corners: list[tuple[int, int]]) -> None:
    whole = shapely.Polygon(corners)
    assume(whole.is_valid and whole.area > 0.5)
    area = zone(polygon_m=[[float(n), float(e)] for n, e in corners])
    assert all(isinstance(piece, Convex) for piece in pieces(area))
    grid = np.meshgrid(np.linspace(-21.0, 21.0, 43) + 0.137, np.linspace(-21.0, 21.0, 43) + 0.291)
    inside = shapely.contains_xy(whole, grid[0], grid[1])
    near_the_edge = shapely.distance(whole.exterior, shapely.points(*grid)) < 1e-6
    told = outside_m(area, np.array(0.0), *grid) < 0.0
    assert np.all((told == inside) | near_the_edge)


def test_a_moving_zone_is_where_it_is_at_the_time() -> None:
    disk = zone(north_m=10.0, east_m=0.0, radius_m=5.0, moves=[[10.0, 0.0, 0.0], [20.0, 0.0, 40.0]])
    assert displacement_m(disk, np.array([0.0, 15.0, 99.0])) == pytest.approx(
        np.array([[0.0, 0.0], [0.0, 20.0], [0.0, 40.0]])
    )
    away = outside_m(disk, np.array([0.0, 15.0, 99.0]), np.full((2, 3), 10.0), np.full((2, 3), 20.0))
    assert away == pytest.approx(np.tile([15.0, -5.0, 15.0], (2, 1)))


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"north_m": 1.0, "radius_m": 2.0}, "east_m: missing; a disk needs"),
        ({"polygon_m": L_SHAPE, "radius_m": 2.0}, "polygon_m: stands beside radius_m. Keep the polygon or the disk"),
        ({"polygon_m": L_SHAPE[:2]}, "polygon_m: has 2 corners; a polygon needs at least 3"),
        (
            {"polygon_m": [[0.0, 0.0], [9.0, 9.0], [0.0, 9.0], [9.0, 0.0]]},
            r"crosses itself: Self-intersection\[4.5 4.5",
        ),
        ({"polygon_m": [[0.0, 0.0], [4.0, 4.0], [9.0, 9.0]]}, "polygon_m: "),
        (
            {"north_m": 1.0, "east_m": 1.0, "radius_m": 2.0, "moves": [[9.0, 0.0, 0.0], [9.0, 1.0, 0.0]]},
            "moves: must be in order of time",
        ),
    ],
)
def test_what_is_no_zone_says_why(keys: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        zone(**keys)
