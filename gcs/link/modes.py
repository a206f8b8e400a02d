"""What people call a flight mode.

Knows: ArduCopter's and PX4's numbers and names. Does not know: how to change modes.
"""

from __future__ import annotations

from gcs.autopilot import Autopilot
from gcs.link.dialect import GENERIC_AUTOPILOT

_COPTER = {
    **dict(enumerate(("STABILIZE", "ACRO", "ALT_HOLD", "AUTO", "GUIDED", "LOITER", "RTL", "CIRCLE"))),
    **{9: "LAND", 11: "DRIFT", 13: "SPORT", 14: "FLIP", 15: "AUTOTUNE", 16: "POSHOLD", 17: "BRAKE", 18: "THROW"},
    **{19: "AVOID_ADSB", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 22: "FLOWHOLD", 23: "FOLLOW", 24: "ZIGZAG"},
    **{25: "SYSTEMID", 26: "AUTOROTATE", 27: "AUTO_RTL", 28: "TURTLE"},
}
_PX4_MAIN = {
    **{1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED", 8: "RATTITUDE"},
    **{9: "SIMPLE", 10: "TERMINATION", 11: "ALTITUDE_CRUISE"},
}
_PX4_AUTO = {
    **{1: "READY", 2: "TAKEOFF", 3: "HOLD", 4: "MISSION", 5: "RTL", 6: "LAND", 8: "FOLLOW_TARGET", 9: "PRECLAND"},
    **{10: "VTOL_TAKEOFF"},
}
_AUTO = 4
_AUTOPILOTS = {GENERIC_AUTOPILOT: "generic"} | {int(known): known.title for known in Autopilot}


def autopilot_name(autopilot: int) -> str:
    """MAV_AUTOPILOT in words."""
    return _AUTOPILOTS.get(autopilot, f"autopilot {autopilot}")


def mode_name(autopilot: int, custom_mode: int) -> str:
    """HEARTBEAT.custom_mode in words; what is not known keeps its number."""
    if autopilot == Autopilot.ARDUPILOT:
        return _COPTER.get(custom_mode, f"mode {custom_mode}")
    if autopilot == Autopilot.PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        if main == _AUTO and sub in _PX4_AUTO:
            return _PX4_AUTO[sub]
        return _PX4_MAIN.get(main, f"mode {main}.{sub}")
    return f"mode {custom_mode}"
