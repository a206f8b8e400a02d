"""What a vehicle had before an upload: shown, recorded, and given back, or said to be missing."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError, PeerError, PeerTimeout
from gcs.link.protocols.parameter_transfer import Parameter
from gcs.link.session.load_before import (
    LoadBefore,
    ParameterChange,
    before_words,
    give_back,
    part_words,
    read_before,
    record_before,
    recorded_before,
)
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mavlink import MissionType, ParameterType
from gcs.mission.model import Home, MissionItem, VehicleMission

MISSION, FENCE, RALLY = MissionType.MISSION, MissionType.FENCE, MissionType.RALLY
HOME = Home(47.0, 8.0, 400.0)
INT, REAL = int(ParameterType.INT32), int(ParameterType.REAL32)


def item(number: int, command: int = 16) -> MissionItem:
    return MissionItem(command, 3, (0.0, 0.0, 0.0, math.nan), 470_000_000 + number, 80_000_000, 10.0)


OLD, NEW = (item(1), item(2)), (item(3), item(4), item(5))
EVERYTHING = "RTL_RETURN_ALT 60 (now 30), RTL_CONE 45 (now 0), mission of 2 items"
BARE: dict[str, object] = {"sysid": 1, "autopilot": 3}
ITEM: dict[str, object] = {
    "command": 16,
    "frame": 3,
    "params": [0, 0, 0, 0],
    "lat_degE7": 0,
    "lon_degE7": 0,
    "alt_m": 0,
}
AREA = tuple(item(number, 5001) for number in range(3))


class Vehicle:
    """PX4, which has no home in its mission."""

    def __init__(self, sysid: int = 1) -> None:
        self.sysid, self.autopilot, self.armed, self.home_is_item_0, self.sent_as = sysid, 12, False, False, None
        self.age_s = 0.0
        self.items: dict[int, tuple[MissionItem, ...]] = {MISSION: OLD, FENCE: AREA, RALLY: ()}
        held = (Parameter("RTL_RETURN_ALT", 60.0, REAL), Parameter("RTL_CONE", 45, INT))
        self.values = {one.name: one for one in held}
        self.refuses: set[object] = set()
        self.uploads: list[int] = []

    def heartbeat_age_s(self) -> float:
        return self.age_s

    async def download(self, mission_type: int = 0) -> tuple[MissionItem, ...]:
        if mission_type in self.refuses:
            raise PeerError("vehicle 1 refused.")
        return self.items[mission_type]

    async def upload_items(self, items: Sequence[MissionItem], mission_type: int = 0) -> None:
        if mission_type in self.refuses:
            raise PeerError("vehicle 1 refused.")
        self.uploads.append(mission_type)
        self.items[mission_type] = tuple(items)

    async def upload_mission(self, mission: VehicleMission) -> None:
        await self.upload_items(mission.items)

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        return {name: self.values[name] for name in names}

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        for one in parameters:
            if one.name in self.refuses:
                raise PeerTimeout(f"vehicle 1 does not answer for parameter {one.name}.")
            self.values[one.name] = one

    async def home(self) -> Home | None:
        return HOME


def load(sysid: int = 1) -> VehicleLoad:
    mission = VehicleMission(sysid, HOME, NEW, (None,) * 3)
    return VehicleLoad(mission, AREA, (), (("RTL_RETURN_ALT", 30.0), ("RTL_CONE", 0)))


def after_upload(vehicle: Vehicle) -> LoadBefore:
    """What was on board, once the load is there."""
    (before,) = asyncio.run(read_before({vehicle.sysid: vehicle}, [load(vehicle.sysid)]))
    vehicle.items[MISSION] = NEW
    for change in before.changes:
        vehicle.values[change.after.name] = change.after
    return before


def given_back(vehicle: Vehicle, before: LoadBefore) -> str:
    return " ".join(asyncio.run(give_back({vehicle.sysid: vehicle}, [before])))


def test_what_the_upload_replaced_comes_back_and_the_rest_is_left_alone() -> None:
    vehicle = Vehicle()
    before = after_upload(vehicle)
    assert str(before) == "mission of 2 items, fence of 3 items (as planned), no rally points (as planned)"
    assert before.data()["mission"] == 2
    assert before.data()["as_planned"] == ["fence", "rally"]
    assert given_back(vehicle, before) == ""
    assert vehicle.items[MISSION] == OLD
    assert {name: one.value for name, one in vehicle.values.items()} == {"RTL_RETURN_ALT": 60.0, "RTL_CONE": 45}
    assert vehicle.uploads == [MISSION]


def test_vehicles_with_the_same_on_board_are_one_line() -> None:
    every = [LoadBefore(1, 12, items={MISSION: OLD}), LoadBefore(2, 12, items={MISSION: ()}),
             LoadBefore(3, 12, items={MISSION: OLD})]  # fmt: skip
    assert before_words(every) == ["vehicles 1, 3: mission of 2 items", "vehicle 2: no mission"]
    assert part_words(RALLY, 1) == "1 rally point"
    fenced = LoadBefore(1, 3, items={FENCE: AREA}, fence=Parameter("FENCE_ENABLE", 1, INT))
    assert before_words([fenced]) == ["vehicle 1: fence of 3 items, FENCE_ENABLE 1"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ({"age_s": 40.0}, f"{EVERYTHING} (its last heartbeat is 40 s old)"),
        ({"age_s": math.inf}, f"{EVERYTHING} (it is not there)"),
        ({"armed": True}, "mission of 2 items (it is armed)"),
        ({"refuses": {"RTL_CONE"}}, "RTL_CONE 45 (now 0) (vehicle 1 does not answer for parameter RTL_CONE)"),
        ({"refuses": {MISSION}}, "mission of 2 items (vehicle 1 refused)"),
    ],
)
def test_what_cannot_be_given_back_is_named_with_its_value_and_the_reason(spoil: dict[str, Any], words: str) -> None:
    vehicle = Vehicle()
    before = after_upload(vehicle)
    vars(vehicle).update(spoil)
    assert given_back(vehicle, before) == f"vehicle 1 did not get back {words}"
    assert (vehicle.items[MISSION] == OLD) == ("mission" not in words)
    assert (vehicle.values["RTL_RETURN_ALT"].value == 60.0) == ("RTL_RETURN_ALT" not in words)


def test_what_could_not_be_read_is_said_before_and_after() -> None:
    vehicle = Vehicle()
    vehicle.refuses = {FENCE}
    before = after_upload(vehicle)
    assert str(before) == "mission of 2 items, no rally points (as planned), fence not read: vehicle 1 refused"
    assert given_back(vehicle, before) == (
        "vehicle 1 did not get back fence (not read before the upload: vehicle 1 refused)"
    )


def test_the_record_gives_back_the_same(tmp_path: Path) -> None:
    vehicle = Vehicle()
    before = replace(after_upload(vehicle), unread={RALLY: "refused"})
    record_before(tmp_path / "record.json", "ab", {1: "cd"}, [before, LoadBefore(7, int(Autopilot.ARDUPILOT))])
    first, second = recorded_before(tmp_path / "record.json")
    assert (first.changes, first.autopilot, dict(first.unread)) == (before.changes, 12, {RALLY: "refused"})
    assert repr(first.items) == repr(before.items)  # NaN is not equal to itself
    assert first.same == {FENCE, RALLY}
    assert (second.sysid, second.autopilot, second.changes, second.items) == (7, 3, (), {})


def test_an_older_record_has_parameters_alone(tmp_path: Path) -> None:
    row = {"vehicle": 3, "name": "RTL_ALT", "before": 1500, "after": 3000, "type": INT}
    (tmp_path / "old.json").write_text(json.dumps({"format": "skein-upload", "parameters": [row]}))
    (one,) = recorded_before(tmp_path / "old.json")
    change = ParameterChange(3, Parameter("RTL_ALT", 1500, INT), Parameter("RTL_ALT", 3000, INT))
    assert (one.sysid, one.changes, one.items) == (3, (change,), {})


def recorded(tmp_path: Path, rows: object) -> tuple[LoadBefore, ...]:
    (tmp_path / "record.json").write_text(json.dumps({"format": "skein-upload", "before": rows}))
    return recorded_before(tmp_path / "record.json")


@pytest.mark.parametrize(
    "rows",
    [
        [{"sysid": 1}],
        [{**BARE, "items": {"0": [{**ITEM, "command": 1e9}]}}],
        [{**BARE, "items": {"0": [{**ITEM, "lat_degE7": 0.5}]}}],
        [{**BARE, "items": {"0": [{"command": 16}]}}],
        [{**BARE, "items": {"9": []}}],
        [{**BARE, "items": [1]}],
        {"sysid": 1},
        7,
    ],
)
def test_a_record_of_something_else_is_refused(tmp_path: Path, rows: object) -> None:
    assert recorded(tmp_path, [{**BARE, "items": {"0": [ITEM]}}])
    with pytest.raises(FileFormatError, match="not the record of an upload"):
        recorded(tmp_path, rows)
