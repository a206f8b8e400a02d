"""`.plan`: the keys QGroundControl needs, what it writes, and what is refused by key."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from gcs.errors import FileFormatError
from gcs.mission.firmware import Firmware
from gcs.mission.model import Home, MissionItem
from gcs.mission.planfile import PlanFile, read_plan_file, write_plan_file

FILE = PlanFile(
    Firmware.ARDUPILOT,
    Home(47.39760099722707, 8.545373091190891, 488.8414160840376),
    (
        MissionItem(22, 3, (0.0, 0.0, 0.0, 45.0), 473976010, 85453731, 2.159),
        MissionItem(178, 2, (1.0, 0.1 + 0.2, -1.0, 0.0), 0, 0, 0.0),
        MissionItem(16, 0, (0.0, 0.0, 0.0, 0.0), -473976010, -85453731, 500.0, autocontinue=False),
        MissionItem(16, 10, (0.0, 0.0, 0.0, 0.0), 473976010, 85453731, 1 / 3),
    ),
    5.5,
    4.5,
)


def document(**changes: Any) -> dict[str, Any]:
    plan: dict[str, Any] = json.loads(write_plan_file(FILE))
    plan["mission"] |= changes
    return plan


def item(**changes: Any) -> dict[str, Any]:
    plan = document()
    plan["mission"]["items"][0] |= changes
    return plan


@pytest.mark.parametrize("firmware", list(Firmware))
def test_what_is_written_is_read(firmware: Firmware) -> None:
    file = PlanFile(firmware, FILE.home, FILE.items, 5.5, 4.5)
    assert read_plan_file(write_plan_file(file), "x") == file


def test_nan_is_null() -> None:
    yaw_free = MissionItem(16, 3, (0.0, 0.0, 0.0, math.nan), 1, 2, 3.0)
    text = write_plan_file(PlanFile(Firmware.PX4, FILE.home, (yaw_free,)))
    assert json.loads(text)["mission"]["items"][0]["params"] == [0, 0, 0, None, 1e-7, 2e-7, 3]
    assert math.isnan(read_plan_file(text, "x").items[0].params[3])


def test_the_keys_ground_stations_insist_on() -> None:
    plan = document()
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


def test_commands_without_a_position_may_have_nulls_there() -> None:
    plan = document()
    plan["mission"]["items"][1]["params"][4:] = [None, None, None]
    assert read_plan_file(json.dumps(plan), "x") == FILE


@pytest.mark.parametrize(
    ("plan", "where"),
    [
        ({}, "fileType"),
        ([], "x: "),
        (document(version=1), "mission.version"),
        (document(firmwareType=0), "mission.firmwareType"),
        (document(plannedHomePosition=[95, 0, 0]), "mission.plannedHomePosition.0"),
        (document(items=[{"type": "ComplexItem", "complexItemType": "survey"}]), "mission.items.0.type"),
        (item(params=[0, 0, 0, 0, None, 8.5, 3]), "mission.items.0: the position has a null"),
        (item(params=[0, 0, 0, 0, 47.4, 188.5, 3]), "mission.items.0: latitude"),
        (item(params=[0, 0, 0, 0, 47.4, 8.5]), "mission.items.0.params"),
        (item(doJumpId=7), "mission.items.0: doJumpId"),
        (item(command=70000), "mission.items.0.command"),
        (item(autoContinue="yes"), "mission.items.0.autoContinue"),
    ],
)
def test_a_mistake_is_named_with_file_and_key(plan: Any, where: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        read_plan_file(json.dumps(plan), "x")
    assert caught.value.message.startswith("x: ")
    assert where in caught.value.message


@pytest.mark.parametrize("text", [b"", b"\xff", b"[" * 100_000, b'{"version": 1' + b"0" * 5000 + b"}"])
def test_no_json_no_traceback(text: bytes) -> None:
    with pytest.raises(FileFormatError):
        read_plan_file(text, "x")


def test_not_a_number_is_refused() -> None:
    text = write_plan_file(FILE).replace("500.0", "NaN")
    with pytest.raises(FileFormatError):
        read_plan_file(text, "x")
