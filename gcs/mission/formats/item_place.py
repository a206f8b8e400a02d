"""Coordinates of a mission item in files: degrees, or plain numbers in frame 2; some may be missing."""

import math
from collections.abc import Callable, Sequence

from gcs.autopilots.mission_commands import has_position
from gcs.frames import to_degE7
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.mission.model import Frame, MissionItem

Note = Callable[[QuirkKind, str], None]


def place_on_wire(command: int, frame: int, place: Sequence[float | None], note: Note) -> tuple[int, int, float]:
    """Columns x, y and z of an item in the units of links; None is a value that the file leaves open.

    An item without a position has 0 for what is open, with a warning; any other item raises ValueError.
    """
    given = [None if value is None or math.isnan(value) else value for value in place]
    if None in given:
        if frame != Frame.MISSION and has_position(command):
            raise ValueError("the position is missing or not a number")
        note(QuirkKind.NO_PLACE, f"command {command} in frame {frame} has no position, and open coordinates: read as 0")
    x, y, z = (0.0 if value is None else value for value in given)
    lat, lon = _on_wire(frame, x, y, note)
    return lat, lon, z


def _on_wire(frame: int, x: float, y: float, note: Note) -> tuple[int, int]:
    if frame == Frame.MISSION:
        if not max(abs(x), abs(y)) < 2**31:
            raise ValueError(f"parameters 5 and 6 of an item in frame 2 must be below 2^31, got {x:g}, {y:g}")
        if x != int(x) or y != int(y):
            text = f"parameters 5 and 6 of an item in frame 2 are integers on the wire: {x:g}, {y:g} read as"
            note(QuirkKind.FRACTION, f"{text} {int(x)}, {int(y)}")
        return int(x), int(y)
    if not (abs(x) <= 90 and abs(y) <= 180):
        raise ValueError(f"latitude {x}, longitude {y} is not on Earth")
    return to_degE7(x), to_degE7(y)


def place_in_file(item: MissionItem) -> tuple[float, float]:
    """Inverse of `place_on_wire`, without the altitude."""
    if item.frame == Frame.MISSION:
        return float(item.lat_degE7), float(item.lon_degE7)
    return item.place_deg
