"""Mission commands: their names, whether an item of one names a position, and whether an autopilot executes it.

Which command an autopilot executes, and how that is known, stands in its row (`MissionSupport.commands`).
"""

import math
from enum import StrEnum

import numpy as np

from gcs.autopilots.columns import CommandSource
from gcs.autopilots.traits import Autopilot
from gcs.mavlink import FenceCommand, MavCommand

_NO = frozenset({CommandSource.ABSENT, CommandSource.REFUSED, CommandSource.IGNORED})
_NAV_WITHOUT_POSITION = frozenset({MavCommand.NAV_RETURN_TO_LAUNCH, MavCommand.NAV_GUIDED_ENABLE, MavCommand.NAV_DELAY})
_DO_WITH_POSITION = {
    MavCommand[name] for name in ["DO_SET_HOME", "DO_LAND_START", "DO_REPOSITION", "DO_SET_ROI_LOCATION", "DO_SET_ROI"]
}
_FENCE_AND_RALLY = range(FenceCommand.RETURN_POINT, FenceCommand.RALLY_POINT + 1)
_NO_ITEMS = """
    NAV_LAST DO_SET_MISSION_CURRENT MISSION_START COMPONENT_ARM_DISARM GET_HOME_POSITION GET_MESSAGE_INTERVAL
    SET_MESSAGE_INTERVAL REQUEST_MESSAGE REQUEST_AUTOPILOT_CAPABILITIES STORAGE_FORMAT
"""
_MISSION_COMMANDS = frozenset(MavCommand) - {MavCommand[name] for name in _NO_ITEMS.split()}


def command_source(command: int, firmware: Autopilot) -> CommandSource | None:
    """Return how it is known whether an autopilot executes a command; None for one that no manual lists."""
    listed = firmware.traits.missions.commands.get(command)
    return listed or (CommandSource.ABSENT if command in _MISSION_COMMANDS else None)


def refusal(command: int, firmware: Autopilot) -> str:
    """Return why an autopilot does not execute a command; empty if it does."""
    source = command_source(command, firmware)
    if source is None:
        return f"{firmware.title} does not execute command {command}: no manual lists it"
    return f"{firmware.title} does not execute {name_of(command)}: {source}" if source in _NO else ""


def name_of(command: int) -> str:
    """Return a command's name for messages, without MAV_CMD."""
    return MavCommand(command).name if command in _MISSION_COMMANDS else f"command {command}"


def has_position(command: int) -> bool:
    """Return whether an item of this command names a position; else its frame means nothing.

    A command up to NAV_LAST that is not known counts as one that does.
    """
    if command > MavCommand.NAV_LAST:
        return command in _FENCE_AND_RALLY or command in _DO_WITH_POSITION
    return command not in _NAV_WITHOUT_POSITION


def known_position(command: int) -> bool:
    """Return whether this is a known mission command that names a position."""
    return command in _MISSION_COMMANDS and has_position(command)


_AIR_OR_GROUND, _CLIMB_OR_SINK = (0.0, 1.0), (2.0, 3.0)  # kinds of speed in DO_CHANGE_SPEED
SPEED_KEPT, SPEED_OWN = -1.0, -2.0  # speeds in it that mean no change, and the autopilot's own
_KMH = 3.6  # of 1 m/s


class SpeedFault(StrEnum):
    """What is wrong with an item that changes the speed."""

    KIND = "kind"
    TOO_SLOW = "too slow"
    TOO_FAST = "too fast"
    NO_NUMBER = "no number"


def changes_course_speed(kind: float) -> bool:
    """Return whether DO_CHANGE_SPEED with this kind changes the speed along the course, not that of climbs."""
    return kind in _AIR_OR_GROUND


def speed_fault(kind: float, speed_mps: float, firmware: Autopilot | None) -> tuple[SpeedFault, str] | None:
    """Return what is wrong with DO_CHANGE_SPEED of this kind, and a sentence; None where it is flown as written."""
    if kind not in (*_AIR_OR_GROUND, *_CLIMB_OR_SINK):
        return SpeedFault.KIND, f"unknown speed type {kind:g}"
    if math.isnan(speed_mps):
        return SpeedFault.NO_NUMBER, "the speed is not a number"
    if speed_mps == SPEED_KEPT or kind in _CLIMB_OR_SINK:
        return None  # climbing and sinking have limits of their own
    if firmware is None:
        return (SpeedFault.TOO_SLOW, f"{speed_mps:g} m/s is no speed") if speed_mps <= 0.0 else None
    slowest, fastest = firmware.traits.missions.speed_mps
    if speed_mps < slowest - 1e-6:
        text = f"{firmware.title} ignores {speed_mps:g} m/s; its minimum is {slowest:g} m/s"
        return SpeedFault.TOO_SLOW, text
    if speed_mps <= fastest:
        return None
    text = f"{speed_mps:g} m/s; {firmware.title} allows at most {fastest:g} m/s"
    if speed_mps / _KMH <= fastest:
        text += f". Is it in km/h? {speed_mps:g} km/h are {speed_mps / _KMH:.1f} m/s"
    return SpeedFault.TOO_FAST, text


_MILLIMETRES = 3


def kept_alt_m(alt_m: float, firmware: Autopilot) -> float:
    """Return the altitude that the vehicle stores when `alt_m` is sent; infinite beyond single precision."""
    decimals = firmware.traits.missions.altitude_decimals
    with np.errstate(over="ignore"):
        single = np.float32(alt_m)
        if decimals is None:
            return float(single)
        steps_pm = 10.0**decimals
        return float(np.trunc(single * np.float32(steps_pm))) / steps_pm


def written_alt_m(alt_m: float, firmware: Autopilot) -> float:
    """Return the altitude to write, in whole millimetres, for which the vehicle stores the value nearest to `alt_m`."""
    decimals = firmware.traits.missions.altitude_decimals
    if decimals is None:
        return round(alt_m, _MILLIMETRES)
    whole = round(alt_m, decimals)
    if kept_alt_m(whole, firmware) == whole:
        return whole
    return round(whole + math.copysign(0.001, whole), _MILLIMETRES)  # 2.10 would be stored as 2.09
