"""PX4 1.17, as recorded.

Knows: numbers and habits. Does not know: how they are used.
"""

from __future__ import annotations

from gcs.link.dialect import (
    PX4_HOLD,
    PX4_LAND,
    PX4_MISSION,
    PX4_OFFBOARD,
    PX4_RTL,
    Autopilot,
    Capability,
    ModeFlag,
    px4_mode,
)
from gcs.link.mission import Timers
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

_INT32, _REAL32 = 6, 9
_BY_ITSELF = ModeFlag.CUSTOM | ModeFlag.AUTO | ModeFlag.GUIDED | ModeFlag.STABILIZE
_ON_STICKS = ModeFlag.CUSTOM | ModeFlag.STABILIZE | ModeFlag.MANUAL_INPUT

_MODES = Modes(
    known=(
        Mode(PX4_HOLD, "Hold", Intent.HOLD, _BY_ITSELF),
        Mode(PX4_MISSION, "Mission", Intent.MISSION, _BY_ITSELF),
        Mode(PX4_OFFBOARD, "Offboard", Intent.GUIDED, ModeFlag.CUSTOM),
        Mode(px4_mode(4, 2), "Takeoff", Intent.TAKEOFF, _BY_ITSELF),
        Mode(PX4_RTL, "Return", Intent.RETURN, _BY_ITSELF, armable=False),
        Mode(PX4_LAND, "Land", Intent.LAND, _BY_ITSELF, armable=False),
        Mode(px4_mode(3), "Position", Intent.MANUAL, _ON_STICKS, armable=False),
    ),
    at_boot=PX4_HOLD,
)

_PARAMS = (
    Param("MAV_SYS_ID", 1.0, _INT32),
    Param("COM_OF_LOSS_T", 1.0, _REAL32, 0.0, 60.0, Setting.STREAM_TIMEOUT_S),
    Param("MPC_LAND_SPEED", 0.7, _REAL32, 0.6, 12.0, Setting.LAND_MPS),
    Param("MPC_XY_CRUISE", 5.0, _REAL32, 3.0, 20.0, Setting.CRUISE_MPS),
    Param("MPC_Z_V_AUTO_DN", 1.5, _REAL32, 0.5, 4.0, Setting.DESCEND_MPS),
    Param("MPC_Z_V_AUTO_UP", 3.0, _REAL32, 0.5, 8.0, Setting.CLIMB_MPS),
    Param("RTL_RETURN_ALT", 60.0, _REAL32, 0.0, 3000.0, Setting.RETURN_HEIGHT_M),
)

PX4 = Personality(
    name="px4",
    identity=Identity(
        autopilot=Autopilot.PX4,
        version=(1 << 24) | (17 << 16) | (0 << 8) | 64,
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
        capacity=10_000,
        timers=Timers(reply_s=0.25, item_s=0.25, retries=20, give_up_s=5.0),
        int_requests=True,
        tells_file_frames=False,
        home_is_item_0=False,
    ),
    params=_PARAMS,
)
