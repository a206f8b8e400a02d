"""`.fence` and `.rally` files: the same table as `.waypoints`, holding fence or rally items.

Knows: which items belong in which, that some programs write a home row before them. Does not know: the table itself
(`waypoints`), geometry. MAVProxy and pymavlink read and write them without a home row, and so do we.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from gcs.errors import FileFormatError
from gcs.mission.geofence import (
    BadItem,
    Geofence,
    RallyPoint,
    fence_from_items,
    fence_items,
    rally_from_items,
    rally_items,
)
from gcs.mission.model import Command, Frame, MissionItem
from gcs.mission.waypoints import WaypointFile, read_waypoints, write_waypoints

Content = TypeVar("Content")


def write_fence(fence: Geofence) -> str:
    """The text of a file; `read_fence` gives back the same values."""
    return write_waypoints(WaypointFile(None, fence_items(fence)))


def read_fence(text: str | bytes, source: str) -> Geofence:
    """The fence in a file. Raises `FileFormatError` with file and reason."""
    return _read(text, source, fence_from_items)


def write_rally(points: Sequence[RallyPoint]) -> str:
    """The text of a file; `read_rally` gives back the same values."""
    return write_waypoints(WaypointFile(None, rally_items(points)))


def read_rally(text: str | bytes, source: str) -> tuple[RallyPoint, ...]:
    """The rally points in a file. Raises `FileFormatError` with file and reason."""
    return _read(text, source, rally_from_items)


def _read(text: str | bytes, source: str, convert: Callable[[Sequence[MissionItem]], Content]) -> Content:
    file = read_waypoints(text, source, home_first=False)
    items, skipped = file.items, 0
    if items and (items[0].frame, items[0].command) == (Frame.GLOBAL, Command.NAV_WAYPOINT):
        items, skipped = items[1:], 1
    try:
        return convert(items)
    except BadItem as error:
        raise FileFormatError(f"{source}, line {file.lines[error.index + skipped]}: {error}.") from error
