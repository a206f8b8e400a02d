"""Items one by one: every rule with a mission that breaks it, and none for missions that are right."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.autopilots.columns import CommandSource
from gcs.autopilots.mission_commands import command_source, name_of, refusal
from gcs.autopilots.traits import Autopilot
from gcs.cli.main import run
from gcs.mavlink import MavCommand
from gcs.mission.check.findings import Finding, Level, Rule, worst
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.check.item_checks import check_items
from gcs.mission.flight_limits import FlightLimits
from gcs.mission.formats.any_mission import read_mission
from gcs.mission.model import MissionItem
from tests.unit.mission.fleets import FLAT, at, do, mission, out_and_land, speed

ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4
GOOD = out_and_land(50.0)


def findings(items: Iterable[MissionItem], firmware: Autopilot = ARDUPILOT) -> list[Finding]:
    return list(check_items(mission(items, firmware=firmware)))


@pytest.mark.parametrize("firmware", list(Autopilot))
def test_a_good_mission_has_nothing(firmware: Autopilot) -> None:
    assert findings(GOOD, firmware) == []
    loop = (*GOOD[:3], at(16, 0, 0, 10), do(177, 3.0, 2.0), GOOD[3])
    assert findings(loop, firmware) == []


def with_item(item: MissionItem, index: int = 2) -> list[MissionItem]:
    return [*GOOD[:index], item, *GOOD[index:]]


@pytest.mark.parametrize(
    ("items", "firmware", "rule", "level", "message", "number"),
    [
        ([], ARDUPILOT, Rule.ITEMS, Level.ERROR, "has no items", None),
        (
            [*GOOD[:3], *[do(115)] * 650, GOOD[3]],
            ARDUPILOT,
            Rule.ITEMS,
            Level.ERROR,
            "655 items; ArduCopter stores at most 650",
            None,
        ),
        (
            [*GOOD[:3], *[speed(5)] * 497, GOOD[3]],
            PX4,
            Rule.ITEMS,
            Level.ERROR,
            "501 items; PX4 stores at most 500",
            None,
        ),
        (GOOD[1:], ARDUPILOT, Rule.ORDER, Level.WARNING, "not a take-off", 2),
        (GOOD[:3], ARDUPILOT, Rule.ORDER, Level.WARNING, "ends in the air, with NAV_WAYPOINT", 3),
        (with_item(at(22, 0, 0, 20), 3), ARDUPILOT, Rule.ORDER, Level.WARNING, "take-off in the air", 4),
        (with_item(at(17, 0, 0, 10)), ARDUPILOT, Rule.ORDER, Level.WARNING, "never flies the items after", 3),
        (with_item(replace(speed(4), autocontinue=False)), PX4, Rule.ORDER, Level.WARNING, "autocontinue", 2),
        (with_item(do(9999)), ARDUPILOT, Rule.COMMAND, Level.ERROR, "command 9999: no manual", 3),
        (with_item(at(82, 9, 0, 10)), PX4, Rule.COMMAND, Level.ERROR, "NAV_SPLINE_WAYPOINT: a recorded vehicle", 2),
        (with_item(do(115)), PX4, Rule.COMMAND, Level.ERROR, "CONDITION_YAW: a recorded vehicle refused", 2),
        (with_item(do(176)), ARDUPILOT, Rule.COMMAND, Level.ERROR, "DO_SET_MODE: it is accepted and never", 3),
        (with_item(do(211)), PX4, Rule.COMMAND, Level.WARNING, "DO_GRIPPER: its manual does not list it", 2),
        (with_item(at(31, 9, 0, 10)), ARDUPILOT, Rule.COMMAND, Level.ERROR, "NAV_LOITER_TO_ALT", 3),
        (
            with_item(at(16, 9, 0, 10, frame=2)),
            ARDUPILOT,
            Rule.FRAME,
            Level.ERROR,
            "has a position, but frame 2 has none",
            3,
        ),
        (with_item(at(16, 9, 0, 10, frame=10)), PX4, Rule.FRAME, Level.ERROR, "PX4 refuses altitudes in frame 10", 2),
        (with_item(at(16, 9, 0, 10, frame=1)), ARDUPILOT, Rule.FRAME, Level.ERROR, "refuses altitudes in frame 1", 3),
        (with_item(at(16, 9, 0, math.nan)), PX4, Rule.VALUE, Level.ERROR, "altitude nan m", 2),
        (with_item(at(16, 9, 0, 2e5)), PX4, Rule.VALUE, Level.ERROR, "altitude 200000 m; limit 100000 m", 2),
        (with_item(at(16, 9, 0, 10, p1=math.nan)), ARDUPILOT, Rule.VALUE, Level.ERROR, "hold time", 3),
        (with_item(do(93, -1.0, 12, 0, 0)), PX4, Rule.VALUE, Level.ERROR, "cannot wait until a time of day", 2),
        (with_item(do(93, -1.0, 12, 0, 0)), ARDUPILOT, Rule.ASSUMED, Level.NOTE, "common start", 3),
        (with_item(do(178, 7.0, 3.0)), ARDUPILOT, Rule.VALUE, Level.ERROR, "unknown speed type 7", 3),
        (with_item(speed(math.nan)), ARDUPILOT, Rule.SPEED, Level.ERROR, "not a number", 3),
        (with_item(speed(0.1)), ARDUPILOT, Rule.SPEED, Level.ERROR, "ignores 0.1 m/s", 3),
        (with_item(speed(21.0)), ARDUPILOT, Rule.SPEED, Level.ERROR, "allows at most 20 m/s", 3),
        (with_item(speed(13.0)), PX4, Rule.SPEED, Level.ERROR, "allows at most 12 m/s", 2),
        (with_item(do(177, 9.0, 1.0)), ARDUPILOT, Rule.JUMP, Level.ERROR, "item 9; the mission has items 1 to 5", 3),
        (with_item(do(177, 0.0, 1.0)), ARDUPILOT, Rule.JUMP, Level.ERROR, "item 0; the mission has items 1 to 5", 3),
        (with_item(do(177, 1.5, 1.0)), ARDUPILOT, Rule.JUMP, Level.ERROR, "item 1.5", 3),
        (with_item(do(177, math.nan, 1.0)), ARDUPILOT, Rule.JUMP, Level.ERROR, "item nan", 3),
        (with_item(do(177, 3.0, 1.0)), ARDUPILOT, Rule.JUMP, Level.ERROR, "jumps to itself", 3),
        (with_item(do(177, 1.0, math.nan)), ARDUPILOT, Rule.JUMP, Level.ERROR, "number of jumps", 3),
        (with_item(do(177, 1.0, -1.0)), ARDUPILOT, Rule.JUMP, Level.WARNING, "without end", 3),
        (with_item(do(177, 2.0, 5.0)), ARDUPILOT, Rule.JUMP, Level.ERROR, "without a navigation command", 3),
        ([*GOOD[:3], *[do(177, 3.0, 1.0)] * 16, GOOD[3]], ARDUPILOT, Rule.JUMP, Level.WARNING, "16 jumps", None),
    ],
)
def test_a_rule_and_who_breaks_it(
    items: list[MissionItem], firmware: Autopilot, rule: Rule, level: Level, message: str, number: int | None
) -> None:
    found = [f for f in findings(items, firmware) if message in f.message]
    assert [(f.rule, f.level, f.item) for f in found] == [(rule, level, number)]
    assert found[0].source == "a.plan"


@pytest.mark.parametrize(("firmware", "items_max"), [(ARDUPILOT, 650), (PX4, 500)])
def test_a_mission_may_fill_the_store(firmware: Autopilot, items_max: int) -> None:
    home = 1 if firmware is ARDUPILOT else 0  # it is an item there
    items = [*GOOD[:3], *[speed(5)] * (items_max - home - 4), GOOD[3]]
    assert findings(items, firmware) == []
    assert [f.rule for f in findings([*items[:3], *items[2:]], firmware)] == [Rule.ITEMS]


@pytest.mark.parametrize(
    ("kind", "speed_mps", "ignored"), [(1.0, -1.0, False), (1.0, -2.0, True), (0.0, -2.0, True), (2.0, -2.0, False)]
)
def test_minus_one_is_no_change_of_speed(kind: float, speed_mps: float, ignored: bool) -> None:
    assert ["ignores -2 m/s" in f.message for f in findings(with_item(do(178, kind, speed_mps)))] == [True] * ignored


def test_the_speed_that_float32_makes_of_the_slowest_is_fast_enough() -> None:
    assert findings(with_item(speed(0.2 - 1e-9))) == []


def test_nothing_else_is_said_of_a_single_mistake() -> None:
    assert len(findings(with_item(speed(21.0)))) == 1
    assert len(findings(with_item(do(9999)))) == 1


def test_both_execute_the_commands_that_exports_contain() -> None:
    for command in (16, 21, 22, 93, 178):
        for firmware in Autopilot:
            assert command_source(command, firmware) is CommandSource.RECORDED
            assert refusal(command, firmware) == ""
    assert name_of(16) == "NAV_WAYPOINT"
    assert name_of(4711) == "command 4711"


def test_names_agree_with_the_dialect() -> None:
    from pymavlink.dialects.v20 import ardupilotmega

    names = ardupilotmega.enums["MAV_CMD"]
    for command in MavCommand:
        if command is not MavCommand.NAV_LAST:
            assert names[command.value].name == f"MAV_CMD_{command.name}"


def test_findings_read_like_a_compilers() -> None:
    finding = Finding(Rule.SPEED, Level.ERROR, "too fast", "a.plan", 12, 3, 4.56)
    assert str(finding) == "a.plan:12: error [speed] item 3: too fast (at 4.6 s)"
    assert str(Finding(Rule.ITEMS, Level.NOTE, "few", "a.plan")) == "a.plan: note [items] few"
    assert finding.data() == {
        "rule": "speed",
        "level": "error",
        "message": "too fast",
        "file": "a.plan",
        "line": 12,
        "item": 3,
        "t_s": 4.56,
    }
    assert set(Finding(Rule.ITEMS, Level.NOTE, "few", "a.plan").data()) == {"rule", "level", "message", "file"}
    note = Finding(Rule.ITEMS, Level.NOTE, "few", "a.plan")
    assert worst([]) is None
    assert worst([note]) is Level.NOTE
    assert worst([note, finding]) is Level.ERROR


def test_items_are_numbered_as_ground_stations_do() -> None:
    text = b"QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t500\t1\n# x\n1\t0\t3\t16\t0\t0\t0\t0\t47\t8\t10\t1\n"
    first = next(iter(check_items(read_mission(text, "a.waypoints"))))
    assert (first.line, first.item) == (4, 1)


SWAPPED = """QGC WPL 110
0	1	0	16	0	0	0	0	47.4	8.55	488	1
1	0	3	22	0	0	0	0	47.4	8.55	20	1
2	0	3	16	0	0	0	0	47.401	8.55	20	1
3	0	3	16	0	0	0	0	8.552	47.402	20	1
4	0	3	21	0	0	0	0	47.401	8.55	0	1
"""


def test_a_leg_of_thousands_of_kilometres_is_a_question(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.waypoints"
    file.write_text(SWAPPED)
    assert run(["check", str(file), "--autopilot", "ardupilot"]) == 11
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == (
        f"{file}:5: error [place] item 3: swapped latitude and longitude? "
        "It is 5,659 km from the item before it; the check leaves it out"
    )
    assert lines[-1] == "1 finding"  # none about a flight of days, or about millions of metres below the start


@pytest.mark.parametrize(
    ("turn", "asks"),
    [
        (lambda lat, lon: (lon, lat), "swapped latitude and longitude? It is "),
        (lambda lat, lon: (-lat, lon), "has the latitude lost its sign? It is "),
        (lambda lat, lon: (lat, -lon), "has the longitude lost its sign? It is "),
        (lambda lat, lon: (lat // 2, lon), "this place is "),
    ],
)
def test_what_happened_to_the_numbers(turn, asks: str) -> None:  # type: ignore[no-untyped-def]
    up, change, out, land = out_and_land(50.0)
    lat, lon = turn(out.lat_degE7, out.lon_degE7)
    wrong = mission((up, change, replace(out, lat_degE7=lat, lon_degE7=lon), land))
    report = check_fleet([wrong], FLAT, FlightLimits())
    assert [(found.rule, found.item) for found in report.findings] == [(Rule.PLACE, 3)]
    assert report.findings[0].message.startswith(asks)
    assert report.duration_s < 100.0


def test_a_flight_of_kilometres_is_no_question() -> None:
    report = check_fleet([mission(out_and_land(20_000.0))], FLAT, FlightLimits())
    assert Rule.PLACE not in {found.rule for found in report.findings}


def test_a_speed_in_kmh_and_a_height_in_feet_are_asked_about() -> None:
    found = check_items(mission((*out_and_land(50.0)[:1], speed(54.0), *out_and_land(50.0)[2:])))
    assert [one.message.partition("most ")[2] for one in found] == ["20 m/s. Is it in km/h? 54 km/h are 15.0 m/s"]
    high = mission((at(22, 0, 0, 120), at(16, 50, 0, 120), at(21, 50, 0, 0)))
    told = [one.message for one in check_fleet([high], FLAT, FlightLimits(height_max_m=40.0)).findings]
    assert told == ["80.00 m above the ceiling of 40 m. Is it in feet? 120 ft are 36.6 m"]
