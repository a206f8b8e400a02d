"""Mission items to and from MISSION_ITEM_INT fields.

Knows: the wire's frames (5, 6, 11 for the files' 0, 3, 10), scaled integers, the home item. Does not know:
who sends, how often, or why. Floats on the wire are float32: see `mission_compare` for what comes back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs.errors import PeerError
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionType, WireFrame
from gcs.mission.model import Command, Frame, Home, MissionItem

_TO_WIRE = {
    0: WireFrame.GLOBAL_INT,
    3: WireFrame.GLOBAL_RELATIVE_ALT_INT,
    10: WireFrame.GLOBAL_TERRAIN_ALT_INT,
}
_FROM_WIRE = {int(wire): file for file, wire in _TO_WIRE.items()}


def item_to_message(
    item: MissionItem,
    seq: int,
    target: Station,
    *,
    current: bool = False,
    mission_type: int = MissionType.MISSION,
) -> Message:
    """MISSION_ITEM_INT for one item. `current` marks the item to start with (on ArduPilot: home, item 0)."""
    p1, p2, p3, p4 = item.params
    return Message(
        "MISSION_ITEM_INT",
        {
            "target_system": target.sysid,
            "target_component": target.compid,
            "seq": seq,
            "frame": int(_TO_WIRE.get(item.frame, item.frame)),
            "command": item.command,
            "current": int(current),
            "autocontinue": int(item.autocontinue),
            "param1": p1,
            "param2": p2,
            "param3": p3,
            "param4": p4,
            "x": item.lat_degE7,
            "y": item.lon_degE7,
            "z": item.alt_m,
            "mission_type": mission_type,
        },
    )


def item_from_message(message: Message) -> MissionItem:
    """The item in a MISSION_ITEM_INT, or in a MISSION_ITEM, whose degrees are float32 (0.5 m of longitude).

    Raises `PeerError` where a float position is not a number and so cannot be held.
    """
    f = message.fields
    x, y = f["x"], f["y"]
    if message.name == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y)):
            raise PeerError(f"{message.source} sent mission item {f['seq']} with a position that is not a number.")
        x, y = round(x * 1e7), round(y * 1e7)
    return MissionItem(
        command=f["command"],
        frame=_FROM_WIRE.get(f["frame"], f["frame"]),
        params=(f["param1"], f["param2"], f["param3"], f["param4"]),
        lat_degE7=x,
        lon_degE7=y,
        alt_m=f["z"],
        autocontinue=bool(f["autocontinue"]),
    )


def home_item(home: Home) -> MissionItem:
    """Home as ArduPilot wants it: item 0, a waypoint with altitude AMSL."""
    return MissionItem(
        command=Command.NAV_WAYPOINT,
        frame=Frame.GLOBAL,
        params=(0.0, 0.0, 0.0, 0.0),
        lat_degE7=round(home.lat_deg * 1e7),
        lon_degE7=round(home.lon_deg * 1e7),
        alt_m=home.alt_amsl_m,
    )


def with_home(items: Sequence[MissionItem], home: Home) -> tuple[MissionItem, ...]:
    """What ArduPilot is sent: home as item 0, then the items."""
    return (home_item(home), *items)
