"""Readers and writers: every value survives the file, and a damaged file ends in `FileFormatError` or a mission."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.frames import Origin
from gcs.mission.formats.maps.geojson import write_geojson
from gcs.mission.formats.maps.kml import write_kml
from gcs.mission.formats.maps.tracks import MapFile, Track
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.param import ParameterFile, read_parameters, write_parameters
from gcs.mission.formats.point_lists import read_fence_list, read_rally_list
from gcs.mission.formats.qgc_plan import read_mission, read_mission_json, write_mission
from gcs.mission.formats.qgc_wpl import (
    WaypointFile,
    read_fence,
    read_rally,
    read_waypoints,
    write_fence,
    write_rally,
    write_waypoints,
)
from gcs.mission.formats.tables.csv_table import read_csv
from gcs.mission.formats.tables.history_csv import COLUMNS, History, write_history
from gcs.mission.formats.tables.setpoint_table import StreamFile, read_setpoints, write_setpoints
from gcs.mission.formats.tables.setpoints_parquet import read_setpoints_parquet, write_setpoints_parquet
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Home, MissionItem, SetpointStream
from tests.unit.mission.map_tracks import geojson_tracks, kml_tracks

untimed = settings(deadline=None)
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


@untimed
@given(st.none() | homes, missions)
def test_waypoints_survive(home: Home | None, items: tuple[MissionItem, ...]) -> None:
    text = write_waypoints(WaypointFile(home, items))
    back = read_waypoints(text, "x", home_first=home is not None)
    assert back.home == home
    assert back.quirks == ()
    assert list(map(comparable, back.items)) == list(map(comparable, items))


places = st.builds(
    GeoPoint,
    lat_degE7=st.integers(-900_000_000, 900_000_000),
    lon_degE7=st.integers(-1_800_000_000, 1_800_000_000),
)
radii = st.floats(0, exclude_min=True, allow_infinity=False)
rally_points = st.builds(RallyPoint, places, finite)
fences = st.builds(
    Geofence,
    st.lists(
        st.builds(FencePolygon, st.lists(places, min_size=3, max_size=6).map(tuple), st.booleans()), max_size=3
    ).map(tuple),
    st.lists(st.builds(FenceCircle, places, radii, st.booleans()), max_size=3).map(tuple),
    st.none() | rally_points,
)
rallies = st.lists(rally_points, max_size=3).map(tuple)


@untimed
@given(st.sampled_from(Autopilot), homes, missions, st.floats(1e-3, 1e3), fences, rallies)
def test_plan_files_survive(
    firmware: Autopilot,
    home: Home,
    items: tuple[MissionItem, ...],
    speed_mps: float,
    fence: Geofence,
    rally: tuple[RallyPoint, ...],
) -> None:
    back = read_mission(write_mission(MissionFile("x", firmware, home, items, fence, rally, speed_mps)), "x")
    assert (back.firmware, back.home, back.speed_mps) == (firmware, home, speed_mps)
    assert (back.geofence, back.rally) == (fence, rally)
    assert list(map(comparable, back.items)) == list(map(comparable, items))


@untimed
@given(fences, rallies)
def test_fences_and_rally_points_survive(fence: Geofence, rally: tuple[RallyPoint, ...]) -> None:
    assert read_fence(write_fence(fence), "x") == fence
    assert read_rally(write_rally(rally), "x") == rally


names = st.from_regex(r"[A-Z0-9_]{1,16}", fullmatch=True)
values = st.integers(-(2**31), 2**31 - 1) | finite


@untimed
@given(st.sampled_from(Autopilot), st.integers(1, 10_000), st.dictionaries(names, values, max_size=5))
def test_parameters_survive(firmware: Autopilot, sysid: int, table: dict[str, int | float]) -> None:
    file = ParameterFile(firmware, sysid, tuple(table.items()))
    back = read_parameters(write_parameters(file), "x", firmware)
    assert back == file
    assert [type(v) for _, v in back.values] == [type(v) for v in table.values()]


@st.composite
def streams(draw: st.DrawFn) -> SetpointStream:
    sysids = tuple(draw(st.lists(st.integers(1, 254), min_size=1, max_size=4, unique=True)))
    t_ms = sorted(draw(st.lists(st.integers(-100_000, 7_200_000), min_size=1, max_size=5, unique=True)))
    shape = (len(sysids), len(t_ms))
    vectors = [draw(arrays(np.float64, (*shape, 3), elements=finite)) for _ in range(3)]
    return SetpointStream(sysids, np.array(t_ms) / 1000, *vectors, draw(arrays(np.float64, shape, elements=finite)))


origins = st.none() | st.builds(Origin, finite, finite, finite)
hashes = st.text("0123456789abcdef", max_size=64)


@pytest.mark.parametrize(
    ("write", "read"),
    [(write_setpoints, read_setpoints), (write_setpoints_parquet, read_setpoints_parquet)],
    ids=["csv", "parquet"],
)
@untimed
@given(stream=streams(), plan_hash=hashes, origin=origins)
def test_setpoints_survive(
    write: Callable[[StreamFile], bytes],
    read: Callable[[bytes, str], StreamFile],
    stream: SetpointStream,
    plan_hash: str,
    origin: Origin | None,
) -> None:
    back = read(write(StreamFile(stream, plan_hash, origin)), "x")
    assert (back.plan_hash, back.origin, back.stream.sysids) == (plan_hash, origin, stream.sysids)
    for name in ("t_s", "position_ned_m", "velocity_ned_mps", "acceleration_ned_mps2", "yaw_ned_rad"):
        assert np.array_equal(getattr(back.stream, name), getattr(stream, name))


@st.composite
def histories(draw: st.DrawFn) -> History:
    t_s = np.array(sorted(draw(st.lists(finite, min_size=1, max_size=5, unique=True))))
    states, controls = (draw(arrays(np.float64, (len(t_s), width), elements=finite)) for width in (12, 4))
    return History(draw(st.integers(1, 10_000)), draw(hashes), t_s, states, controls)


@untimed
@given(histories())
def test_histories_survive(history: History) -> None:
    comments, table = read_csv(write_history(history), COLUMNS)
    assert (comments["vehicle"], comments.get("plan", "")) == (str(history.sysid), history.plan_hash)
    values = np.column_stack([table.column(name).to_numpy() for name in COLUMNS])
    assert np.array_equal(values, np.column_stack([history.t_s, history.states, history.controls]))


@st.composite
def tracks(draw: st.DrawFn, sysid: int) -> Track:
    t_ms = sorted(draw(st.lists(st.integers(-100_000, 7_200_000), min_size=1, max_size=5, unique=True)))
    ranges = ((-90, 90), (-180, 180), (-1e4, 1e4))
    parts = [draw(arrays(np.float64, len(t_ms), elements=st.floats(*bounds))) for bounds in ranges]
    return Track(sysid, np.array(t_ms) / 1000, *parts)


@st.composite
def maps(draw: st.DrawFn) -> MapFile:
    title = draw(st.text(st.characters(min_codepoint=32, exclude_categories=("Cs", "Cc", "Cn")), max_size=20))
    sysids = draw(st.lists(st.integers(1, 10_000), max_size=3, unique=True))
    fence = draw(fences)
    return MapFile(
        title.strip(),
        draw(hashes),
        tuple(draw(tracks(sysid)) for sysid in sysids),
        Geofence(fence.polygons, fence.circles),
    )


@pytest.mark.parametrize(("write", "read"), [(write_kml, kml_tracks), (write_geojson, geojson_tracks)])
@untimed
@given(drawn=maps())
def test_tracks_survive(
    write: Callable[[MapFile], str | bytes], read: Callable[[str | bytes], list[Track]], drawn: MapFile
) -> None:
    for ours, theirs in zip(drawn.tracks, read(write(drawn)), strict=True):
        assert ours.sysid == theirs.sysid
        for name in ("t_s", "lat_deg", "lon_deg", "alt_amsl_m"):
            assert np.array_equal(getattr(ours, name), getattr(theirs, name))


HOME = Home(47.397742, 8.545594, 488.0)
ITEMS = (
    MissionItem(22, 3, (0.0, 0.0, 0.0, 45.0), 473976010, 85453731, 2.159),
    MissionItem(178, 2, (1.0, 2.5, -1.0, 0.0), 0, 0, 0.0),
    MissionItem(16, 3, (0.0, 0.0, 0.0, math.nan), 473976018, 85453755, 2.069),
)
STREAM = StreamFile(
    SetpointStream((1, 2), np.array([0.0, 0.04]), *[np.ones((2, 2, 3))] * 3, np.zeros((2, 2))),
    "abc",
    Origin(47, 8, 488),
)
CORNERS = (GeoPoint(473970000, 85450000), GeoPoint(473980000, 85450000), GeoPoint(473980000, 85460000))
FENCE = Geofence((FencePolygon(CORNERS, True),), (FenceCircle(CORNERS[0], 12.5, False),), RallyPoint(CORNERS[1], 5.0))
RALLY = (RallyPoint(CORNERS[2], 20.0),)
FENCE_LIST = "47.1 8.5\n47 8\n47.2\t8.1\n47.3 8.1\n47.3 8.0\n47 8\n"
MISSION_JSON = """{"MAV_AUTOPILOT": 12, "items": [{"type": "missionItem", "id": 1, "command": 22, "frame": 3,
"param1": 0, "param2": 0, "param3": 0, "param4": 0, "coordinate": [47.3, 8.5, 10]}], "version": "1.0",
"plannedHomePosition": {"coordinate": [47.3, 8.5, 488]}}"""
PARAMETERS = (("RTL_ALT", 5123), ("RTL_CONE_SLOPE", 0.5))


def encoded(data: str | bytes) -> bytes:
    return data.encode() if isinstance(data, str) else data


FORMATS: dict[str, tuple[Callable[[bytes, str], Any], bytes]] = {
    name: (read, encoded(data))
    for name, read, data in (
        ("waypoints", read_waypoints, write_waypoints(WaypointFile(HOME, ITEMS))),
        ("plan", read_mission, write_mission(MissionFile("x", Autopilot.PX4, HOME, ITEMS, FENCE, RALLY, 5.0))),
        ("mission", read_mission_json, MISSION_JSON),
        ("fence list", read_fence_list, FENCE_LIST),
        ("rally list", read_rally_list, "RALLY 47.3 8.5 20.5 0 0 0\nRALLY 47.4 8.5 20 40 0 1\n"),
        ("fence", read_fence, write_fence(FENCE)),
        ("rally", read_rally, write_rally(RALLY)),
        ("setpoints", read_setpoints, write_setpoints(STREAM)),
        ("parquet", read_setpoints_parquet, write_setpoints_parquet(STREAM)),
        (
            "param",
            partial(read_parameters, firmware=Autopilot.ARDUPILOT),
            write_parameters(ParameterFile(Autopilot.ARDUPILOT, 1, PARAMETERS)),
        ),
        (
            "params",
            partial(read_parameters, firmware=Autopilot.PX4),
            write_parameters(ParameterFile(Autopilot.PX4, 1, PARAMETERS)),
        ),
    )
}

# Damage that readers stumble over: numbers that are none, too long, or huge; separators; half characters.
shards = st.one_of(
    st.binary(max_size=4),
    st.sampled_from(
        [b"nan", b"inf", b"-", b"1e999", b"9" * 5000, b"\t", b",", b"\n", b"\r", b"\0", b"[", b"null", b'"', b"<", b"#"]
    ),
)


@pytest.mark.parametrize(("read", "whole"), FORMATS.values(), ids=FORMATS)
@untimed
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


@pytest.mark.parametrize(("read", "whole"), FORMATS.values(), ids=FORMATS)
@untimed
@given(data=st.data())
def test_a_file_cut_short_is_refused_or_as_good_as_whole(
    read: Callable[[bytes, str], Any], whole: bytes, data: st.DataObject
) -> None:
    """Tables of items have no end mark: what is left of them, line by line, is a shorter mission."""
    end = data.draw(st.integers(0, len(whole) - 1))
    try:
        read(whole[:end], "cut")
    except FileFormatError:
        return
    by_lines = whole.startswith((b"QGC WPL", b"RALLY", b"# vehicle", b"# Onboard"))
    assert by_lines or whole[end:].strip() in (b"", b"1")


@untimed
@given(st.binary(max_size=300), st.sampled_from([f for f in FORMATS if not f.startswith("param")]))
def test_noise_is_no_mission(noise: bytes, form: str) -> None:
    with pytest.raises(FileFormatError):
        FORMATS[form][0](noise, "noise")
