"""Comparison of the mission that was read back with the mission that was sent, by meaning.

Allowed everywhere: float32 rounding; NaN for NaN; the frame of items without a position; integer frames for float ones
and back (5 = 0, 6 = 3, 11 = 10); `autocontinue` of fences and rally points, where it has no meaning. Latitude and
longitude must agree to the last 1e-7 degree.
What else one autopilot may change stands in its row (`LinkBehaviour.read_back`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.autopilots.columns import ReadBackRules
from gcs.autopilots.mission_commands import has_position
from gcs.autopilots.traits import link_behaviour
from gcs.errors import PeerError
from gcs.link.mission_protocol.item_messages import file_frame
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
    rules = link_behaviour(autopilot).read_back
    differences = []
    if len(sent) != len(read_back):
        shorter = min(len(sent), len(read_back))
        differences.append(Difference(shorter, "number of items", len(sent), len(read_back)))
    for index, (ours, theirs) in enumerate(zip(sent, read_back, strict=False)):
        differences += [Difference(index, *d) for d in _item_differences(ours, theirs, rules)]
    return differences


def read_back_error(peer: Station, mission_type: int, differences: Sequence[Difference]) -> PeerError:
    """Return the error of a read-back with these differences."""
    listed = "; ".join(str(d) for d in differences[:_LISTED_MAX])
    more = f"; and {len(differences) - _LISTED_MAX} more" if len(differences) > _LISTED_MAX else ""
    return PeerError(
        f"the {mission_type_words(mission_type)} read back from {peer} differs from what was sent: {listed}{more}.",
        hint="upload again; if the error persists, the autopilot does not store these items unchanged",
    )


def _item_differences(ours: MissionItem, theirs: MissionItem, rules: ReadBackRules) -> list[tuple[str, object, object]]:
    found: list[tuple[str, object, object]] = []
    if ours.command != theirs.command:
        return [("command", ours.command, theirs.command)]
    if has_position(ours.command) and file_frame(ours.frame) != file_frame(theirs.frame):
        found.append(("frame", ours.frame, theirs.frame))
    for number, (a, b) in enumerate(zip(ours.params, theirs.params, strict=True), start=1):
        if not (_same_float(a, b) or rules.allows(ours.command, number, a, b)):
            found.append((f"parameter {number}", a, b))
    if ours.lat_degE7 != theirs.lat_degE7:
        found.append(("latitude (1e-7 deg)", ours.lat_degE7, theirs.lat_degE7))
    if ours.lon_degE7 != theirs.lon_degE7:
        found.append(("longitude (1e-7 deg)", ours.lon_degE7, theirs.lon_degE7))
    if not _same_float(ours.alt_m, theirs.alt_m, absolute=rules.altitude_m):
        found.append(("altitude (m)", ours.alt_m, theirs.alt_m))
    if ours.autocontinue != theirs.autocontinue and ours.command not in _FENCE_AND_RALLY:
        found.append(("autocontinue", ours.autocontinue, theirs.autocontinue))
    return found


def _same_float(ours: float, theirs: float, absolute: float = 0.0) -> bool:
    if math.isnan(ours) or math.isnan(theirs):
        return math.isnan(ours) and math.isnan(theirs)
    if np.float32(ours) == np.float32(theirs):
        return True
    return abs(ours - theirs) <= absolute
