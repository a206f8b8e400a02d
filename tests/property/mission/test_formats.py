"""Readers and writers: every value survives the file, and a damaged file ends in `FileFormatError` or a mission."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs.errors import FileFormatError
from gcs.mission.firmware import Firmware
from gcs.mission.model import Home, MissionItem, SetpointStream
from gcs.mission.planfile import PlanFile, read_plan_file, write_plan_file
from gcs.mission.setpoints import read_setpoints, write_setpoints
from gcs.mission.waypoints import WaypointFile, read_waypoints, write_waypoints

finite = st.floats(allow_nan=False, allow_infinity=False)
params = st.tuples(*[st.floats(allow_infinity=False)] * 4)
homes = st.builds(Home, lat_deg=st.floats(-90, 90), lon_deg=st.floats(-180, 180), alt_amsl_m=finite)
positioned = st.builds(
    MissionItem,
    command=st.integers(0, 0xFFFF),
    frame=st.integers(0, 0xFF).filter(lambda f: f != 2),
    params=params,
    lat_degE7=st.integers(-900_000_000, 900_000_000),
    lon_degE7=st.integers(-1_800_000_000, 1_800_000_000),
    alt_m=finite,
    autocontinue=st.booleans(),
)
int32 = st.integers(-(2**31) + 1, 2**31 - 1)
unpositioned = st.builds(
    MissionItem,
    command=st.integers(0, 0xFFFF),
    frame=st.just(2),
    params=params,
    lat_degE7=int32,
    lon_degE7=int32,
    alt_m=finite,
    autocontinue=st.booleans(),
)
missions = st.lists(st.one_of(positioned, unpositioned), max_size=6).map(tuple)


def comparable(item: MissionItem) -> tuple[Any, ...]:
    """NaN differs from itself, and says "any" here: compare it as a word."""
    words = tuple("nan" if math.isnan(p) else p for p in item.params)
    return item.command, item.frame, words, item.lat_degE7, item.lon_degE7, item.alt_m, item.autocontinue


@given(st.none() | homes, missions)
def test_waypoints_survive(home: Home | None, items: tuple[MissionItem, ...]) -> None:
    text = write_waypoints(WaypointFile(home, items))
    back = read_waypoints(text, "x", home_first=home is not None)
    assert back.home == home
    assert list(map(comparable, back.items)) == list(map(comparable, items))


@given(st.sampled_from(Firmware), homes, missions, finite, finite)
def test_plan_files_survive(
    firmware: Firmware, home: Home, items: tuple[MissionItem, ...], cruise: float, hover: float
) -> None:
    back = read_plan_file(write_plan_file(PlanFile(firmware, home, items, cruise, hover)), "x")
    assert (back.firmware, back.home, back.cruise_speed_mps, back.hover_speed_mps) == (firmware, home, cruise, hover)
    assert list(map(comparable, back.items)) == list(map(comparable, items))


@st.composite
def streams(draw: st.DrawFn) -> SetpointStream:
    sysids = tuple(draw(st.lists(st.integers(1, 254), min_size=1, max_size=4, unique=True)))
    t_ms = sorted(draw(st.lists(st.integers(-100_000, 7_200_000), min_size=1, max_size=5, unique=True)))
    shape = (len(sysids), len(t_ms))
    vectors = [draw(arrays(np.float64, (*shape, 3), elements=finite)) for _ in range(3)]
    return SetpointStream(sysids, np.array(t_ms) / 1000, *vectors, draw(arrays(np.float64, shape, elements=finite)))


@given(streams())
def test_setpoints_survive(stream: SetpointStream) -> None:
    back = read_setpoints(write_setpoints(stream), "x")
    assert back.sysids == stream.sysids
    for name in ("t_s", "position_ned_m", "velocity_ned_mps", "acceleration_ned_mps2", "yaw_ned_rad"):
        assert np.array_equal(getattr(back, name), getattr(stream, name))


HOME = Home(47.397742, 8.545594, 488.0)
ITEMS = (
    MissionItem(22, 3, (0.0, 0.0, 0.0, 45.0), 473976010, 85453731, 2.159),
    MissionItem(178, 2, (1.0, 2.5, -1.0, 0.0), 0, 0, 0.0),
    MissionItem(16, 3, (0.0, 0.0, 0.0, math.nan), 473976018, 85453755, 2.069),
)
STREAM = SetpointStream((1, 2), np.array([0.0, 0.04]), *[np.ones((2, 2, 3))] * 3, np.zeros((2, 2)))
FORMATS: list[tuple[Callable[[bytes, str], Any], bytes]] = [
    (read_waypoints, write_waypoints(WaypointFile(HOME, ITEMS)).encode()),
    (read_plan_file, write_plan_file(PlanFile(Firmware.PX4, HOME, ITEMS)).encode()),
    (read_setpoints, write_setpoints(STREAM).encode()),
]

# Damage that readers stumble over: numbers that are none, too long, or huge; separators; half characters.
shards = st.one_of(
    st.binary(max_size=4),
    st.sampled_from(
        [b"nan", b"inf", b"-", b"1e999", b"9" * 5000, b"\t", b",", b"\n", b"\r", b"\0", b"[", b"null", b'"']
    ),
)


@pytest.mark.parametrize(("read", "whole"), FORMATS, ids=["waypoints", "plan", "setpoints"])
@given(data=st.data())
def test_damage_is_an_error_that_names_the_file(
    read: Callable[[bytes, str], Any], whole: bytes, data: st.DataObject
) -> None:
    damaged = whole
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(damaged)))
        end = data.draw(st.integers(start, min(start + 40, len(damaged))))
        damaged = damaged[:start] + data.draw(shards) + damaged[end:]
    try:
        read(damaged, "damaged")
    except FileFormatError as error:
        assert error.message.startswith("damaged")


@given(st.binary(max_size=300), st.sampled_from([read for read, _ in FORMATS]))
def test_noise_is_no_mission(noise: bytes, read: Callable[[bytes, str], Any]) -> None:
    with pytest.raises(FileFormatError):
        read(noise, "noise")
