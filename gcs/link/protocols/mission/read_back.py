"""Comparison of the mission that was read back with the mission that was sent, by meaning.

Compared are the number of items and, per item, command, parameters 1 to 4, latitude, longitude, altitude, frame (of
items with a position) and autocontinue (of missions). What an autopilot makes of each field of each item stands in its
row (`LinkBehaviour.item_storage`). Allowed everywhere: float32 rounding; NaN for NaN; the frame of items without a
position; integer frames for float ones and back (5 = 0, 6 = 3, 11 = 10); `autocontinue` of fences and rally points,
where it has no meaning.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from gcs.autopilots.mission_commands import has_position
from gcs.autopilots.stored_fields import FieldRule, ItemStorage, StoredAs
from gcs.autopilots.traits import link_behaviour
from gcs.errors import PeerError
from gcs.link.protocols.mission.item_messages import file_frame
from gcs.link.wire.message import Station
from gcs.mavlink import FenceCommand
from gcs.mavlink_names import mission_type_words
from gcs.mission.model import MissionItem

_LISTED_MAX = 5
_FENCE_AND_RALLY = frozenset(FenceCommand)


@dataclass(frozen=True)
class Difference:
    """One difference. `item` counts from 0 in the lists compared."""

    item: int
    what: str
    sent: object
    read_back: object

    def __str__(self) -> str:
        return f"item {self.item}: {self.what} sent {self.sent}, read back {self.read_back}"


def compare_missions(
    sent: Sequence[MissionItem], read_back: Sequence[MissionItem], *, autopilot: int
) -> list[Difference]:
    """Return all differences in meaning; an empty list means that what was sent is on board.

    `autopilot` is MAV_AUTOPILOT. On ArduPilot leave out item 0 on both sides: it always reads back as home.
    """
    storage = link_behaviour(autopilot).item_storage
    differences = []
    if len(sent) != len(read_back):
        shorter = min(len(sent), len(read_back))
        differences.append(Difference(shorter, "number of items", len(sent), len(read_back)))
    for index, (ours, theirs) in enumerate(zip(sent, read_back, strict=False)):
        differences += [Difference(index, *d) for d in _item_differences(ours, theirs, storage)]
    return differences


def read_back_error(peer: Station, mission_type: int, differences: Sequence[Difference]) -> PeerError:
    """Return the error of a read-back with these differences."""
    listed = "; ".join(str(d) for d in differences[:_LISTED_MAX])
    more = f"; and {len(differences) - _LISTED_MAX} more" if len(differences) > _LISTED_MAX else ""
    return PeerError(
        f"the {mission_type_words(mission_type)} read back from {peer} differs from what was sent: {listed}{more}.",
        hint="upload again; if the error persists, the autopilot does not store these items unchanged",
    )


def _item_differences(ours: MissionItem, theirs: MissionItem, storage: ItemStorage) -> list[tuple[str, object, object]]:
    if ours.command != theirs.command:
        return [("command", ours.command, theirs.command)]
    rules = storage.of(ours.command)
    fields: list[tuple[str, FieldRule, float, float]] = [
        (f"parameter {number}", rule, a, b)
        for number, (rule, a, b) in enumerate(zip(rules.params, ours.params, theirs.params, strict=True), start=1)
    ]
    fields.append(("altitude (m)", rules.z, ours.alt_m, theirs.alt_m))
    if has_position(ours.command):
        fields.append(("frame", rules.frame, file_frame(ours.frame), file_frame(theirs.frame)))
    if ours.command not in _FENCE_AND_RALLY:
        fields.append(("autocontinue", rules.autocontinue, ours.autocontinue, theirs.autocontinue))
    found: list[tuple[str, object, object]] = [(what, a, b) for what, rule, a, b in fields if not rule.survives(a, b)]
    # Single precision has steps of up to 128 here: whole numbers are compared as they are.
    for what, rule, x, y in (
        ("latitude (1e-7 deg)", rules.x, ours.lat_degE7, theirs.lat_degE7),
        ("longitude (1e-7 deg)", rules.y, ours.lon_degE7, theirs.lon_degE7),
    ):
        if x != y and (rule.stored is StoredAs.EXACT or not rule.survives(x, y)):
            found.append((what, x, y))
    return found
