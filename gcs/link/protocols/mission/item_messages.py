"""Mission items to and from MISSION_ITEM_INT fields: frames of links (5, 6, 11 for 0, 3, 10 of files), scaled integers.

Floats on the wire are float32: `read_back` compares what returns.
"""

import math
from collections.abc import Sequence

from gcs.errors import PeerError
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionType, WireFrame
from gcs.mission.model import Command, Frame, Home, MissionItem

_TO_WIRE: dict[int, WireFrame] = {
    WireFrame.GLOBAL: WireFrame.GLOBAL_INT,
    WireFrame.GLOBAL_RELATIVE_ALT: WireFrame.GLOBAL_RELATIVE_ALT_INT,
    WireFrame.GLOBAL_TERRAIN_ALT: WireFrame.GLOBAL_TERRAIN_ALT_INT,
}
_FROM_WIRE: dict[int, int] = {int(wire): int(file) for file, wire in _TO_WIRE.items()}


def file_frame(frame: int) -> int:
    """Return the frame of files for a frame of links (0, 3, 10 for 5, 6, 11); any other is unchanged."""
    return _FROM_WIRE.get(frame, frame)


def item_to_message(
    item: MissionItem,
    seq: int,
    peer: Station,
    *,
    current: bool = False,
    mission_type: int = MissionType.MISSION,
    integer_frames: bool = True,
) -> Message:
    """Return MISSION_ITEM_INT of one item. `current` marks the item to start with (on ArduPilot: home, item 0).

    Without `integer_frames` the frame is that of the item (0, 3, 10); the position is in 1e-7 deg in both.
    """
    p1, p2, p3, p4 = item.params
    return Message(
        "MISSION_ITEM_INT",
        {
            **peer.target,
            "seq": seq,
            "frame": int(_TO_WIRE.get(item.frame, item.frame) if integer_frames else item.frame),
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
    """Return the item of a MISSION_ITEM_INT, or of a MISSION_ITEM, whose degrees are float32 (0.5 m of longitude).

    Raises `PeerError` if a float position is not a finite number.
    """
    f = message.fields
    x, y = f["x"], f["y"]
    if message.name == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y)):
            raise PeerError(f"{message.source} sent mission item {f['seq']} without a finite position.")
        x, y = round(x * 1e7), round(y * 1e7)
    return MissionItem(
        command=f["command"],
        frame=file_frame(f["frame"]),
        params=(f["param1"], f["param2"], f["param3"], f["param4"]),
        lat_degE7=x,
        lon_degE7=y,
        alt_m=f["z"],
        autocontinue=bool(f["autocontinue"]),
    )


def home_item(home: Home) -> MissionItem:
    """Return home as ArduPilot stores it: item 0, a waypoint with altitude AMSL."""
    return MissionItem(
        command=Command.NAV_WAYPOINT,
        frame=Frame.GLOBAL,
        params=(0.0, 0.0, 0.0, 0.0),
        lat_degE7=round(home.lat_deg * 1e7),
        lon_degE7=round(home.lon_deg * 1e7),
        alt_m=home.alt_amsl_m,
    )


def with_home(items: Sequence[MissionItem], home: Home) -> tuple[MissionItem, ...]:
    """Return the items for ArduPilot: home as item 0, then the mission."""
    return (home_item(home), *items)
