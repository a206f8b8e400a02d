"""Ways back round no-fly zones: they keep out, stay inside, and are as short as a fine grid finds them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from gcs.mission.returns.fence_areas import inclusion_corners, planned_places_m, swept_area
from gcs.mission.returns.return_routes import CLEARANCES_M, ReturnRoutes
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outside_m
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

LEAST_M = min(CLEARANCES_M)


def inclusion(plan: Plan) -> shapely.Polygon:
    return shapely.Polygon(inclusion_corners(planned_places_m(plan)))


def along(way: Array, step_m: float = 0.5) -> Array:
    """Places (N, 2) along a way."""
    if not np.ptp(way, axis=0).any():
        return way
    return shapely.get_coordinates(shapely.segmentize(shapely.LineString(way), step_m))


def with_zones(plan: Plan, *zones: NoFlyZone) -> Plan:
    return replace(plan, scenario=plan.scenario.model_copy(update={"no_fly": zones}))


def test_every_vehicle_returns_round_both_zones_from_every_instant(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("field/scenario.toml")
    routes, fence = ReturnRoutes(plan), inclusion(plan)
    t_s = np.linspace(plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf), 60)
    places = plan.states(t_s)[..., POSITION][..., :2]
    crossed = 0
    for row, end in enumerate(plan.pads_ned_m[:, :2]):
        for start in places[row]:
            way = routes.way_ned_m(start, end)
            assert way is not None
            assert way[0].tolist() == start.tolist()
            assert way[-1].tolist() == end.tolist()
            length_m = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
            assert length_m == pytest.approx(routes.length_m(start, end))
            assert length_m >= np.linalg.norm(end - start) - 1e-9
            assert shapely.contains_properly(fence, shapely.LineString(way))
            north, east = along(way).T
            outside = np.array([outside_m(zone, np.zeros(1), north, east).min() for zone in plan.scenario.no_fly])
            # Only a vehicle that stands within the clearance begins there, and moves away from it.
            start_outside = [outside_m(z, np.zeros(1), *start[:, None])[0] for z in plan.scenario.no_fly]
            assert (outside >= np.minimum(start_outside, LEAST_M) - 1e-6).all()
            straight = along(np.stack([start, end]))
            crossed += min(outside_m(z, np.zeros(1), *straight.T).min() for z in plan.scenario.no_fly) < 0.0
    assert crossed > 60  # the straight ways cross


@settings(max_examples=60, deadline=None)
@given(
    zones=st.lists(
        st.tuples(
            st.floats(50.0, 650.0), st.floats(-80.0, 80.0), st.floats(5.0, 60.0), st.integers(0, 7), st.floats(0, 6.2)
        ),
        max_size=5,
    ),
    start=st.tuples(st.floats(0.0, 700.0), st.floats(-100.0, 100.0)),
    end=st.tuples(st.floats(0.0, 700.0), st.floats(-100.0, 100.0)),
)
def test_ways_keep_out_of_any_zones_and_inside_the_fence(
    plan_of: Callable[[str], Plan],
    zones: list[tuple[float, float, float, int, float]],
    start: tuple[float, float],
    end: tuple[float, float],
) -> None:
    plan = with_zones(plan_of("field/scenario.toml"), *(zone(*values) for values in zones))
    routes, fence = ReturnRoutes(plan), inclusion(plan)
    ends = np.array([start, end])
    way = routes.way_ned_m(*ends)
    keeps_out = shapely.union_all([swept_area(z, LEAST_M, 0.0, 0.0) for z in plan.scenario.no_fly])
    allowed = fence.buffer(-LEAST_M, join_style="mitre").difference(keeps_out)
    if not shapely.covers(allowed, shapely.points(ends)).all():
        return
    wide = swept(plan, CLEARANCES_M[0])
    straight_is_free = not shapely.intersects(wide, shapely.LineString(ends)) and shapely.covers(
        fence.buffer(-CLEARANCES_M[0], join_style="mitre"), shapely.LineString(ends)
    )
    if way is None:
        parts = [part for part in shapely.get_parts(allowed) if shapely.intersects(part, shapely.points(ends)).any()]
        assert not any(shapely.covers(part.buffer(-0.1), shapely.points(ends)).all() for part in parts)
        return
    line = shapely.LineString(way)
    assert shapely.covers(allowed.buffer(1e-6), line)
    assert line.length >= np.linalg.norm(ends[1] - ends[0]) - 1e-9
    if straight_is_free:
        assert line.length == pytest.approx(float(np.linalg.norm(ends[1] - ends[0])), abs=1e-9)
    backwards = routes.length_m(ends[1], ends[0])
    # Corners of ways stand 0.02 m outside, so an end beside an edge may see another one than its counterpart.
    assert backwards == pytest.approx(line.length, abs=0.02)
    assert routes.way_ned_m(*ends).tolist() == ReturnRoutes(plan).way_ned_m(*ends).tolist()


def zone(north_m: float, east_m: float, size_m: float, corners: int, turn: float) -> NoFlyZone:
    if corners < 3:
        return NoFlyZone(north_m=north_m, east_m=east_m, radius_m=size_m)
    angles = turn + np.arange(corners) * 2 * np.pi / corners
    sizes = np.where(np.arange(corners) % 2, size_m, 0.45 * size_m)  # a star: not convex
    north, east = north_m + sizes * np.cos(angles), east_m + sizes * np.sin(angles)
    return NoFlyZone(polygon_m=tuple(zip(north, east, strict=True)))


def swept(plan: Plan, clearance_m: float) -> shapely.Geometry:
    return shapely.union_all([swept_area(z, clearance_m, 0.0, 0.0) for z in plan.scenario.no_fly])


@pytest.mark.parametrize(
    "zones",
    [
        [(200.0, -20.0, 60.0, 0, 0.0)],
        [(200.0, -40.0, 50.0, 5, 0.3), (330.0, 30.0, 50.0, 4, 1.0), (450.0, 60.0, 55.0, 0, 0.0)],
    ],
)
def test_ways_are_as_short_as_on_a_fine_grid(
    plan_of: Callable[[str], Plan], zones: list[tuple[float, float, float, int, float]]
) -> None:
    plan = with_zones(plan_of("field/scenario.toml"), *(zone(*values) for values in zones))
    start, end = np.array([600.0, 50.0]), np.array([0.0, 0.0])
    found_m = ReturnRoutes(plan).length_m(start, end)
    allowed = inclusion(plan).buffer(-CLEARANCES_M[0], join_style="mitre").difference(swept(plan, CLEARANCES_M[0]))
    grid_m = on_grid_m(allowed, start, end, 2.0)
    assert found_m <= grid_m + 1e-6
    assert found_m >= 0.985 * grid_m - 2.0  # 16 directions are up to 1.4 % longer
    assert found_m > np.linalg.norm(end - start) + 1.0


def on_grid_m(allowed: shapely.Geometry, start: Array, end: Array, step_m: float) -> float:
    """The shortest way on a grid with legs in 16 directions. Start and end are places of the grid."""
    low, high = (np.floor(np.array(allowed.bounds).reshape(2, 2) / step_m) * step_m + [[0.0], [step_m]]).tolist()
    north, east = (np.arange(a, b + step_m / 2, step_m) for a, b in zip(low, high, strict=True))
    shapely.prepare(allowed)
    n, e = np.meshgrid(north, east, indexing="ij")
    number = np.arange(n.size).reshape(n.shape)
    rows, columns, lengths = [], [], []
    for di, dj in [(1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)]:
        here = number[: n.shape[0] - di, max(0, -dj) : n.shape[1] - max(0, dj)].ravel()
        there = here + di * n.shape[1] + dj
        places = np.stack([n.ravel(), e.ravel()], axis=1)
        free = shapely.covers(allowed, shapely.linestrings(np.stack([places[here], places[there]], axis=1)))
        rows.append(here[free])
        columns.append(there[free])
        lengths.append(np.full(int(free.sum()), step_m * math.hypot(di, dj)))
    graph = coo_array(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(n.size, n.size)
    ).tocsr()
    places = np.stack([n.ravel(), e.ravel()], axis=1)
    first, last = (int(np.argmin(np.linalg.norm(places - place, axis=1))) for place in (start, end))
    assert np.allclose(places[[first, last]], [start, end])
    return float(dijkstra(graph, directed=False, indices=first)[last])


def test_a_vehicle_in_a_zone_leaves_it_by_the_nearest_edge(plan_of: Callable[[str], Plan]) -> None:
    plan = with_zones(plan_of("field/scenario.toml"), NoFlyZone(north_m=300.0, east_m=0.0, radius_m=50.0))
    start = np.array([300.0, 45.0])
    way = ReturnRoutes(plan).way_ned_m(start, np.zeros(2))
    assert way is not None
    assert np.linalg.norm(way[1] - [300.0, 53.0]) < 1.5  # the nearest edge, with the clearance
    assert outside_m(plan.scenario.no_fly[0], np.zeros(1), *along(way[1:]).T).min() >= LEAST_M


def test_no_way_is_told_as_none(plan_of: Callable[[str], Plan]) -> None:
    wall = NoFlyZone(polygon_m=((300.0, -500.0), (300.0, 500.0), (310.0, 500.0), (310.0, -500.0)))
    routes = ReturnRoutes(with_zones(plan_of("field/scenario.toml"), wall))
    start, end = np.array([500.0, 70.0]), np.zeros(2)
    assert routes.way_ned_m(start, end) is None
    assert routes.length_m(start, end) == math.inf
    assert routes.way_ned_m(np.array([200.0, 0.0]), end) is not None


def test_a_moving_zone_counts_where_it_will_be(plan_of: Callable[[str], Plan]) -> None:
    """It stands aside when the return begins, and would meet the vehicle half way home."""
    plan = plan_of("field/scenario.toml")
    moving = NoFlyZone(
        north_m=300.0, east_m=-300.0, radius_m=20.0, moves=((0.0, 0.0, 0.0), (60.0, 0.0, 300.0), (400.0, 0.0, 300.0))
    )
    plan = with_zones(plan, moving)
    start, end = np.array([500.0, 0.0]), np.zeros(2)
    way = ReturnRoutes(plan).way_ned_m(start, end, 0.0)
    assert way is not None
    for t_s in np.linspace(0.0, 300.0, 40):
        assert outside_m(moving, np.array([t_s]), *along(way).T).min() >= LEAST_M
    north, east = along(np.stack([start, end])).T
    assert outside_m(moving, np.zeros(1), north, east).min() > 100.0
    assert outside_m(moving, np.array([60.0]), north, east).min() < 0.0
