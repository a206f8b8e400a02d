"""`.fence` and `.rally` tables: items as links carry them, and as pymavlink reads the files."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.errors import FileFormatError
from gcs.mission.formats.qgc_wpl import read_fence, read_rally, write_fence, write_rally
from gcs.mission.formats.table_rows import HEADER
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint, fence_items, rally_items

SQUARE = tuple(GeoPoint(473970000 + north, 85450000 + east) for north, east in ((0, 0), (9, 0), (9, 9), (0, 9)))
FENCE = Geofence(
    (FencePolygon(SQUARE, True), FencePolygon(SQUARE[:3], False)),
    (FenceCircle(SQUARE[0], 12.5, False), FenceCircle(SQUARE[1], 1e3, True)),
    RallyPoint(SQUARE[2], 20.0),
)
RALLY = (RallyPoint(SQUARE[0], 12.345), RallyPoint(SQUARE[3], -1.0))
HOME = "0\t1\t0\t16\t0\t0\t0\t0\t47.1\t8.1\t488\t1"


def test_what_is_written_is_read() -> None:
    assert read_fence(write_fence(FENCE), "x") == FENCE
    assert read_rally(write_rally(RALLY), "x") == RALLY
    assert read_fence(HEADER, "x") == Geofence()
    assert read_rally(HEADER, "x") == ()


def test_the_items_of_a_fence() -> None:
    items = fence_items(FENCE)
    assert [i.command for i in items] == [5000, *[5001] * 4, *[5002] * 3, 5004, 5003]
    assert [i.params[0] for i in items] == [0, *[4] * 4, *[3] * 3, 12.5, 1000]
    assert len(items) == FENCE.vertices == 10
    assert {i.command for i in rally_items(RALLY)} == {5100}


def test_pymavlink_reads_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil, mavwp

    mavutil.set_dialect("ardupilotmega")
    for text, loader, items in (
        (write_fence(FENCE), mavwp.MissionItemProtocol_Fence(), fence_items(FENCE)),
        (write_rally(RALLY), mavwp.MissionItemProtocol_Rally(), rally_items(RALLY)),
    ):
        path = tmp_path / "file"
        path.write_text(text)
        assert loader.load(str(path)) == len(items)
        for seq, item in enumerate(items):
            row = loader.item(seq)
            assert (row.seq, row.command, row.frame, row.param1) == (seq, item.command, item.frame, item.params[0])
            assert (round(row.x * 1e7), round(row.y * 1e7), row.z) == (item.lat_degE7, item.lon_degE7, item.alt_m)


def test_a_home_row_before_the_items_is_no_item() -> None:
    rows = [line.split("\t", 1) for line in write_rally(RALLY).splitlines()[1:]]
    text = "\r\n".join([HEADER, HOME, *(f"{seq}\t{rest}" for seq, (_, rest) in enumerate(rows, start=1))])
    assert read_rally(text, "x") == RALLY


def row(command: int, p1: float, seq: int = 0, frame: int = 0) -> str:
    return f"{seq}\t0\t{frame}\t{command}\t{p1}\t0\t0\t0\t47.1\t8.1\t0\t1"


@pytest.mark.parametrize(
    ("rows", "line", "reason"),
    [
        ([row(5001, 2)], 2, "3 or more"),
        ([row(5001, 3.5)], 2, "3 or more"),
        ([row(5001, float("nan"))], 2, "3 or more"),
        ([row(5001, 3), row(5001, 3, 1)], 2, "and fewer follow"),
        ([row(5001, 3), row(5001, 3, 1), row(5002, 3, 2)], 2, "and fewer follow"),
        ([row(5001, 3), row(5001, 3, 1), row(5001, 4, 2)], 2, "and fewer follow"),
        ([row(5003, 5), row(5004, 0, 1)], 3, "radius 0"),
        ([row(5000, 0), row(5000, 0, 1)], 3, "no part of a fence"),
        ([row(16, 0, 0, 3)], 2, "no part of a fence"),
    ],
)
def test_a_fence_that_is_none(rows: list[str], line: int, reason: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        read_fence("\n".join([HEADER, *rows]), "bad.fence")
    assert caught.value.message.startswith(f"bad.fence, line {line}: ")
    assert reason in caught.value.message


def test_rally_points_above_home_only() -> None:
    with pytest.raises(FileFormatError, match=r"line 2: .*above home"):
        read_rally("\n".join([HEADER, row(5100, 0)]), "x")
    with pytest.raises(FileFormatError, match=r"line 3: .*no rally point"):
        read_rally("\n".join([HEADER, row(5100, 0, 0, 3), row(16, 0, 1, 3)]), "x")
