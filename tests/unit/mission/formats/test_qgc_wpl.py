"""`.waypoints`: what other programs wrote, what is refused, and what pymavlink's own reader makes of ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.errors import FileFormatError
from gcs.mission.formats.qgc_wpl import WaypointFile, read_waypoints, write_waypoints
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.model import Home, MissionItem

HOME = Home(-35.363262, 149.165237, 584.09)
ITEMS = (
    MissionItem(22, 3, (0.0, 0.0, 0.0, 45.0), -353632620, 1491652370, 2.159),
    MissionItem(93, 2, (5.0, -1.0, -1.0, -1.0), 0, 0, 0.0),
    MissionItem(178, 2, (1.0, 0.1 + 0.2, -1.0, 0.0), 0, 0, 0.0),
    MissionItem(16, 3, (0.0, 0.0, 0.0, 359.99), -353632617, 1491652373, 1 / 3),
    MissionItem(203, 2, (0.0, 0.0, 0.0, 0.0), 1, -7, 0.0, autocontinue=False),
)
FROM_MISSION_PLANNER = (
    "QGC WPL 110\r\n"
    "0\t1\t0\t16\t0\t0\t0\t0\t-35.3632621\t149.1652374\t584.09\t1\r\n"
    "1\t0\t3\t22\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t20.000000\t1\r\n"
    "2\t0\t10\t16\t0\t0\t0\t0\t-35.36151890\t149.16507720\t30.000000\t1\r\n"
)


@pytest.mark.parametrize("home", [HOME, None])
def test_what_is_written_is_read(home: Home | None) -> None:
    file = WaypointFile(home, ITEMS)
    assert read_waypoints(write_waypoints(file), "x", home_first=home is not None) == file


def test_mission_planner_writes_crlf_and_short_numbers() -> None:
    file = read_waypoints(FROM_MISSION_PLANNER.encode(), "mp.waypoints")
    assert file.home == Home(-35.3632621, 149.1652374, 584.09)
    assert file.items[1] == MissionItem(16, 10, (0.0, 0.0, 0.0, 0.0), -353615189, 1491650772, 30.0)


def test_comments_and_the_command_mission_planner_once_wrote_for_home() -> None:
    lines = FROM_MISSION_PLANNER.replace("\t0\t16\t", "\t0\t0\t", 1).splitlines()
    text = "\r\n".join([lines[0], "# home", *lines[1:3], "", "  # away", lines[3]])
    file = read_waypoints(text, "mp.waypoints")
    assert file == read_waypoints(FROM_MISSION_PLANNER, "mp.waypoints")
    assert file.lines == (4, 7)


def test_positions_have_eight_decimals_at_least() -> None:
    row = write_waypoints(WaypointFile(HOME, ITEMS)).splitlines()[2].split("\t")
    assert row[8:11] == ["-35.36326200", "149.16523700", "2.15900000"]


def test_pymavlink_reads_the_same_mission(tmp_path: Path) -> None:
    from pymavlink import mavwp

    path = tmp_path / "m.waypoints"
    path.write_text(write_waypoints(WaypointFile(HOME, ITEMS)))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(ITEMS) + 1
    first = loader.wp(0)
    assert (first.x, first.y, first.z) == (HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
    for seq, item in enumerate(ITEMS, start=1):
        row = loader.wp(seq)
        assert (row.seq, row.command, row.frame) == (seq, item.command, item.frame)
        assert (row.param1, row.param2, row.param3, row.param4) == item.params
        assert row.z == item.alt_m
        assert bool(row.autocontinue) == item.autocontinue
        scale = 1 if item.frame == 2 else 1e7
        assert (round(row.x * scale), round(row.y * scale)) == (item.lat_degE7, item.lon_degE7)


ROW = "0\t1\t0\t16\t0\t0\t0\t0\t47.1\t8.1\t488\t1"


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("", 1, HEADER),
        ("QGC WPL 130\n" + ROW, 1, HEADER),
        (f"{HEADER}\n{ROW}\n1\t0\t3\t16\t0\t0\t0\t0\t47.1\t8.1\t10\n", 3, "11 columns"),
        (f"{HEADER}\n{ROW}\n\n2.5\t0\t3\t16\t0\t0\t0\t0\t47.1\t8.1\t10\t1\n", 4, "seq must be an integer"),
        (f"{HEADER}\n{ROW.replace('47.1', '91')}\n", 2, "not on Earth"),
        (f"{HEADER}\n{ROW.replace('47.1', 'nan')}\n", 2, "position is missing or not a number"),
        (f"{HEADER}\n{ROW.replace('47.1', 'north')}\n", 2, "'north'"),
        (f"{HEADER}\n{ROW.replace('488', '1e999')}\n", 2, "infinite"),
        (f"{HEADER}\n{ROW}\n1\t0\t2\t178\t0\t0\t0\t0\t3e9\t0\t0\t1\n", 3, "below 2^31"),
        (f"{HEADER}\n{ROW}\n1\t0\t3\t-16\t0\t0\t0\t0\t47.1\t8.1\t10\t1\n", 3, "command"),
        (f"{HEADER}\n0\t1\t3\t22\t0\t0\t0\t0\t47.1\t8.1\t10\t1\n", 2, "row 0 is not a home"),
    ],
)
def test_a_mistake_is_named_with_file_line_and_reason(text: str, line: int, reason: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        read_waypoints(text, "bad.waypoints")
    assert caught.value.message.startswith(f"bad.waypoints, line {line}: ")
    assert reason in caught.value.message


def test_a_file_without_rows_has_no_home() -> None:
    with pytest.raises(FileFormatError, match="no row 0"):
        read_waypoints(HEADER, "empty")
    assert read_waypoints(HEADER, "empty", home_first=False) == WaypointFile(None, ())


def test_binary_is_not_text() -> None:
    with pytest.raises(FileFormatError, match="not a text file"):
        read_waypoints(b"QGC WPL 110\n\xff\xfe", "x")
