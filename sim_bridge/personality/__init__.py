"""One table per autopilot, with its modes, replies, texts, parameters and failsafes, as recorded.

It may import sim_bridge.missions, gcs.autopilots and gcs.mission.
"""

from sim_bridge.personality.ardupilot_behaviour import ARDUPILOT, ARDUPILOT_4_7
from sim_bridge.personality.modes import Boot, Intent, Milestone, Mode, Note
from sim_bridge.personality.px4_behaviour import PX4
from sim_bridge.personality.table import Personality, Setting

__all__ = ["ARDUPILOT", "PX4", "Boot", "Intent", "Milestone", "Mode", "Note", "Personality", "Setting", "by_name"]

_ALL = {personality.name: personality for personality in (ARDUPILOT, PX4, ARDUPILOT_4_7)}


def by_name(name: str) -> Personality:
    """Return the personality of a name on the command line: that of an autopilot in scenarios, or "ardupilot-4.7".

    Raises KeyError.
    """
    return _ALL[name]
