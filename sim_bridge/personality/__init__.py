"""Makes of autopilot, each one table: which mode has which number, what it refuses and how it says so.

Knows: the tables by name. Does not know: how they are used.
"""

from sim_bridge.personality.ardupilot import ARDUPILOT
from sim_bridge.personality.px4 import PX4
from sim_bridge.personality.table import (
    Arming,
    Flight,
    Identity,
    Intent,
    Missions,
    Mode,
    Modes,
    Param,
    Personality,
    Setting,
)

__all__ = [
    "ARDUPILOT",
    "PX4",
    "Arming",
    "Flight",
    "Identity",
    "Intent",
    "Missions",
    "Mode",
    "Modes",
    "Param",
    "Personality",
    "Setting",
    "by_name",
]

_ALL = {personality.name: personality for personality in (ARDUPILOT, PX4)}


def by_name(name: str) -> Personality:
    """The personality called `name`, as scenarios and the command line call it. Raises KeyError for another."""
    return _ALL[name]
