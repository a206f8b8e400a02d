"""The parameters with which vehicles return as verified, and with which their fences reach above the returns.

ArduPilot's names are those up to 4.6, in cm and cm/s. Copter 4.7 renames them and counts in m and m/s (RTL_ALT_M,
RTL_SPEED_MS, ...): it converts stored values, but does not accept the old names any more.
"""

from __future__ import annotations

import math

from gcs.autopilots.traits import Autopilot
from gcs.mission.failsafe.rtl_altitudes import ReturnPlan

FENCE_ABOVE_M = 10.0  # above the highest return: ArduPilot returns no higher than FENCE_MARGIN (2 m) below its fence
_CM = 100
_ALTITUDE_AND_AREAS = 5  # FENCE_TYPE: the circle around home, on by default, ends 300 m away
_PX4_TAKEOFF_M = 2.5  # MIS_TAKEOFF_ALT: PX4 climbs to it before anything else
_PX4_DESCEND_M = 30.0  # RTL_DESCEND_ALT: below it PX4 lands slowly


def return_parameters(
    firmware: Autopilot, returns: ReturnPlan, row: int, home_m: float, takeoff_m: float
) -> tuple[tuple[str, int | float], ...]:
    """Names and values for the vehicle in this row: home `home_m` above the origin, hover `takeoff_m` above home.

    Heights count from its home. The fence's height is rounded up to whole metres.
    """
    altitude_m, speeds = returns.altitudes_m[row], returns.speeds
    fence_m = float(math.ceil(returns.top_m - home_m + FENCE_ABOVE_M))
    if firmware is Autopilot.ARDUPILOT:
        return (
            ("RTL_ALT", round(altitude_m * _CM)),
            ("RTL_ALT_FINAL", 0),
            ("RTL_CLIMB_MIN", 0),
            ("RTL_CONE_SLOPE", 0.0),
            ("RTL_SPEED", round(speeds.cruise_mps * _CM)),
            ("RTL_LOIT_TIME", round(speeds.wait_s * 1000)),
            ("WPNAV_SPEED_UP", float(round(speeds.climb_mps * _CM))),
            ("WPNAV_SPEED_DN", float(round(speeds.sink_mps * _CM))),
            ("FENCE_ENABLE", 1),
            ("FENCE_TYPE", _ALTITUDE_AND_AREAS),
            ("FENCE_ALT_MAX", fence_m),
        )
    return (
        ("RTL_TYPE", 0),
        ("RTL_RETURN_ALT", altitude_m),
        ("RTL_DESCEND_ALT", min(_PX4_DESCEND_M, altitude_m)),
        ("RTL_CONE_ANG", 0),
        ("RTL_LAND_DELAY", speeds.wait_s),
        ("MPC_XY_CRUISE", speeds.cruise_mps),
        ("MPC_Z_V_AUTO_UP", speeds.climb_mps),
        ("MPC_Z_V_AUTO_DN", speeds.sink_mps),
        ("MIS_TAKEOFF_ALT", min(_PX4_TAKEOFF_M, math.floor(takeoff_m * 10) / 10)),
        ("GF_MAX_VER_DIST", fence_m),
    )
