"""The emulated stores against real ones: what was uploaded to them reads back as recorded, number by number."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.frames import Origin
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import MissionResult, MissionType
from sim_bridge.missions.store import MissionStore
from sim_bridge.missions.transfer_traits import MissionTraits
from sim_bridge.personality import by_name

RECORDED = Path(__file__).parents[3] / "recorded" / "read_back.jsonl"
UPLOADS = [json.loads(line) for line in RECORDED.read_text(encoding="utf-8").splitlines()]
ME = Station(1, 1)
HOME = Origin(-35.363261, 149.1652299, 584.084)
PX4 = by_name("px4").missions
COMPARED = ("seq", "command", "frame", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")


def frames(upload: dict[str, Any], side: str) -> list[Message]:
    codec = Codec(255, 190)
    return [message for frame in upload[side] for message in codec.decode(bytes.fromhex(frame))]


class Shelf:
    """A store, and what it said."""

    def __init__(self, traits: MissionTraits) -> None:
        self.texts: list[str] = []
        self.store = MissionStore(ME, traits, HOME, lambda *_: None, lambda _, text: self.texts.append(text))

    def put(self, items: list[Message], kind: int) -> MissionResult:
        count = {"target_system": 1, "target_component": 1, "count": len(items), "mission_type": kind}
        answers = self.store.receive(Message("MISSION_COUNT", count, *GROUND), 0.0)
        for item in items:
            answers = self.store.receive(Message(item.name, item.fields, *GROUND), 0.0)
        return MissionResult(answers[0].fields["type"])


@pytest.mark.parametrize("upload", UPLOADS, ids=lambda upload: f"{upload['vehicle']}: {upload['upload']}")
def test_items_read_back_as_recorded(upload: dict[str, Any]) -> None:
    traits = by_name("ardupilot" if upload["autopilot"] == 3 else "px4").missions
    shelf, kind = Shelf(traits), upload["mission_type"]
    assert shelf.put(frames(upload, "sent"), kind) == MissionResult.ACCEPTED
    first = int(traits.home_is_item_0 and kind == MissionType.MISSION)
    wanted, found = frames(upload, "read_back")[first:], shelf.store.read_back(kind)[first:]
    assert len(wanted) == len(found)
    for ours, theirs in zip(found, wanted, strict=True):
        for name in COMPARED:
            a, b = ours.fields[name], theirs.fields[name]
            same = np.float32(a) == np.float32(b) if name.startswith("param") or name == "z" else a == b
            assert same or (math.isnan(a) and math.isnan(b)), f"item {theirs.fields['seq']}: {name} {a}, recorded {b}"


def rally(frame: int, lat_degE7: int = -353500000) -> Message:
    fields = {"target_system": 1, "target_component": 1, "seq": 0, "frame": frame, "command": 5100, "current": 0}
    fields |= {"autocontinue": 1, "x": lat_degE7, "y": 1491652299, "mission_type": int(MissionType.RALLY)}
    return Message(
        "MISSION_ITEM_INT", {**fields, "param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": 0.0, "z": 20.0}
    )


@pytest.mark.parametrize(("frame", "usable"), [(0, True), (3, True), (5, False), (6, False)])
def test_px4_does_not_return_to_points_of_integer_frames_and_says_so_every_2_s(frame: int, usable: bool) -> None:
    shelf = Shelf(PX4)
    assert shelf.put([rally(frame)], MissionType.RALLY) == MissionResult.ACCEPTED
    points = shelf.store.items(MissionType.RALLY)
    assert bool(shelf.store.usable_rally(points)) is usable
    assert shelf.store.waits is not usable
    for tick in range(50):  # 5 s
        shelf.store.tick(0.1 * tick)
    assert shelf.texts == ([] if usable else ["RTL: unsupported MAV_FRAME\t"] * 3)
    (read_back,) = shelf.store.read_back(MissionType.RALLY)
    assert read_back.fields["frame"] in (5, 6)
    assert shelf.put([rally(3)], MissionType.RALLY) == MissionResult.ACCEPTED
    assert not shelf.store.waits


def test_px4_does_not_look_at_points_beside_home() -> None:
    shelf = Shelf(PX4)
    shelf.put([rally(6, -353632610 + 500)], MissionType.RALLY)
    for second in range(10):
        shelf.store.tick(float(second))
    assert shelf.texts == []
