"""Tables as other programs and people write them: what is read and told, and which jumps stay clear."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.flight_limits import FlightLimits
from gcs.mission.formats.item_place import place_in_file
from gcs.mission.formats.qgc_wpl import read_mission, read_waypoints
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.mission.model import Home
from gcs.mission.predicted.planned_flight import surroundings

FOLDER = Path(__file__).parents[1] / "foreign"
HOME = "0\t1\t0\t16\t0\t0\t0\t0\t47.1\t8.1\t488\t1"


def row(seq: object, command: int = 16, *, frame: int = 3, params: str = "0\t0\t0\t0\t47.1\t8.1\t10") -> str:
    return f"{seq}\t0\t{frame}\t{command}\t{params}\t1"


def jump(seq: object, to: int) -> str:
    return row(seq, 177, frame=2, params=f"{to}\t2\t0\t0\t0\t0\t0")


def table(*rows: str) -> str:
    return "\n".join([HEADER, HOME, *rows]) + "\n"


def test_many_equal_oddities_are_one_warning_with_the_first_line() -> None:
    rows = [row(1), *(row(seq) for seq in range(7, 107))]
    mission = read_mission(table(*rows).encode(), "a.waypoints")
    report = check_fleet([mission], surroundings([mission]), FlightLimits())
    told = [str(f) for f in report.findings if f.rule.value == "format"]
    text = "seq is 7, but this is item 2: the order of the rows counts (100 times in this file; this is the first)"
    assert told == [f"a.waypoints:4: warning [format] {text}"]


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (row(""), [(QuirkKind.SEQ, 3)]),
        (row(-1), [(QuirkKind.SEQ, 3)]),
        (row("01"), []),
        (row(1) + " ", [(QuirkKind.SEPARATOR, 3)]),
        (row(1) + "\t", [(QuirkKind.SEPARATOR, 3)]),
        (row(1).replace("\t", "  "), [(QuirkKind.SEPARATOR, 3)]),
        (row(1, params="\t\t\t\t47.1\t8.1\t10"), [(QuirkKind.EMPTY, 3)]),
        (row(1, 20, params="0\t0\t0\t0\t\t\t"), [(QuirkKind.NO_PLACE, 3)]),
        (row(1, 178, frame=2, params="0\t5\t0\t0\t0.5\t0\t0"), [(QuirkKind.FRACTION, 3)]),
    ],
)
def test_what_is_read_is_told(line: str, told: list[tuple[QuirkKind, int]]) -> None:
    file = read_waypoints(table(line), "x")
    assert len(file.items) == 1
    assert [(o.kind, o.line) for o in file.quirks] == told


@pytest.mark.parametrize(
    "line",
    [
        row(1, params="0\t0\t0\t0\t\t8.1\t10"),
        row(1, params="0\t0\t0\t0\t47.1\t8.1\tnan"),
        row(1, params="0\t0\t0\t0\t91\t8.1\t10"),
        row(1, params="0\t0\t0\t0\tnorth\t8.1\t10"),
        row(1, params="a\t0\t0\t0\t47.1\t8.1\t10"),
        row(1, params="0\t0\t0\t47.1\t8.1\t10"),
        row(1, params="0 0\t\t0\t0\t47.1\t8.1\t10"),
        row("one"),
        row(1, frame=256),
        row(1)[:-1] + "2",
        row(1) + "\t1",
    ],
)
def test_what_is_dangerous_is_refused_with_its_line(line: str) -> None:
    with pytest.raises(FileFormatError, match="x, line 4: "):
        read_waypoints(table("", line), "x")


@pytest.mark.parametrize("name", ["gap", "mavproxy", "mission_planner", "version_100"])
def test_pymavlink_reads_the_same(name: str) -> None:
    from pymavlink import mavwp

    path = FOLDER / f"{name}.waypoints"
    loader = mavwp.MAVWPLoader()
    loader.load(str(path))
    file = read_waypoints(path.read_bytes(), name)
    theirs = [loader.wp(n) for n in range(1, loader.count())]
    assert len(theirs) == len(file.items)
    for item, own in zip(theirs, file.items, strict=True):
        assert (item.command, item.frame) == (own.command, own.frame)
        assert [item.param1, item.param2, item.param3, item.param4] == pytest.approx(own.params, nan_ok=True)
        assert (item.x, item.y, item.z) == pytest.approx((*place_in_file(own), own.alt_m), abs=1e-7)


@pytest.mark.parametrize(
    ("rows", "clear"),
    [
        ((row(1), jump(2, 1), row(9)), True),  # only an item behind has another number
        ((row(1), row(2), jump(3, 2), row(2)), False),  # two items have it
        ((row(1), row(3), jump(4, 3)), False),  # item 3 is the jump itself
        ((row(1), row(9), jump(3, 2)), False),  # the second item has another number
        ((row(1), row(9), jump(3, 9)), False),  # no ninth item, and one that is called so
        ((row(1), row(9), jump(3, 50)), True),  # no such item at all: the check says so
        ((row(9), row(2), row(3, 601, frame=2, params="1\t0\t0\t0\t0\t0\t0")), True),  # no jump to a number
    ],
)
def test_jumps_are_read_where_both_numbers_agree(rows: tuple[str, ...], clear: bool) -> None:
    if clear:
        assert QuirkKind.SEQ in {o.kind for o in read_waypoints(table(*rows), "x").quirks}
        return
    with pytest.raises(
        FileFormatError, match=r"x, line \d: jumps to item \d+, and the items are not numbered in order"
    ):
        read_waypoints(table(*rows), "x")


def test_a_home_row_in_another_frame() -> None:
    text = table(row(1)).replace(HOME, HOME.replace("\t0\t16", "\t3\t16"))
    file = read_waypoints(text, "x")
    assert (file.home, [(o.kind, o.line) for o in file.quirks]) == (Home(47.1, 8.1, 488.0), [(QuirkKind.HOME, 2)])
    assert read_mission(text.encode(), "x").firmware is Autopilot.PX4
    for frame in (2, 77):
        with pytest.raises(FileFormatError, match="line 2: row 0 is not a home position"):
            read_waypoints(table(row(1)).replace(HOME, row(0, frame=frame)), "x")


def test_version_100_has_columns_and_commands_of_its_own() -> None:
    text = "QGC WPL 100\n0\t3\t25\t3\t4\t1\t2\t0\t8.5\t47.3\t10\t0\t1\n"
    (item,) = read_waypoints(text, "x", home_first=False).items
    assert (item.command, item.frame, item.params) == (16, 3, (1.0, 2.0, 3.0, 4.0))
    assert (item.lat_degE7, item.lon_degE7, item.alt_m) == (473000000, 85000000, 10.0)
    with pytest.raises(FileFormatError, match="line 2: command 7 is not one of QGC WPL 100"):
        read_waypoints(text.replace("\t25\t", "\t7\t"), "x", home_first=False)


def test_version_120_has_no_home_and_counts_jumps_from_0() -> None:
    text = table(row(1)).replace(HEADER, "QGC  WPL 120")
    for firmware in (None, Autopilot.ARDUPILOT):
        read = read_mission(text.encode(), "x", firmware)
        assert (read.home, len(read.items), read.jumps_from) == (None, 2, 0)
