"""Parameters of PX4 1.17 and the traits of its parameter protocol, as recorded.

The original has some 900 of them, in alphabetical order.
"""

from __future__ import annotations

from gcs.mavlink import ParameterType as Kind
from sim_bridge.personality.table import LinkTraits, Param, ParamTraits, Setting

_INT32, _REAL32 = map(int, (Kind.INT32, Kind.REAL32))

PARAM_TRAITS = ParamTraits(
    sysid="MAV_SYS_ID",
    sends_index=True,
    bytes_in_float=True,
    takes_nan=True,
    capacity="BAT1_CAPACITY",
    hash_name="_HASH_CHECK",
)
LINK = LinkTraits(clock_step_ns=4_000_000, timesync_period_s=float("inf"))

PARAMS = (
    Param("ASPD_SCALE_1", 1.0, _REAL32),
    Param("ATT_EN", 0.0, _INT32),
    Param("BAT1_CAPACITY", -1.0, _REAL32),
    Param("BAT1_N_CELLS", 4.0, _INT32),
    Param("BAT1_R_INTERNAL", -1.0, _REAL32),
    Param("BAT1_SOURCE", 0.0, _INT32),
    Param("BAT1_V_CHARGED", 4.05, _REAL32),
    Param("BAT1_V_EMPTY", 3.6, _REAL32),
    Param("BAT_AVRG_CURRENT", 15.0, _REAL32),
    Param("BAT_CRIT_THR", 0.07, _REAL32, 0.05, 0.5, Setting.BATTERY_CRITICAL_SHARE),
    Param("BAT_EMERGEN_THR", 0.05, _REAL32, 0.03, 0.5, Setting.BATTERY_EMERGENCY_SHARE),
    Param("BAT_LOW_THR", 0.15, _REAL32, 0.12, 0.5, Setting.BATTERY_LOW_SHARE),
    Param("COM_DL_LOSS_T", 10.0, _INT32, 5.0, 300.0, Setting.LINK_TIMEOUT_S),
    Param("COM_LOW_BAT_ACT", 0.0, _INT32, 0.0, 3.0, Setting.BATTERY_CRITICAL_ACTION),
    Param("COM_OBL_RC_ACT", 0.0, _INT32, 0.0, 7.0, Setting.STREAM_LOSS_ACTION),
    Param("COM_OF_LOSS_T", 1.0, _REAL32, 0.0, 60.0, Setting.STREAM_TIMEOUT_S),
    Param("COM_RC_LOSS_T", 3.0, _REAL32),
    Param("GF_ACTION", 2.0, _INT32, 0.0, 5.0, Setting.FENCE_ACTION),
    Param("GF_MAX_HOR_DIST", 0.0, _REAL32, 0.0, 10_000.0, Setting.FENCE_RADIUS_M),
    Param("GF_MAX_VER_DIST", 0.0, _REAL32, 0.0, 10_000.0, Setting.FENCE_HEIGHT_M),
    Param("MAV_COMP_ID", 1.0, _INT32),
    Param("MAV_SYS_ID", 1.0, _INT32),
    Param("MAV_TYPE", 2.0, _INT32),
    Param("MIS_TAKEOFF_ALT", 2.5, _REAL32, 0.0, 80.0, Setting.TAKEOFF_HEIGHT_M),
    Param("MIS_YAW_ERR", 12.0, _REAL32),
    Param("MIS_YAW_TMT", -1.0, _REAL32),
    Param("MPC_ACC_DOWN_MAX", 3.0, _REAL32),
    Param("MPC_ACC_HOR", 3.0, _REAL32),
    Param("MPC_ACC_HOR_MAX", 5.0, _REAL32),
    Param("MPC_ACC_UP_MAX", 4.0, _REAL32),
    Param("MPC_JERK_AUTO", 4.0, _REAL32),
    Param("MPC_JERK_MAX", 8.0, _REAL32),
    Param("MPC_LAND_ALT1", 10.0, _REAL32, 0.0, 122.0, Setting.LAND_HIGH_M),
    Param("MPC_LAND_ALT2", 5.0, _REAL32, 0.0, 122.0, Setting.LAND_LOW_M),
    Param("MPC_LAND_CRWL", 0.3, _REAL32, 0.1, 1.0, Setting.CRAWL_MPS),
    Param("MPC_LAND_SPEED", 0.7, _REAL32, 0.6, 12.0, Setting.LAND_MPS),
    Param("MPC_TILTMAX_AIR", 45.0, _REAL32),
    Param("MPC_TKO_SPEED", 1.5, _REAL32, 1.0, 5.0, Setting.TAKEOFF_MPS),
    Param("MPC_XY_CRUISE", 5.0, _REAL32, 3.0, 20.0, Setting.CRUISE_MPS),
    Param("MPC_XY_TRAJ_P", 0.5, _REAL32),
    Param("MPC_XY_VEL_MAX", 12.0, _REAL32),
    Param("MPC_YAW_MODE", 0.0, _INT32),
    Param("MPC_Z_V_AUTO_DN", 1.5, _REAL32, 0.5, 4.0, Setting.DESCEND_MPS),
    Param("MPC_Z_V_AUTO_UP", 3.0, _REAL32, 0.5, 8.0, Setting.CLIMB_MPS),
    Param("NAV_ACC_RAD", 2.0, _REAL32, 0.05, 200.0, Setting.ARRIVE_M),
    Param("NAV_DLL_ACT", 0.0, _INT32, 0.0, 6.0, Setting.LINK_LOSS_ACTION),
    Param("NAV_MC_ALT_RAD", 0.8, _REAL32),
    Param("RTL_CONE_ANG", 45.0, _INT32),
    Param("RTL_DESCEND_ALT", 30.0, _REAL32),
    Param("RTL_LAND_DELAY", 0.0, _REAL32, -1.0, 300.0, Setting.RETURN_WAIT_S),
    Param("RTL_RETURN_ALT", 60.0, _REAL32, 0.0, 3000.0, Setting.RETURN_HEIGHT_M),
    Param("RTL_TYPE", 0.0, _INT32),
    Param("SYS_AUTOCONFIG", 0.0, _INT32),
    Param("SYS_AUTOSTART", 10_040.0, _INT32),
)
