"""What differs between the autopilots in flight: one row of modes, readiness and habits for each.

Knows: their numbers, with the reason where one surprises. Does not know: sending, waiting, plans. What differs in
missions stands in `gcs.autopilots.traits`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from gcs.mavlink import (
    GENERIC_AUTOPILOT,
    PX4_HOLD,
    PX4_LAND,
    PX4_MISSION,
    PX4_OFFBOARD,
    PX4_RTL,
    CopterMode,
    EkfFlag,
    MessageId,
    ModeFlag,
)


@dataclass(frozen=True)
class FlightBehaviour:
    """How one autopilot wants to be flown. Modes are values of HEARTBEAT.custom_mode."""

    firmware: Autopilot
    guided: int  # obeys setpoints
    mission: int
    hold: int
    land: int
    returning: int
    armed_in: int  # the mode it is armed and takes off in
    two_part_modes: bool  # DO_SET_MODE takes main and sub mode apart
    takeoff_above_sea: bool  # NAV_TAKEOFF's height
    stream_first_s: float  # setpoints must have come for so long before the guided mode, and must not end in it
    lag_s: float  # how late it flies setpoints that come in time
    waits_for_time_of_day: bool  # NAV_DELAY until an hour, minute and second
    estimator: tuple[str, int, int]  # message that tells readiness, flags it must have, flags it must not have
    estimator_id: int
    health_ids: tuple[int, ...]  # messages that tell of trouble in flight
    mode_names: dict[int, str]

    def mode_parameters(self, mode: int) -> tuple[float, ...]:
        """Parameters of DO_SET_MODE."""
        if self.two_part_modes:
            return float(ModeFlag.CUSTOM), float(mode >> 16 & 0xFF), float(mode >> 24 & 0xFF)
        return float(ModeFlag.CUSTOM), float(mode)

    def mode_name(self, mode: int) -> str:
        """A mode in the autopilot's own words."""
        return self.mode_names.get(mode, f"mode {mode}")

    def position_is_known(self, name: str, fields: Mapping[str, Any]) -> bool:
        """Whether this message says that the vehicle knows where it is, well enough to fly by."""
        source, wanted, unwanted = self.estimator
        if name != source:
            return False
        flags = fields["flags"]
        return flags & wanted == wanted and not flags & unwanted

    def takeoff_parameters(self, height_m: float, home_amsl_m: float) -> tuple[float, ...]:
        """Parameters of NAV_TAKEOFF for a climb of `height_m`, straight up."""
        top_m = home_amsl_m + height_m if self.takeoff_above_sea else height_m
        place = math.nan if self.takeoff_above_sea else 0.0
        return 0.0, 0.0, 0.0, math.nan, place, place, top_m


ARDUPILOT = FlightBehaviour(
    firmware=Autopilot.ARDUPILOT,
    guided=CopterMode.GUIDED,
    mission=CopterMode.AUTO,
    hold=CopterMode.LOITER,
    land=CopterMode.LAND,
    returning=CopterMode.RTL,
    armed_in=CopterMode.GUIDED,
    two_part_modes=False,
    takeoff_above_sea=False,
    stream_first_s=0.0,
    lag_s=0.0,  # a stream 0.1 s ahead put it 0.43 m ahead
    waits_for_time_of_day=True,
    # The PREARM bit of SYS_STATUS turns true before GUIDED can be armed.
    estimator=("EKF_STATUS_REPORT", EkfFlag.POS_HORIZ_ABS, EkfFlag.CONST_POS_MODE),
    estimator_id=MessageId.EKF_STATUS_REPORT,
    health_ids=(MessageId.SYS_STATUS, MessageId.GPS_RAW_INT, MessageId.FENCE_STATUS),
    mode_names={int(mode): mode.name for mode in CopterMode},
)

PX4 = FlightBehaviour(
    firmware=Autopilot.PX4,
    guided=PX4_OFFBOARD,
    mission=PX4_MISSION,
    hold=PX4_HOLD,
    land=PX4_LAND,
    returning=PX4_RTL,
    armed_in=PX4_HOLD,
    two_part_modes=True,
    takeoff_above_sea=True,
    stream_first_s=1.5,
    lag_s=0.1,  # what is left of 0.13 s at 20 Hz without half a period of waiting for the next setpoint
    waits_for_time_of_day=False,
    # It shows all ten flags once it is ready, CONST_POS_MODE among them.
    estimator=("ESTIMATOR_STATUS", EkfFlag.POS_HORIZ_ABS | EkfFlag.PRED_POS_HORIZ_ABS, 0),
    estimator_id=MessageId.ESTIMATOR_STATUS,
    health_ids=(MessageId.SYS_STATUS, MessageId.GPS_RAW_INT),
    mode_names={
        PX4_OFFBOARD: "Offboard",
        PX4_MISSION: "Mission",
        PX4_HOLD: "Hold",
        PX4_LAND: "Land",
        PX4_RTL: "Return",
    },
)

_BY_FIRMWARE = {Autopilot.ARDUPILOT: ARDUPILOT, Autopilot.PX4: PX4}


def flight_behaviour(sysid: int, autopilot: int) -> FlightBehaviour:
    """The behaviour of MAV_AUTOPILOT `autopilot`; raises PeerError for one that nobody here knows how to fly."""
    try:
        return _BY_FIRMWARE[Autopilot(autopilot)]
    except ValueError:
        raise PeerError(
            f"vehicle {sysid} runs autopilot number {autopilot}; only ArduCopter and PX4 can be flown.",
            hint="export the missions with `gcs export` and fly them with its own ground station",
        ) from None


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
