"""Fences as shapes on the ground."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.mavlink import FenceCommand, MissionType
from gcs.mission.model import MissionItem
from sim_bridge.missions.fence import count_shapes, shapes, what_is_wrong
from sim_bridge.personality import by_name

ORIGIN = Origin(47.0, 8.0, 400.0)
INSIDE, OUTSIDE, ROUND, ROUND_OUTSIDE, RETURN = 5001, 5002, 5003, 5004, 5000


def at(north_m: float, east_m: float, command: int, value: float) -> MissionItem:
    lat, lon, _ = ned_to_geodetic([north_m, east_m, 0.0], ORIGIN)
    return MissionItem(command, 0, (value, 0.0, 0.0, 0.0), to_degE7(lat), to_degE7(lon), 0.0)


def polygon(corners: list[tuple[float, float]], command: int = INSIDE) -> list[MissionItem]:
    return [at(n, e, command, float(len(corners))) for n, e in corners]


SQUARE = [(100.0, -100.0), (100.0, 100.0), (-100.0, 100.0), (-100.0, -100.0)]
NOTCHED = [(100.0, -100.0), (100.0, 100.0), (0.0, 100.0), (0.0, 0.0), (-100.0, 0.0), (-100.0, -100.0)]


@pytest.mark.parametrize(
    ("place", "violated"),
    [((0.0, 0.0), False), ((99.0, 99.0), False), ((101.0, 0.0), True), ((0.0, -101.0), True), ((300.0, 300.0), True)],
)
def test_a_square_to_stay_inside(place, violated):
    (square,) = shapes(polygon(SQUARE), ORIGIN)
    assert square.violated(*place) == violated
    (reverse,) = shapes(polygon(SQUARE[::-1]), ORIGIN)
    assert reverse.violated(*place) == violated
    (forbidden,) = shapes(polygon(SQUARE, OUTSIDE), ORIGIN)
    assert forbidden.violated(*place) != violated


def test_a_polygon_with_a_notch():
    (notched,) = shapes(polygon(NOTCHED), ORIGIN)
    assert notched.violated(-50.0, 50.0)
    assert not notched.violated(50.0, 50.0)
    assert not notched.violated(-50.0, -50.0)


@given(st.floats(0.0, 200.0), st.floats(-math.pi, math.pi))
def test_circles(distance_m, bearing_rad):
    if abs(distance_m - 60.0) < 0.1:
        return
    place = (10.0 + distance_m * math.cos(bearing_rad), 20.0 + distance_m * math.sin(bearing_rad))
    stay, keep_off = shapes([at(10.0, 20.0, ROUND, 60.0), at(10.0, 20.0, ROUND_OUTSIDE, 60.0)], ORIGIN)
    assert stay.violated(*place) == (distance_m > 60.0)
    assert keep_off.violated(*place) == (distance_m < 60.0)


def test_several_shapes_in_one_fence():
    items = [
        *polygon(SQUARE),
        at(0.0, 0.0, RETURN, 0.0),
        at(40.0, 40.0, ROUND_OUTSIDE, 5.0),
        *polygon(NOTCHED, OUTSIDE),
    ]
    assert [(len(s.corners_ned_m), s.stay_outside) for s in shapes(items, ORIGIN)] == [(4, False), (1, True), (6, True)]
    assert count_shapes(items) == 4  # the return point counts
    assert what_is_wrong(items) is None


@pytest.mark.parametrize(
    "items",
    [
        polygon(SQUARE)[:3],
        polygon(SQUARE[:2]),
        [*polygon(SQUARE)[:3], at(0.0, 0.0, OUTSIDE, 4.0)],
        [at(0.0, 0.0, ROUND, 0.0)],
        [at(0.0, 0.0, ROUND, math.nan)],
        [at(0.0, 0.0, INSIDE, math.nan)],
        [at(0.0, 0.0, INSIDE, 1e30)],
        [at(0.0, 0.0, INSIDE, -3.0)],
    ],
)
def test_what_makes_no_shape_keeps_nobody_in(items):
    assert shapes(items, ORIGIN) == ()
    assert what_is_wrong(items) is not None
    count_shapes(items)


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_a_rally_point_is_no_item_of_a_fence(name: str) -> None:
    storage = by_name(name).missions.storage
    assert int(FenceCommand.RALLY_POINT) in storage[int(MissionType.RALLY)].frames
    assert int(FenceCommand.RALLY_POINT) not in storage[int(MissionType.FENCE)].frames
