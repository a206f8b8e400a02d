"""The comparison of a read-back against what real autopilots reported: no false alarm, and no change missed.

`tests/recorded/read_back.jsonl` holds the frames of uploads to ArduCopter 4.5.6 and 4.7-dev and PX4 1.17-dev, and of
the downloads after them.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.mission_commands import has_position
from gcs.autopilots.stored_fields import FieldRule, StorageSource, StoredAs
from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.item_messages import item_from_message
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
from gcs.mavlink import FenceCommand, MavCommand, MissionType
from gcs.mission.model import MissionItem

RECORDED = Path(__file__).parents[4] / "recorded" / "read_back.jsonl"
UPLOADS = [json.loads(line) for line in RECORDED.read_text(encoding="utf-8").splitlines()]
WRITTEN = (  # by the exporters: missions, fences, rally points
    *(MavCommand.NAV_TAKEOFF, MavCommand.NAV_WAYPOINT, MavCommand.NAV_LAND),
    *(MavCommand.NAV_DELAY, MavCommand.DO_CHANGE_SPEED),
    *FenceCommand,
)
FIELDS = ("param1", "param2", "param3", "param4", "z", "x", "y", "frame", "autocontinue", "command")
TOLERANCE = {  # by which a field may differ from what is expected
    StoredAs.CENTIMETRES: 0.0101,
    StoredAs.HEADING: 1e-3,
}


def items(frames: list[str]) -> list[MissionItem]:
    """The items of recorded MISSION_ITEM_INT frames."""
    codec = Codec(255, 190)
    return [item_from_message(message) for frame in frames for message in codec.decode(bytes.fromhex(frame))]


def pairs() -> list[tuple[int, MissionItem, MissionItem]]:
    """Every recorded item as (autopilot, sent, read back), without ArduPilot's home."""
    found = []
    for upload in UPLOADS:
        home = Autopilot(upload["autopilot"]).home_is_item_0 and upload["mission_type"] == MissionType.MISSION
        both = zip(items(upload["sent"]), items(upload["read_back"]), strict=True)
        found += [(upload["autopilot"], a, b) for a, b in list(both)[int(home) :]]
    return found


PAIRS = pairs()


def named(upload: dict[str, Any]) -> str:
    return f"{upload['vehicle']}: {upload['upload']}"


@pytest.mark.parametrize("upload", UPLOADS, ids=named)
def test_what_a_real_vehicle_stored_is_no_difference(upload: dict[str, Any]) -> None:
    first = int(Autopilot(upload["autopilot"]).home_is_item_0 and upload["mission_type"] == MissionType.MISSION)
    sent, read_back = items(upload["sent"])[first:], items(upload["read_back"])[first:]
    assert compare_missions(sent, read_back, autopilot=upload["autopilot"]) == []


def rule_of(autopilot: int, item: MissionItem, what: str) -> FieldRule:
    rule = getattr(Autopilot(autopilot).traits.link.item_storage.of(item.command), what)
    assert isinstance(rule, FieldRule)
    return rule


def changed(item: MissionItem, what: str, by: float) -> MissionItem | None:
    """The item with another value of one field; None where single precision does not show the change."""
    whole = int(math.copysign(math.ceil(abs(by)), by))
    if what.startswith("param"):
        number = int(what[-1]) - 1
        before = item.params[number]
        after = by if math.isnan(before) else before + by
        params = tuple(after if n == number else p for n, p in enumerate(item.params))
        return replace(item, params=params) if np.float32(after) != np.float32(before) else None  # type: ignore[arg-type]
    if what == "z":
        after = item.alt_m + by
        return replace(item, alt_m=after) if np.float32(after) != np.float32(item.alt_m) else None
    if what == "x":
        return replace(item, lat_degE7=item.lat_degE7 + whole)
    if what == "y":
        return replace(item, lon_degE7=item.lon_degE7 + whole)
    if what == "frame":
        return replace(item, frame={0: 3, 3: 0}.get(item.frame, item.frame)) if has_position(item.command) else None
    if what == "autocontinue":
        return None if item.command in set(FenceCommand) else replace(item, autocontinue=not item.autocontinue)
    return replace(item, command=item.command + 1)


def same_value(one: MissionItem, other: MissionItem, what: str) -> bool:
    a, b = ((i.alt_m if what == "z" else i.params[int(what[-1]) - 1]) for i in (one, other))
    return bool(np.float32(a) == np.float32(b))


@given(
    pair=st.sampled_from(PAIRS),
    what=st.sampled_from(FIELDS),
    by=st.floats(0.0, 150.0, exclude_min=True, allow_subnormal=False),
    sign=st.sampled_from((-1.0, 1.0)),
)
def test_a_changed_value_is_reported(
    pair: tuple[int, MissionItem, MissionItem], what: str, by: float, sign: float
) -> None:
    """Any change of what a real vehicle reported by more than the tolerance of the field."""
    autopilot, sent, read_back = pair
    tolerance = 0.0
    if what != "command":
        stored = rule_of(autopilot, sent, what).stored
        tolerance = 2.0 * TOLERANCE.get(stored, 0.0)  # the recorded value may be at one end
        if stored is StoredAs.ZERO and what == "frame":
            return  # ArduPilot has no frames of fences
    other = changed(read_back, what, (tolerance + by) * sign)
    if other is None or (what.startswith(("param", "z")) and same_value(other, sent, what)):
        return  # no change, or as it was sent
    found = compare_missions([sent], [other], autopilot=autopilot)
    assert len(found) == 1, f"{what} of {sent}: {read_back} changed to {other}"


@given(st.sampled_from(PAIRS), st.integers(0, 20))
def test_every_missing_item_is_reported(pair: tuple[int, MissionItem, MissionItem], more: int) -> None:
    autopilot, sent, read_back = pair
    assert compare_missions([sent] * (more + 2), [read_back] * (more + 1), autopilot=autopilot)


@pytest.mark.parametrize("autopilot", list(Autopilot), ids=lambda known: known.key)
@pytest.mark.parametrize("command", WRITTEN, ids=lambda command: command.name)
def test_every_field_of_every_item_that_is_written_has_a_rule_with_a_source(autopilot: Autopilot, command: int) -> None:
    row = autopilot.traits.link.item_storage.of(command)
    for what in (*FIELDS[:-1],):
        assert getattr(row, what).source is not StorageSource.ASSUMED, what


@pytest.mark.parametrize(
    ("sent_deg", "read_deg", "same"),
    [
        (343.36, 343.359955, True),
        (0.0, 359.9999, True),
        (359.9999, 0.0, True),
        (-10.0, 350.0, True),
        (360.0, 0.0, True),
        (343.36, 343.3615, False),
        (90.0, -90.0, False),
        (math.nan, 0.0, False),
        (0.0, math.nan, False),
        (math.nan, math.nan, True),
        (90.0, math.inf, False),
    ],
)
def test_headings_are_compared_as_angles(sent_deg: float, read_deg: float, same: bool) -> None:
    assert StoredAs.HEADING.survives(sent_deg, read_deg) is same


@given(st.floats(-720.0, 720.0))
def test_a_heading_survives_the_radians_of_a_real_vehicle(heading_deg: float) -> None:
    sent = np.float32(heading_deg)
    turned = np.float32(np.radians(sent, dtype=np.float32)) % np.float32(2.0 * np.pi)
    assert StoredAs.HEADING.survives(heading_deg, float(np.degrees(np.float32(turned), dtype=np.float32)))


@pytest.mark.parametrize(
    ("stored", "sent", "read_back", "same"),
    [
        (StoredAs.WHOLE, 45.23, 45.0, True),
        (StoredAs.WHOLE, 45.23, 46.0, False),
        (StoredAs.WHOLE, 0.4, 0.0, True),
        (StoredAs.WHOLE, -1.7, -1.0, True),
        (StoredAs.WHOLE, 300.0, 44.0, False),  # a byte that ran over
        (StoredAs.WHOLE, math.nan, 0.0, False),
        (StoredAs.SIGN, -4.0, -1.0, True),
        (StoredAs.SIGN, math.nan, 1.0, True),
        (StoredAs.SIGN, 12.34, 12.0, False),
        (StoredAs.SIGN, 12.34, 12.34, True),  # a version that keeps it
        (StoredAs.FLAG, 0.2, 1.0, True),
        (StoredAs.FLAG, 0.2, 0.3, False),
        (StoredAs.FLAG, -1.0, 0.0, True),
        (StoredAs.ZERO, math.nan, 0.0, True),
        (StoredAs.ZERO, 1.0, 2.0, False),
        (StoredAs.CENTIMETRES, 5.14685714, 5.13999987, True),
        (StoredAs.CENTIMETRES, 5.14685714, 5.12999987, False),
        (StoredAs.EXACT, 2.8418, 2.84179997, True),
        (StoredAs.EXACT, 2.8418, 2.8419, False),
    ],
)
def test_rules_of_single_fields(stored: StoredAs, sent: float, read_back: float, same: bool) -> None:
    assert stored.survives(sent, read_back) is same


@pytest.mark.parametrize("autopilot", [*map(int, Autopilot), 0], ids=lambda number: f"autopilot {number}")
@pytest.mark.parametrize("frame", [0, 3])
def test_px4_gets_rally_points_in_a_frame_that_it_can_return_to(autopilot: int, frame: int) -> None:
    """PX4 stores the frame that was sent, and ignores rally points of frames 5 and 6. Careful with unknown ones too."""
    point = MissionItem(FenceCommand.RALLY_POINT, frame, (0.0, 0.0, 0.0, 0.0), 473977420, 85455939, 20.0)
    vehicle = Station(1, 1)
    upload = VerifiedUpload([point], Exchange(vehicle, autopilot), mission_type=MissionType.RALLY)
    upload.start(0.0)
    request = {"target_system": 255, "target_component": 190, "seq": 0, "mission_type": int(MissionType.RALLY)}
    (sent,) = upload.receive(Message("MISSION_REQUEST_INT", request, *vehicle), 0.1)
    integer = {0: 5, 3: 6}[frame]
    assert sent.fields["frame"] == (integer if autopilot == Autopilot.ARDUPILOT else frame)
    assert sent.fields["x"] == point.lat_degE7
