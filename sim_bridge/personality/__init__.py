"""Personalities: one table per autopilot, with its modes, replies, texts, parameters and failsafes, as recorded."""

from sim_bridge.personality.ardupilot.behaviour import ARDUPILOT
from sim_bridge.personality.boot import Boot, Milestone, Stage
from sim_bridge.personality.failsafe_settings import Setting
from sim_bridge.personality.modes import Intent, Mode, Modes
from sim_bridge.personality.px4.behaviour import PX4
from sim_bridge.personality.table import Param, Personality
from sim_bridge.personality.wording import Note

__all__ = [
    "ARDUPILOT",
    "PX4",
    "Boot",
    "Intent",
    "Milestone",
    "Mode",
    "Modes",
    "Note",
    "Param",
    "Personality",
    "Setting",
    "Stage",
    "by_name",
]

_ALL = {personality.name: personality for personality in (ARDUPILOT, PX4)}


def by_name(name: str) -> Personality:
    """Return the personality of "ardupilot" or "px4", as scenarios and the command line name it. Raises KeyError."""
    return _ALL[name]
