"""What differs between the autopilots' mission files.

Knows: their number and whether home counts as an item. Does not know: formats, links.
"""

from __future__ import annotations

from enum import IntEnum


class Firmware(IntEnum):
    """MAV_AUTOPILOT values of the autopilots missions are written for."""

    ARDUPILOT = 3
    PX4 = 12

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of a stored mission is home (ArduPilot) or already flown to (PX4)."""
        return self is Firmware.ARDUPILOT

    @classmethod
    def named(cls, name: str) -> Firmware:
        """The autopilot a scenario names ("ardupilot", "px4")."""
        return cls[name.upper()]
