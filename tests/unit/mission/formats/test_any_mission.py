"""Any mission file: told apart, put together with its fence, refused with file, line and reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError, UsageError
from gcs.mission.export.atomic_folder import Folder, exported_from
from gcs.mission.formats.any_mission import load_missions, read_mission
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.qgc_plan import write_mission
from gcs.mission.formats.qgc_wpl import WaypointFile, write_fence, write_rally, write_waypoints
from gcs.mission.geofence import FenceCircle, Geofence, RallyPoint
from tests.unit.mission.fleets import mission, out_and_land, place

ITEMS = out_and_land(50.0)
HOME = mission(ITEMS).home
FENCE = Geofence((), (FenceCircle(place(0, 0), 100.0, True),))
RALLY = (RallyPoint(place(50, 0), 10.0),)
assert HOME is not None
PLAN = write_mission(MissionFile("a.plan", Autopilot.PX4, HOME, ITEMS, FENCE, RALLY, 4.0)).encode()
WITH_HOME = write_waypoints(WaypointFile(HOME, ITEMS)).encode()
WITHOUT_HOME = write_waypoints(WaypointFile(None, ITEMS)).encode()


def test_a_plan_says_who_flies_it() -> None:
    loaded = read_mission(PLAN, "a.plan")
    assert (loaded.firmware, loaded.home, loaded.items) == (Autopilot.PX4, HOME, ITEMS)
    assert (loaded.geofence, loaded.rally, loaded.speed_mps) == (FENCE, RALLY, 4.0)
    assert [loaded.seq(n) for n in range(2)] == [0, 1]
    assert loaded.jumps_from == 1
    lines = PLAN.decode().splitlines()
    for index in range(len(ITEMS)):
        line = loaded.line(index)
        assert line is not None
        assert lines[line - 1].strip() == "{"
        assert f'"doJumpId": {index + 1},' in " ".join(lines[line - 1 : line + 8])
    assert read_mission(PLAN, "a.plan", Autopilot.ARDUPILOT).firmware is Autopilot.ARDUPILOT


@pytest.mark.parametrize(
    ("data", "asked", "firmware", "home", "seq"),
    [
        (WITH_HOME, None, Autopilot.ARDUPILOT, HOME, 1),
        (WITHOUT_HOME, None, Autopilot.PX4, None, 0),
        (WITH_HOME, Autopilot.ARDUPILOT, Autopilot.ARDUPILOT, HOME, 1),
        (WITHOUT_HOME, Autopilot.PX4, Autopilot.PX4, None, 0),
        (b"\xef\xbb\xbf" + WITH_HOME.replace(b"\n", b"\r\n"), None, Autopilot.ARDUPILOT, HOME, 1),
    ],
)
def test_a_table_begins_with_home_or_does_not(
    data: bytes, asked: Autopilot | None, firmware: Autopilot, home: object, seq: int
) -> None:
    loaded = read_mission(data, "a.waypoints", asked)
    assert (loaded.firmware, loaded.home, loaded.items) == (firmware, home, ITEMS)
    assert (loaded.seq(0), loaded.jumps_from) == (seq, seq)
    assert loaded.line(0) == 2 + seq


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("data", [PLAN, WITH_HOME])
def test_a_mission_in_utf_16_is_that_mission(data: bytes, encoding: str, tmp_path: Path) -> None:
    """As a shell of Windows writes what is sent to a file."""
    (tmp_path / "a.txt").write_bytes(data.decode().encode(encoding))
    (loaded,) = load_missions([tmp_path / "a.txt"])
    assert (loaded.home, loaded.items) == (HOME, ITEMS)
    (tmp_path / "b.txt").write_bytes(b"\xff\xfeQ")
    with pytest.raises(FileFormatError, match=r"b\.txt: begins as UTF-16, and is none; save it as UTF-8"):
        load_missions([tmp_path / "b.txt"])


def test_a_home_row_that_is_missed() -> None:
    with pytest.raises(FileFormatError, match="row 0 is not a home position"):
        read_mission(WITHOUT_HOME, "a.waypoints", Autopilot.ARDUPILOT)


def test_fences_go_with_the_mission_of_their_name(tmp_path: Path) -> None:
    files = {
        "a.waypoints": WITH_HOME,
        "b.waypoints": WITH_HOME,
        "a.fence": write_fence(FENCE).encode(),
        "all.rally": write_rally(RALLY).encode(),
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    first, second = load_missions([tmp_path / name for name in files])
    assert (first.geofence, first.rally) == (FENCE, RALLY)
    assert (second.geofence, second.rally) == (Geofence(), RALLY)
    with pytest.raises(UsageError, match="no file holds a mission"):
        load_missions([tmp_path / "a.fence"])


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"gone\.plan: No such file"):
        load_missions([tmp_path / "gone.plan"])
    with pytest.raises(FileFormatError, match="is a folder"):
        load_missions([tmp_path])
    (tmp_path / "empty.plan").write_bytes(b"")
    with pytest.raises(FileFormatError, match=r"empty\.plan, line 1: not JSON"):
        load_missions([tmp_path / "empty.plan"])
    with (tmp_path / "huge.plan").open("wb") as file:
        file.truncate(65 * 1024 * 1024)
    with pytest.raises(FileFormatError, match="too large"):
        load_missions([tmp_path / "huge.plan"])


def test_what_was_changed_after_its_export(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    folder.write("a.waypoints", WITH_HOME)
    folder.write("b.waypoints", WITH_HOME)
    folder.write_index({"sha256": folder.sha256, "separation_min_m": 0.3})
    (tmp_path / "c.waypoints").write_bytes(WITH_HOME)
    (tmp_path / "b.waypoints").write_bytes(WITH_HOME.replace(b"50.0", b"51.0") + b"# mine\n")
    missions = load_missions(sorted(tmp_path.glob("*.waypoints")))
    asked, findings = exported_from(missions)
    assert asked == 0.3
    assert [(f.rule.value, f.level.value, Path(f.source).name) for f in findings] == [
        ("changed", "warning", "b.waypoints")
    ]
    (tmp_path / "index.json").write_text("[]")
    assert exported_from(missions) == (None, [])
    (tmp_path / "index.json").unlink()
    assert exported_from(missions) == (None, [])
