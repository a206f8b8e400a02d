"""Which commands each autopilot carries out in a mission, and how that is known.

Knows: names, whether a command names a place, what manuals list and what recorded vehicles answered. Does not know:
what commands do to a flight (`flown`).
Sources: Copter's "Mission Commands" page (commands supported by Copter), PX4's "Mission Mode (Multicopter)" page
(mission commands), and uploads to ArduCopter 4.5.6 and 4.7-dev and to PX4 1.17-dev, recorded frame by frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from gcs.autopilots.traits import Autopilot


class Source(StrEnum):
    """Why a command is held for carried out, or not."""

    MANUAL = "its manual lists it"
    RECORDED = "a recorded vehicle took it"
    ABSENT = "its manual does not list it"
    REFUSED = "a recorded vehicle refused it"
    IGNORED = "it is taken and never carried out"


_NO = frozenset({Source.ABSENT, Source.REFUSED, Source.IGNORED})


@dataclass(frozen=True)
class MissionCommand:
    """One MAV_CMD."""

    name: str
    has_place: bool
    ardupilot: Source
    px4: Source

    def source(self, firmware: Autopilot) -> Source:
        """How it stands with an autopilot."""
        return self.ardupilot if firmware is Autopilot.ARDUPILOT else self.px4


def refusal(command: int, firmware: Autopilot) -> str:
    """Why an autopilot does not carry out a command; empty if it does."""
    known = COMMANDS.get(command)
    if known is None:
        return f"{firmware.title} does not carry out command {command}: no manual lists it"
    source = known.source(firmware)
    return f"{firmware.title} does not carry out {known.name}: {source}" if source in _NO else ""


def name_of(command: int) -> str:
    """A command's name for people."""
    return COMMANDS[command].name if command in COMMANDS else f"command {command}"


_M, _R, _A, _X, _I = Source.MANUAL, Source.RECORDED, Source.ABSENT, Source.REFUSED, Source.IGNORED

COMMANDS: dict[int, MissionCommand] = {
    number: MissionCommand(*row)
    for number, row in {
        16: ("NAV_WAYPOINT", True, _R, _R),
        17: ("NAV_LOITER_UNLIM", True, _M, _M),
        18: ("NAV_LOITER_TURNS", True, _M, _A),
        19: ("NAV_LOITER_TIME", True, _M, _M),
        20: ("NAV_RETURN_TO_LAUNCH", False, _M, _M),
        21: ("NAV_LAND", True, _R, _R),
        22: ("NAV_TAKEOFF", True, _R, _R),
        30: ("NAV_CONTINUE_AND_CHANGE_ALT", True, _A, _A),
        31: ("NAV_LOITER_TO_ALT", True, _A, _M),
        80: ("NAV_ROI", True, _A, _M),
        82: ("NAV_SPLINE_WAYPOINT", True, _M, _X),
        84: ("NAV_VTOL_TAKEOFF", True, _A, _M),
        85: ("NAV_VTOL_LAND", True, _A, _A),
        92: ("NAV_GUIDED_ENABLE", False, _M, _A),
        93: ("NAV_DELAY", False, _R, _R),
        94: ("NAV_PAYLOAD_PLACE", True, _M, _A),
        112: ("CONDITION_DELAY", False, _M, _A),
        113: ("CONDITION_CHANGE_ALT", False, _A, _A),
        114: ("CONDITION_DISTANCE", False, _M, _A),
        115: ("CONDITION_YAW", False, _M, _X),
        176: ("DO_SET_MODE", False, _I, _A),
        177: ("DO_JUMP", False, _M, _M),
        178: ("DO_CHANGE_SPEED", False, _R, _R),
        179: ("DO_SET_HOME", True, _M, _M),
        181: ("DO_SET_RELAY", False, _M, _A),
        182: ("DO_REPEAT_RELAY", False, _M, _A),
        183: ("DO_SET_SERVO", False, _M, _M),
        184: ("DO_REPEAT_SERVO", False, _M, _A),
        189: ("DO_LAND_START", True, _A, _M),
        192: ("DO_REPOSITION", True, _A, _A),
        195: ("DO_SET_ROI_LOCATION", True, _A, _M),
        196: ("DO_SET_ROI_WPNEXT_OFFSET", False, _A, _M),
        197: ("DO_SET_ROI_NONE", False, _A, _M),
        200: ("DO_CONTROL_VIDEO", False, _A, _M),
        201: ("DO_SET_ROI", True, _M, _M),
        202: ("DO_DIGICAM_CONFIGURE", False, _M, _A),
        203: ("DO_DIGICAM_CONTROL", False, _M, _M),
        204: ("DO_MOUNT_CONFIGURE", False, _A, _M),
        205: ("DO_MOUNT_CONTROL", False, _M, _M),
        206: ("DO_SET_CAM_TRIGG_DIST", False, _M, _M),
        207: ("DO_FENCE_ENABLE", False, _M, _A),
        208: ("DO_PARACHUTE", False, _M, _A),
        211: ("DO_GRIPPER", False, _M, _A),
        212: ("DO_AUTOTUNE_ENABLE", False, _A, _M),
        214: ("DO_SET_CAM_TRIGG_INTERVAL", False, _A, _M),
        215: ("DO_SET_RESUME_REPEAT_DIST", False, _M, _A),
        218: ("DO_AUX_FUNCTION", False, _M, _A),
        222: ("DO_GUIDED_LIMITS", False, _M, _A),
        260: ("OBLIQUE_SURVEY", False, _A, _M),
        530: ("SET_CAMERA_MODE", False, _A, _M),
        531: ("SET_CAMERA_ZOOM", False, _A, _M),
        532: ("SET_CAMERA_FOCUS", False, _A, _M),
        600: ("JUMP_TAG", False, _M, _A),
        601: ("DO_JUMP_TAG", False, _M, _A),
        1000: ("DO_GIMBAL_MANAGER_PITCHYAW", False, _M, _M),
        1001: ("DO_GIMBAL_MANAGER_CONFIGURE", False, _A, _M),
        2000: ("IMAGE_START_CAPTURE", False, _A, _M),
        2001: ("IMAGE_STOP_CAPTURE", False, _A, _M),
        2003: ("DO_TRIGGER_CONTROL", False, _A, _M),
        2500: ("VIDEO_START_CAPTURE", False, _A, _M),
        2501: ("VIDEO_STOP_CAPTURE", False, _A, _M),
        42600: ("DO_WINCH", False, _M, _A),
        42702: ("NAV_SCRIPT_TIME", False, _M, _A),
        42703: ("NAV_ATTITUDE_TIME", False, _M, _A),
    }.items()
}
