"""No-fly zones: disks and polygons of any shape, standing and moving, and what is wrong with some."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from gcs.scenario.environment.convex_pieces import Convex
from gcs.scenario.environment.no_fly import (
    displacement_m,
    in_words,
    narrowed,
    nearest_zone_m,
    outline,
    outside_m,
    pieces,
    signed_distance_m,
    zone_names,
    zones,
)
from gcs.scenario.schema.scenario import KeepIn, NoFlyZone, Scenario

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


def area(*corners: tuple[float, float]) -> KeepIn:
    return KeepIn(polygon_m=corners)


YARD = area((0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (0.0, 60.0))


def test_outside_a_keep_in_area_is_a_zone(simulation1: Scenario) -> None:
    scenario = simulation1.model_copy(update={"keep_in": (YARD, YARD), "no_fly": (zone(polygon_m=L_SHAPE),)})
    assert [str(name) for name in zone_names(scenario)] == ["keep-in area 1", "keep-in area 2", "no-fly zone 1"]
    assert [name.edge for name in zone_names(scenario)][1:] == ["the edge of keep-in area 2", "no-fly zone 1"]
    assert zones(scenario)[-1] == scenario.no_fly[0]  # those that a re-plan adds are the last
    assert in_words(scenario) == "keep-in areas and no-fly zones"
    north, east = np.array([50.0, 95.0, 107.0, 103.0, 0.0]), np.array([20.0, 30.0, 30.0, 64.0, 60.0])
    true_m = [20.0, 5.0, -7.0, -5.0, 0.0]
    assert signed_distance_m(YARD, north, east) == pytest.approx(true_m)
    assert nearest_zone_m((YARD,), np.zeros(5), north, east) == pytest.approx(true_m)
    assert outside_m(YARD, np.array(0.0), north, east)[:3] == pytest.approx(true_m[:3])
    assert np.array_equal(shapely.intersects(outline(YARD), shapely.points(north, east)), np.array(true_m) <= 0.0)


@settings(deadline=None)
@given(st.floats(0.01, 29.9), st.floats(-20.0, 120.0), st.floats(-20.0, 80.0))
def test_a_narrowed_area_is_that_much_smaller(margin_m: float, north_m: float, east_m: float) -> None:
    smaller = narrowed(YARD, margin_m, (50.0, 30.0))
    at = (np.array(0.0), np.array(north_m), np.array(east_m))
    assert float(outside_m(smaller, *at)) == pytest.approx(float(outside_m(YARD, *at)) - margin_m, abs=1e-9)


def test_of_an_area_that_falls_apart_the_part_at_the_start_is_left() -> None:
    """Two yards with a neck of 4 m between them."""
    west = [(0.0, 0.0), (40.0, 0.0), (40.0, 18.0), (60.0, 18.0), (60.0, 0.0), (100.0, 0.0)]
    necked = area(*west, *((north_m, 40.0 - east_m) for north_m, east_m in west[::-1]))
    assert narrowed(necked, 0.0, (20.0, 20.0)) is necked
    assert len(shapely.get_parts(narrowed(necked, 1.0, (20.0, 20.0)).area)) == 1
    assert narrowed(necked, 1.0, (20.0, 20.0)).area.contains(shapely.Point(80.0, 20.0))
    for north_m, other_m in ((20.0, 80.0), (80.0, 20.0)):
        left = narrowed(necked, 3.0, (north_m, 20.0)).area
        assert left.contains(shapely.Point(north_m, 20.0)) and not left.contains(shapely.Point(other_m, 20.0))
    assert narrowed(necked, 30.0, (20.0, 20.0)) == necked  # no place keeps this margin
