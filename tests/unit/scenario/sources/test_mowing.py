"""Passes over closed forms and over random fields: each place is near a track, and no order is quicker."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gcs.scenario.sources.mowing import PassTimes, directions_deg, mowing

WIDEST_M = 10.0
RECTANGLE = shapely.Polygon([(0, 0), (0, 200), (100, 200), (100, 0)])  # 100 m north, 200 m east
MOWN_M = 101.0  # across: a bow of 0.5 m to each side is seen too


def test_a_rectangle_is_mown_along_its_long_side_in_passes_that_divide_it() -> None:
    mown = mowing(RECTANGLE, WIDEST_M, [4])
    assert mown.course_deg % 180.0 == 90.0
    assert len(mown.passes) == 3  # 101 m in strips of at most 40 m
    assert mown.spacing_m == pytest.approx(MOWN_M / 12.0)
    middles_m = sorted({round(begin[0], 6) for begin, _ in mown.passes})
    assert middles_m == pytest.approx([50.0 - MOWN_M / 3.0, 50.0, 50.0 + MOWN_M / 3.0])
    assert all({round(begin[1]), round(end[1])} == {0, 200} for begin, end in mown.passes)


def test_passes_go_there_and_back_and_turn_outside() -> None:
    mown = mowing(RECTANGLE, WIDEST_M, [4], times=PassTimes(4.0, 3.0))
    places = [point.place_m for point in mown.places()]
    lengths_m = [math.dist(a, b) for a, b in itertools.pairwise(places)]
    across_m, lead_m = MOWN_M / 3.0, PassTimes(4.0, 3.0).lead_m
    turn = [lead_m, across_m, lead_m]
    assert lengths_m == pytest.approx([200.0, *turn, 200.0, *turn, 200.0, lead_m])
    assert [point.name for point in mown.places()][:4] == [
        "pass 1 begins",
        "pass 1 ends",
        "after pass 1",
        "before pass 2",
    ]
    assert {round(abs(places[number][1] - 100.0), 6) for number in (2, 3, 6, 7)} == {round(100.0 + lead_m, 6)}
    home_m = math.dist(places[-1], places[0])
    assert mown.time_s == pytest.approx((sum(lengths_m) + home_m) / 4.0 + 6 * 3.0)


def test_the_fewest_vehicles_of_equal_times_fly() -> None:
    assert mowing(shapely.box(0, 0, 38, 300), WIDEST_M, [4, 5, 6]).count == 4  # one pass, whoever flies
    assert mowing(shapely.box(0, 0, 58, 300), WIDEST_M, [4, 5, 6]).count == 6  # one pass, of six only


def test_a_given_course_is_kept() -> None:
    mown = mowing(RECTANGLE, WIDEST_M, [4], course_deg=0.0)
    assert mown.course_deg % 180.0 == 0.0
    assert len(mown.passes) == 6  # 201 m in strips of at most 40 m


def test_more_points_than_a_route_has_are_refused() -> None:
    with pytest.raises(ValueError, match="more than 100 points"):
        mowing(shapely.box(0, 0, 500, 500), WIDEST_M, [1])


def test_passes_stop_at_what_is_avoided_and_cross_what_is_not() -> None:
    pond = shapely.box(40, 80, 60, 120)
    field = shapely.difference(RECTANGLE, pond)
    assert isinstance(field, shapely.Polygon)
    crossed = mowing(field, WIDEST_M, [4], course_deg=90.0)
    assert crossed.lines.intersects(pond)
    beside = mowing(field, WIDEST_M, [4], course_deg=90.0, avoided=pond.buffer(3.0))
    assert len(beside.passes) == len(crossed.passes) + 1
    assert beside.lines.distance(pond) == pytest.approx(3.0, abs=0.01)
    way = shapely.LineString([point.place_m for point in beside.places()])
    assert shapely.hausdorff_distance(way, crossed.lines) < 25.0  # it turns outside only, not before the pond
    assert len(beside.places()) == len(crossed.places()) + 2


def test_directions_are_those_of_edges_once_the_longest_first() -> None:
    assert directions_deg(RECTANGLE) == [90.0, 0.0]
    assert directions_deg(shapely.Polygon([(0, 0), (100, 100), (0, 50)])) == pytest.approx([45.0, 26.565, 90.0])


@st.composite
def fields(draw: st.DrawFn) -> shapely.Polygon:
    """Star-shaped fields of 3 to 9 corners, some with a pond, 20 to 600 m across."""
    corners = draw(st.integers(3, 9))
    turns = np.cumsum(draw(st.lists(st.floats(0.2, 1.0), min_size=corners, max_size=corners)))
    angles = 2.0 * math.pi * turns / turns[-1]
    radii = np.array(draw(st.lists(st.floats(20.0, 300.0), min_size=corners, max_size=corners)))
    field = shapely.Polygon(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))
    assume(field.is_valid and field.area > 500.0)
    pond = shapely.Point(draw(st.floats(-50, 50)), draw(st.floats(-50, 50))).buffer(draw(st.floats(2.0, 15.0)))
    if field.contains(pond) and draw(st.booleans()):
        return shapely.Polygon(field.exterior, [pond.exterior])
    return field


@settings(max_examples=25, deadline=None)
@given(field=fields(), overlap=st.floats(0.0, 0.5), count=st.integers(2, 6))
def test_each_place_of_a_field_is_within_half_a_swath_of_a_track(
    field: shapely.Polygon, overlap: float, count: int
) -> None:
    swath_m = 60.0
    mown = mowing(field, swath_m * (1.0 - overlap), [count])
    seen = mown.lines.buffer(swath_m / 2.0, quad_segs=64)
    assert field.difference(seen).area <= 1e-3 * swath_m
    assert mown.spacing_m <= swath_m * (1.0 - overlap) + 1e-6


@settings(max_examples=25, deadline=None)
@given(field=fields(), aside_m=st.floats(-0.95, 0.95))
def test_tracks_that_are_a_metre_aside_still_cover_the_edges_along_them(field: shapely.Polygon, aside_m: float) -> None:
    swath_m = 12.0
    mown = mowing(field, swath_m - 2.0, [4])
    turn = math.radians(mown.course_deg)
    moved = shapely.affinity.translate(mown.lines, -aside_m * math.sin(turn), aside_m * math.cos(turn))
    assert field.difference(moved.buffer(swath_m / 2.0, quad_segs=64)).area <= 1e-3 * swath_m


@settings(max_examples=15, deadline=None)
@given(field=fields())
def test_no_direction_has_fewer_passes_than_the_best_edge_of_a_convex_field(field: shapely.Polygon) -> None:
    hull = shapely.Polygon(field.convex_hull.exterior)
    fewest = min(len(mowing(hull, WIDEST_M, [6], course_deg=course).passes) for course in directions_deg(hull))
    others = (len(mowing(hull, WIDEST_M, [6], course_deg=float(course)).passes) for course in range(0, 180, 15))
    assert fewest <= min(others)
