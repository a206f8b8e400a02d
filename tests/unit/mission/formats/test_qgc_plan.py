"""`.plan`: the keys QGroundControl needs, what others leave out, and what is refused by line and key."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission.drawings.route_formats import drawing_in
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.qgc_plan import read_mission, write_mission
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.mission.geofence import NO_FENCE, FenceCircle, FencePolygon, Geofence, GeoPoint, RallyPoint
from gcs.mission.model import Home, MissionItem

FILE = MissionFile(
    "x",
    Autopilot.ARDUPILOT,
    Home(47.39760099722707, 8.545373091190891, 488.8414160840376),
    (
        MissionItem(22, 3, (0.0, 0.0, 0.0, 45.0), 473976010, 85453731, 2.159),
        MissionItem(178, 2, (1.0, 0.1 + 0.2, -1.0, 0.0), 0, 0, 0.0),
        MissionItem(16, 0, (0.0, 0.0, 0.0, 0.0), -473976010, -85453731, 500.0, autocontinue=False),
        MissionItem(16, 10, (0.0, 0.0, 0.0, 0.0), 473976010, 85453731, 1 / 3),
    ),
    Geofence(
        (
            FencePolygon(
                (GeoPoint(473970000, 85450000), GeoPoint(473980000, 85450000), GeoPoint(473980000, 85460000)), True
            ),
            FencePolygon(
                (GeoPoint(473972000, 85452000), GeoPoint(473973000, 85452000), GeoPoint(473973000, 85453000)), False
            ),
        ),
        (
            FenceCircle(GeoPoint(473976000, 85454000), 319.85, True),
            FenceCircle(GeoPoint(473975000, 85453000), 0.5, False),
        ),
        RallyPoint(GeoPoint(473971000, 85451000), 12.5),
    ),
    (RallyPoint(GeoPoint(473971000, 85451000), 0.1), RallyPoint(GeoPoint(-473971000, -85451000), -1.0)),
    4.5,
)


def read(text: str) -> MissionFile:
    """The contents alone: not where they were read."""
    return replace(read_mission(text, "x"), text="", quirks=())


def document(**changes: Any) -> dict[str, Any]:
    plan: dict[str, Any] = json.loads(write_mission(FILE))
    plan["mission"] |= changes
    return plan


def item(**changes: Any) -> dict[str, Any]:
    plan = document()
    plan["mission"]["items"][0] |= changes
    return plan


def fence(**changes: Any) -> dict[str, Any]:
    plan = document()
    plan["geoFence"] |= changes
    return plan


def rally(points: list[Any]) -> dict[str, Any]:
    plan = document()
    plan["rallyPoints"]["points"] = points
    return plan


def test_an_altitude_beside_the_parameters_is_ignored_and_said_if_it_differs() -> None:
    for mode, altitude_m, said in (
        (1, 30.0, True),
        (2, 2.159, False),
        (3, 30.0, False),
        (4, 3.0, True),
        (1, None, False),
    ):
        text = json.dumps(item(AltitudeMode=mode, Altitude=altitude_m))
        file = read_mission(text, "x")
        assert file.items[0].alt_m == 2.159
        assert [quirk.kind for quirk in file.quirks] == [QuirkKind.ALTITUDE] * said
        drawing = drawing_in(text.encode(), "x.plan")
        assert any("which counts" in one.text for one in drawing.left_out) == said


@pytest.mark.parametrize("firmware", list(Autopilot))
def test_what_is_written_is_read(firmware: Autopilot) -> None:
    file = replace(FILE, firmware=firmware)
    assert read(write_mission(file)) == file


def test_nan_is_null() -> None:
    yaw_free = MissionItem(16, 3, (0.0, 0.0, 0.0, math.nan), 1, 2, 3.0)
    text = write_mission(MissionFile("x", Autopilot.PX4, FILE.home, (yaw_free,)))
    assert json.loads(text)["mission"]["items"][0]["params"] == [0, 0, 0, None, 1e-7, 2e-7, 3]
    assert math.isnan(read_mission(text, "x").items[0].params[3])


def test_the_keys_ground_stations_insist_on() -> None:
    plan = json.loads(write_mission(MissionFile("x", Autopilot.ARDUPILOT, FILE.home, FILE.items)))
    assert (plan["fileType"], plan["version"]) == ("Plan", 1)
    assert plan["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert plan["rallyPoints"] == {"points": [], "version": 2}
    mission = plan["mission"]
    assert (mission["version"], mission["firmwareType"], mission["vehicleType"]) == (2, 3, 2)
    assert [i["doJumpId"] for i in mission["items"]] == [1, 2, 3, 4]
    assert [i.get("AltitudeMode") for i in mission["items"]] == [1, None, 2, 4]
    takeoff = mission["items"][0]
    assert (takeoff["Altitude"], takeoff["AMSLAltAboveTerrain"]) == (2.159, None)
    assert takeoff["params"][4:] == [47.397601, 8.5453731, 2.159]


def test_fence_and_rally_as_the_format_is_documented() -> None:
    plan = document()
    fence = plan["geoFence"]
    assert fence["version"] == 2
    assert fence["polygons"][0] == {
        "inclusion": True,
        "polygon": [[47.397, 8.545], [47.398, 8.545], [47.398, 8.546]],
        "version": 1,
    }
    assert fence["circles"][0] == {
        "circle": {"center": [47.3976, 8.5454], "radius": 319.85},
        "inclusion": True,
        "version": 1,
    }
    assert fence["breachReturn"] == [47.3971, 8.5451, 12.5]
    assert plan["rallyPoints"] == {"points": [[47.3971, 8.5451, 0.1], [-47.3971, -8.5451, -1.0]], "version": 2}


@pytest.mark.parametrize(("frame", "mode"), [(3, 1), (0, 2), (10, 4)])
def test_the_plan_says_the_altitude_frame_of_its_items(frame: int, mode: int) -> None:
    item = MissionItem(16, frame, (0.0,) * 4, 1, 2, 3.0)
    speed = MissionItem(178, 2, (1.0, 2.0, -1.0, 0.0), 0, 0, 0.0)
    plan = json.loads(write_mission(MissionFile("x", Autopilot.PX4, FILE.home, (speed, item, item))))
    assert plan["mission"]["globalPlanAltitudeMode"] == mode
    mixed = json.loads(
        write_mission(MissionFile("x", Autopilot.PX4, FILE.home, (item, replace(item, frame=3), FILE.items[2])))
    )
    assert mixed["mission"]["globalPlanAltitudeMode"] == 0


def test_keys_that_other_programs_leave_out() -> None:
    plan = document()
    for key in ("cruiseSpeed", "hoverSpeed", "vehicleType", "globalPlanAltitudeMode"):
        del plan["mission"][key]
    for key in ("geoFence", "rallyPoints", "groundStation"):
        del plan[key]
    for row in plan["mission"]["items"]:
        for key in ("doJumpId", "AMSLAltAboveTerrain", "Altitude", "AltitudeMode"):
            row.pop(key, None)
    plan["mission"]["items"][0].pop("autoContinue")
    assert read(json.dumps(plan)) == replace(FILE, geofence=NO_FENCE, rally=(), speed_mps=5.0)


def test_a_fence_without_inclusion_includes_as_it_does_elsewhere() -> None:
    plan = document()
    del plan["geoFence"]["polygons"][1]["inclusion"]
    del plan["geoFence"]["circles"]
    fence = read_mission(json.dumps(plan), "x").geofence
    assert [p.inclusion for p in fence.polygons] == [True, True]
    assert fence.circles == ()


def test_item_numbers_only_matter_where_a_mission_jumps() -> None:
    plan = item(doJumpId=7)
    assert read(json.dumps(plan)) == FILE
    plan["mission"]["items"][1] |= {"command": 177, "params": [7, 2, 0, 0, 0, 0, 0]}
    file = read_mission(json.dumps(plan), "x")
    assert file.items[1].params[:2] == (1.0, 2.0)
    assert [(o.kind, o.line, o.count) for o in file.quirks] == [(QuirkKind.SEQ, 1, 1), (QuirkKind.JUMP, 1, 1)]
    for number, found in ((1, "no"), (3, "2")):
        plan["mission"]["items"][1]["params"][0] = number
        plan["mission"]["items"][3]["doJumpId"] = 3
        with pytest.raises(FileFormatError, match=rf"mission.items.1: jumps to item {number}, and {found} items have"):
            read_mission(json.dumps(plan), "x")


def test_commands_without_a_position_may_have_nulls_there() -> None:
    plan = document()
    plan["mission"]["items"][1]["params"][4:] = [None, None, None]
    assert read(json.dumps(plan)) == FILE


@pytest.mark.parametrize(
    ("plan", "where"),
    [
        ({}, "fileType"),
        ([], "line 1"),
        (document(version=1), "mission.version"),
        (document(firmwareType=0), "mission.firmwareType"),
        (document(plannedHomePosition=[95, 0, 0]), "mission.plannedHomePosition.0"),
        (
            document(items=[{"type": "ComplexItem", "complexItemType": "survey"}]),
            "mission.items.0: a complex item (survey)",
        ),
        (document(items=[{"type": "ComplexItem"}]), "mission.items.0: a complex item (unnamed)"),
        (document(items=[{"type": "Item"}]), "mission.items.0"),
        (item(params=[0, 0, 0, 0, None, 8.5, 3]), "mission.items.0: the position is missing or not a number"),
        (item(params=[0, 0, 0, 0, 47.4, 188.5, 3]), "mission.items.0: latitude"),
        (item(params=[0, 0, 0, 0, 47.4, 8.5]), "mission.items.0.params"),
        (item(command=70000), "mission.items.0.command"),
        (item(autoContinue="yes"), "mission.items.0.autoContinue"),
        (fence(polygons=[{"polygon": [[47, 8], [47, 9]]}]), "geoFence.polygons.0.polygon"),
        (fence(polygons=[{"polygon": [[47, 8], [47, 9], [97, 9]]}]), "geoFence.polygons.0.polygon.2.0"),
        (fence(circles=[{"circle": {"center": [47, 8], "radius": 0}}]), "geoFence.circles.0.circle.radius"),
        (fence(version=1), "geoFence.version"),
        (rally([[47, 8]]), "rallyPoints.points.0.2"),
    ],
)
def test_a_mistake_is_named_with_file_and_key(plan: Any, where: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        read_mission(json.dumps(plan), "x")
    assert caught.value.message.startswith("x, line 1: ")
    assert where in caught.value.message


@pytest.mark.parametrize("text", [b"", b"\xff", b"[" * 100_000, b'{"version": 1' + b"0" * 5000 + b"}"])
def test_no_json_no_traceback(text: bytes) -> None:
    with pytest.raises(FileFormatError):
        read_mission(text, "x")


def test_not_a_number_is_refused() -> None:
    text = write_mission(FILE).replace("500.0", "NaN")
    with pytest.raises(FileFormatError):
        read_mission(text, "x")


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_the_line_of_a_mistake(newline: str) -> None:
    lines = write_mission(FILE).splitlines()
    at = next(number for number, line in enumerate(lines) if '"command": 178' in line)
    lines[at] = lines[at].replace("178", "-178")
    with pytest.raises(FileFormatError) as caught:
        read_mission(newline.join(lines), "x")
    assert caught.value.message.startswith(f"x, line {at + 1}: mission.items.1.command: ")
    with pytest.raises(FileFormatError, match=f"x, line {at + 1}: not JSON"):
        read_mission(newline.join([*lines[:at], "}", *lines[at + 1 :]]), "x")
