"""ArduCopter 4.5.6, as recorded.

Knows: numbers and habits. Does not know: how they are used. It is ready after 4 s, not 40: what takes the real one
so long is its GNSS receiver's start, and no ground station learns anything from waiting for that.
"""

from __future__ import annotations

from gcs.link.dialect import Autopilot, Capability, CopterMode, ModeFlag
from gcs.link.mission import ARDUPILOT_TIMERS
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

_INT8, _INT16, _INT32, _REAL32 = 2, 4, 6, 9
_ON_STICKS = ModeFlag.CUSTOM | ModeFlag.STABILIZE | ModeFlag.MANUAL_INPUT
_BY_ITSELF = _ON_STICKS | ModeFlag.GUIDED

_MODES = Modes(
    known=(
        Mode(CopterMode.STABILIZE, "STABILIZE", Intent.MANUAL, _ON_STICKS),
        Mode(CopterMode.LOITER, "LOITER", Intent.HOLD, _BY_ITSELF),
        Mode(CopterMode.BRAKE, "BRAKE", Intent.HOLD, _ON_STICKS, armable=False),
        Mode(CopterMode.GUIDED, "GUIDED", Intent.GUIDED, _BY_ITSELF),
        Mode(CopterMode.AUTO, "AUTO", Intent.MISSION, _BY_ITSELF, armable=False),
        Mode(CopterMode.RTL, "RTL", Intent.RETURN, _BY_ITSELF, armable=False),
        Mode(CopterMode.LAND, "LAND", Intent.LAND, _ON_STICKS, armable=False),
    ),
    at_boot=CopterMode.STABILIZE,
)

_PARAMS = (
    Param("SYSID_THISMAV", 1.0, _INT16),
    Param("SYSID_MYGCS", 255.0, _INT16),
    Param("FRAME_CLASS", 1.0, _INT8),
    Param("FRAME_TYPE", 1.0, _INT8),
    Param("FS_GCS_ENABLE", 0.0, _INT8),
    Param("GUID_TIMEOUT", 3.0, _REAL32, 0.1, 5.0, Setting.STREAM_TIMEOUT_S),
    Param("LAND_SPEED", 50.0, _INT16, 30.0, 200.0, Setting.LAND_MPS, 0.01),
    Param("MIS_TOTAL", 0.0, _INT16),
    Param("RTL_ALT", 1500.0, _INT32, 30.0, 300_000.0, Setting.RETURN_HEIGHT_M, 0.01),
    Param("WPNAV_SPEED", 500.0, _REAL32, 20.0, 2000.0, Setting.CRUISE_MPS, 0.01),
    Param("WPNAV_SPEED_DN", 150.0, _REAL32, 10.0, 500.0, Setting.DESCEND_MPS, 0.01),
    Param("WPNAV_SPEED_UP", 250.0, _REAL32, 10.0, 1000.0, Setting.CLIMB_MPS, 0.01),
    Param("WP_YAW_BEHAVIOR", 0.0, _INT8),
)

ARDUPILOT = Personality(
    name="ardupilot",
    identity=Identity(
        autopilot=Autopilot.ARDUPILOT,
        version=(4 << 24) | (5 << 16) | (6 << 8) | 255,
        capabilities=Capability.MISSION_FLOAT
        | Capability.MISSION_INT
        | Capability.COMMAND_INT
        | Capability.SET_POSITION_TARGET_LOCAL_NED
        | Capability.MAVLINK2,
    ),
    modes=_MODES,
    arming=Arming(prearm_after_s=2.5, ready_after_s=4.0, idle_disarm_s=10.0),
    flight=Flight(landed_after_s=0.5),
    missions=Missions(
        capacity=650, timers=ARDUPILOT_TIMERS, int_requests=False, tells_file_frames=True, home_is_item_0=True
    ),
    params=_PARAMS,
)
