"""MAVProxy's lists of fence and rally points, beside a mission, as pymavlink reads them, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.errors import FileFormatError
from gcs.mission.formats.any_mission import load_missions
from gcs.mission.formats.point_lists import read_fence_list, read_rally_list
from gcs.mission.formats.qgc_wpl import WaypointFile, write_waypoints
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.mission.geofence import fence_items, rally_items
from tests.unit.mission.fleets import mission, out_and_land

FENCE = """# the field
-35.363720\t149.163651
-35.358738 149.165070

-35.359295\t149.154434
-35.372292\t149.157135 // far
-35.358738\t149.165070
"""
RALLY = "RALLY -35.363160\t149.164101\t60.5\t40.0\t90.0\t0\nrally -35.36 149.16 20 0 0 0\n"


def test_lists_belong_to_the_mission_beside_them(tmp_path: Path) -> None:
    items = out_and_land(50.0)
    (tmp_path / "a.waypoints").write_text(write_waypoints(WaypointFile(mission(items).home, items)))
    (tmp_path / "fence.txt").write_bytes(FENCE.replace("\n", "\r\n").encode())
    (tmp_path / "rally.txt").write_text(RALLY)
    one = load_missions([tmp_path / name for name in ("a.waypoints", "fence.txt", "rally.txt")])[0]
    (polygon,) = one.geofence.polygons
    assert polygon.inclusion
    assert [(p.lat_degE7, p.lon_degE7) for p in polygon.points] == [
        (-353587380, 1491650700),
        (-353592950, 1491544340),
        (-353722920, 1491571350),
    ]
    assert one.geofence.return_point is not None
    assert one.geofence.return_point.place.lat_degE7 == -353637200
    assert [(p.place.lon_degE7, p.alt_m) for p in one.rally] == [(1491641010, 60.5), (1491600000, 20.0)]
    assert [(Path(o.source).name, o.kind, o.line, o.count) for o in one.quirks] == [
        ("fence.txt", QuirkKind.REMARK, 1, 2),
        ("fence.txt", QuirkKind.RETURN, 2, 1),
        ("fence.txt", QuirkKind.BLANK, 4, 1),
        ("rally.txt", QuirkKind.RALLY, 1, 1),
    ]


def test_an_oddity_of_a_file_for_all_is_told_once(tmp_path: Path) -> None:
    items = out_and_land(50.0)
    for name in ("a.waypoints", "b.waypoints"):
        (tmp_path / name).write_text(write_waypoints(WaypointFile(mission(items).home, items)))
    (tmp_path / "rally.txt").write_text(RALLY)
    missions = load_missions([tmp_path / name for name in ("a.waypoints", "b.waypoints", "rally.txt")])
    assert [len(m.rally) for m in missions] == [2, 2]
    assert [len(m.quirks) for m in missions] == [1, 0]


def test_pymavlink_reads_the_same_items(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    from pymavlink import mavutil, mavwp

    mavutil.set_dialect("ardupilotmega")
    for text, loader, ours in (
        (FENCE.replace(" // far", ""), mavwp.MissionItemProtocol_Fence(), fence_items(read_fence_list(FENCE, "x")[0])),
        (
            RALLY.replace("rally", "RALLY"),
            mavwp.MissionItemProtocol_Rally(),
            rally_items(read_rally_list(RALLY, "x")[0]),
        ),
    ):
        path = tmp_path / "list.txt"
        path.write_text(text)
        loader.load(str(path))
        theirs = [loader.item(n) for n in range(loader.count())]
        assert [(i.command, i.param1) for i in theirs] == [(i.command, i.params[0]) for i in ours]
        for item, own in zip(theirs, ours, strict=True):
            assert abs(item.x - own.lat_degE7) <= 1  # pymavlink cuts the eighth decimal
            assert abs(item.y - own.lon_degE7) <= 1


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("1 1\n2 2\n2 3\n2 2\n", "x: 4 points"),
        ("1 1\n2 2\n2 3\n3 3\n3 2\n", "x, line 5: the last point does not repeat the first vertex, line 2"),
        ("1 1\n2 2\n2 3 4\n3 3\n2 2\n", "x, line 3: 3 columns instead of 2"),
        ("1 1\n2 2\n92 3\n3 3\n2 2\n", "x, line 3: latitude 92.0"),
        ("1 1\n2 2\nnan 3\n3 3\n2 2\n", "x, line 3: expected a number, got 'nan'"),
        ("1 1\n2 2\nnorth 3\n3 3\n2 2\n", "x, line 3: expected a number, got 'north'"),
    ],
)
def test_fences_that_are_refused(text: str, reason: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        read_fence_list(text, "x")
    assert caught.value.message.startswith(reason)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("RALLY 1 1 20 0 0\n", "x, line 1: 6 columns instead of 7"),
        ("RALLY 1 1 20 0 0 0\nFENCE 1 1 20 0 0 0\n", "x, line 2: expected RALLY"),
        ("RALLY 1 1 20 0 0 4\n", "x, line 1: flags 4 give an altitude in frame 0, not above home"),
        ("RALLY 1 1 20 0 0 0.5\n", "x, line 1: flags must be an integer"),
        ("RALLY 1 181 20 0 0 0\n", "x, line 1: latitude 1.0, longitude 181.0"),
        ("RALLY 1 1 inf 0 0 0\n", "x, line 1: expected a number"),
    ],
)
def test_rally_points_that_are_refused(text: str, reason: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        read_rally_list(text, "x")
    assert caught.value.message.startswith(reason)


def test_an_altitude_above_home_may_be_said() -> None:
    points, quirks = read_rally_list("RALLY 1 1 20 0 0 12\n", "x")
    assert (points[0].alt_m, [o.kind for o in quirks]) == (20.0, [QuirkKind.RALLY])
