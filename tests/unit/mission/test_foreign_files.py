"""A collection of files as other programs and people write them, in both line endings: read whole, or refused whole."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission.check.findings import Level, Rule
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.flight_limits import FlightLimits
from gcs.mission.formats.any_mission import load_missions
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.mission.model import Home
from gcs.mission.predicted.planned_flight import surroundings

FOLDER = Path(__file__).parent / "foreign"
ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4
ZURICH, ROUNDED = Home(47.397742, 8.545594, 488.1), Home(47.397742, 8.545594, 488.0)

READ = {
    "mission_planner.waypoints": (ARDUPILOT, Home(-35.3632621, 149.1652374, 584.09), [22, 178, 16, 16, 177, 20]),
    "mavproxy.waypoints": (ARDUPILOT, Home(-35.363262, 149.165237, 584.09), [22, 16, 21]),
    "by_hand.waypoints": (ARDUPILOT, Home(47.397742, 8.545594, 488.0), [22, 16, 21]),
    "px4.waypoints": (PX4, None, [22, 16, 21]),
    "qgroundcontrol.plan": (PX4, ZURICH, [22, 530, 16, 206, 16, 20]),
    "written_by_a_script.plan": (ARDUPILOT, ZURICH, [22, 16, 21]),
    "gap.waypoints": (ARDUPILOT, ROUNDED, [22, 16, 21]),
    "version_100.waypoints": (ARDUPILOT, ROUNDED, [22, 16, 21]),
    "version_120.waypoints": (PX4, None, [22, 16, 177, 21]),
    "remarks.waypoints": (ARDUPILOT, ROUNDED, [22, 178, 20]),
    "version_1.mission": (PX4, ROUNDED, [22, 16, 21]),
    "version_2.mission": (ARDUPILOT, ROUNDED, [22, 16, 20]),
    "renumbered.plan": (ARDUPILOT, ROUNDED, [22, 16, 206, 177, 20]),
}
ODD = {  # kind, line of the first, how many
    "by_hand.waypoints": [(QuirkKind.SEPARATOR, 2, 4), (QuirkKind.REMARK, 4, 1)],
    "mavproxy.waypoints": [(QuirkKind.REMARK, 2, 3), (QuirkKind.BLANK, 7, 1)],
    "gap.waypoints": [(QuirkKind.SEQ, 3, 3)],
    "version_100.waypoints": [(QuirkKind.VERSION, 1, 1), (QuirkKind.YAW, 4, 1)],
    "version_120.waypoints": [(QuirkKind.VERSION, 1, 1)],
    "remarks.waypoints": [
        (QuirkKind.MARK, 1, 1),
        (QuirkKind.REMARK, 1, 3),
        (QuirkKind.SEPARATOR, 5, 1),
        (QuirkKind.BLANK, 6, 1),
        (QuirkKind.CURRENT, 7, 1),
        (QuirkKind.EMPTY, 7, 2),
        (QuirkKind.NO_PLACE, 7, 2),
    ],
    "version_1.mission": [(QuirkKind.VERSION, 71, 1)],
    "version_2.mission": [(QuirkKind.NO_PLACE, 40, 1), (QuirkKind.VERSION, 63, 1)],
    "renumbered.plan": [
        (QuirkKind.MARK, 1, 1),
        (QuirkKind.FENCE_1, 5, 1),
        (QuirkKind.SEQ, 26, 4),
        (QuirkKind.FRACTION, 42, 1),
        (QuirkKind.JUMP, 58, 1),
        (QuirkKind.NO_PLACE, 74, 1),
        (QuirkKind.RALLY_1, 106, 1),
    ],
}
REFUSED = {
    "survey.plan": r"line \d+: mission\.items\.2: a complex item \(survey\); replace it by simple items",
    "cut_short.plan": r"line \d+: not JSON",
    "generic_autopilot.plan": r"line \d+: mission\.firmwareType: 0 is not an autopilot that missions are written for",
    "nowhere.plan": r"line \d+: mission\.items\.2: the position is missing or not a number",
    "flat_home.plan": r"line \d+: mission\.plannedHomePosition\.2: Field required",
    "old_fence.plan": r"line 4: geoFence\.breachReturn\.2: Field required",
    "older_format.mission": r"line 6: plannedHomePosition\.coordinate: Field required",
    "with_remarks.plan": r"line 1: not JSON",
    "short_row.waypoints": r"line 4: 11 columns instead of 12",
    "comma.waypoints": r"line 2: x must be a number, got '47,397742'",
    "which_jump.waypoints": r"line 6: jumps to item 3, and the items are not numbered in order",
    "empty_cell.waypoints": r"line 3: the position is missing or not a number",
    "survey.mission": r"line 4: complexItems\.0: a complex item; replace it by simple items",
}


def test_every_file_of_the_collection_is_expected() -> None:
    assert {p.name for p in FOLDER.iterdir()} == {*READ, *REFUSED}
    endings = {name: b"\r\n" in (FOLDER / name).read_bytes() for name in READ}
    assert {True, False} == set(endings.values())


@pytest.mark.parametrize("name", READ)
def test_files_that_are_read(name: str) -> None:
    firmware, home, commands = READ[name]
    (mission,) = load_missions([FOLDER / name])
    assert (mission.firmware, mission.home) == (firmware, home)
    assert [i.command for i in mission.items] == commands
    report = check_fleet([mission], surroundings([mission]), FlightLimits())
    assert report.errors == ()
    assert [(o.kind, o.line, o.count) for o in mission.quirks] == ODD.get(name, [])
    told = [(f.level, f.source, f.line) for f in report.findings if f.rule is Rule.FORMAT]
    assert told == [(Level.WARNING, str(FOLDER / name), line) for _, line, _ in ODD.get(name, [])]
    for index in range(len(mission.items)):
        line = mission.line(index)
        assert line is not None
        assert 1 <= line <= len((FOLDER / name).read_text().splitlines())


@pytest.mark.parametrize("name", REFUSED)
def test_files_that_are_refused_with_line_and_reason(name: str) -> None:
    with pytest.raises(FileFormatError, match=f"{name}, {REFUSED[name]}"):
        load_missions([FOLDER / name])


def test_an_autopilot_without_a_row_yields_to_the_one_that_is_asked_for() -> None:
    (mission,) = load_missions([FOLDER / "generic_autopilot.plan"], PX4)
    assert mission.firmware is PX4
    assert [(o.kind, o.line) for o in mission.quirks] == [(QuirkKind.FIRMWARE, 42)]


def test_what_a_ground_station_leaves_open_stays_open() -> None:
    (mission,) = load_missions([FOLDER / "qgroundcontrol.plan"])
    assert math.isnan(mission.items[0].params[3])
    assert [math.isnan(p) for p in mission.items[1].params] == [False, False, True, True]
    assert mission.geofence.circles[0].radius_m == 250.5
    assert not mission.geofence.polygons[0].inclusion
    assert mission.rally[0].alt_m == 20.0
    assert mission.speed_mps == 5.0


def test_a_loop_is_flown_as_often_as_it_says() -> None:
    """Two laps more over the 90 m leg and back, with 3 s at its end."""
    (mission,) = load_missions([FOLDER / "mission_planner.waypoints"])
    report = check_fleet([mission], surroundings([mission]), FlightLimits())
    leg_s = math.hypot(math.cos(math.radians(35.3626)) * 111.2, 5.0) / 5.0
    climb_s, out_s, home_s = 20 / 2.5, 83.4 / 5, math.hypot(83.4, 90.7) / 5
    down_s = mission.firmware.traits.landing.profile().duration_s(25.0, 0.0)
    expected = climb_s + out_s + 5 * leg_s + 3 * 3.0 + home_s + down_s
    assert report.duration_s == pytest.approx(expected, abs=2.0)
