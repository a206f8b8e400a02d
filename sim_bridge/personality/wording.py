"""The STATUSTEXT occasions, for which each autopilot has its own text, or none."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, auto

from gcs.mavlink import Severity


class Note(Enum):
    """An occasion for a STATUSTEXT; the comment has the values its text may quote."""

    ARMED = auto()
    ARMED_FOR_MISSION = auto()
    DISARMED = auto()
    DISARMED_IDLE = auto()
    DISARMED_LANDED = auto()
    ARM_REFUSED = auto()  # {reason}
    CHECKS_FAIL = auto()  # {reason}: of a periodic check, without an attempt to arm
    DISARM_REFUSED = auto()
    MODE_UNKNOWN = auto()  # {mode}: number
    MODE_REFUSED = auto()  # {mode}: name
    MISSION_REFUSED = auto()
    STREAM_UNKNOWN = auto()  # {number}
    LIFTED_OFF = auto()
    LANDED = auto()
    MISSION_BEGINS = auto()
    MISSION_CLIMBS = auto()  # {height_m}
    MISSION_ENDS = auto()  # landed
    ITEM_BEGINS = auto()  # {seq}, {name}
    DELAY_BEGINS = auto()  # {seconds}
    WAYPOINT_REACHED = auto()  # {seq}
    RETURN_BEGINS = auto()  # {alt_m}, {height_m}
    RETURN_LANDS = auto()
    FAILSAFE = auto()
    LINK_LOST = auto()  # {action}
    LINK_FOUND = auto()
    BATTERY_LOW = auto()  # {volt}, {mAh}
    BATTERY_CRITICAL = auto()
    BATTERY_EMERGENCY = auto()
    PLACE_LOST = auto()  # {action}
    FENCE_BREACHED = auto()  # {fence}


Words = Mapping[Note, tuple[Severity, str]]
