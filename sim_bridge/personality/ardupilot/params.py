"""Parameters of ArduCopter 4.5.6 and the traits of its parameter protocol, as recorded.

The original has 1390 of them. Here are those that act, those that ground stations read, and the first of its list.
"""

from __future__ import annotations

from gcs.mavlink import ParameterType as Kind
from sim_bridge.personality.table import LinkTraits, Param, ParamTraits, Setting

_INT8, _INT16, _INT32, _REAL32 = map(int, (Kind.INT8, Kind.INT16, Kind.INT32, Kind.REAL32))

PARAM_TRAITS = ParamTraits(
    sysid="SYSID_THISMAV",
    any_case=True,
    converts=True,
    capacity="BATT_CAPACITY",
    banner=("ArduCopter V4.5.6", "Frame: QUAD/X"),
)
LINK = LinkTraits(clock_step_ns=1_000, timesync_period_s=10.0, signs=True)

PARAMS = (
    Param("FORMAT_VERSION", 120.0, _INT16),
    Param("SYSID_THISMAV", 1.0, _INT16),
    Param("SYSID_MYGCS", 255.0, _INT16, 1.0, 255.0, Setting.GROUND_STATION),
    Param("PILOT_THR_FILT", 0.0, _REAL32),
    Param("PILOT_TKOFF_ALT", 0.0, _REAL32),
    Param("PILOT_THR_BHV", 0.0, _INT16),
    Param("SERIAL0_BAUD", 115.0, _INT32),
    Param("SERIAL0_PROTOCOL", 2.0, _INT8),
    Param("TELEM_DELAY", 0.0, _INT8),
    Param("RTL_ALT", 1500.0, _INT32, 30.0, 300_000.0, Setting.RETURN_HEIGHT_M, 0.01),
    Param("RTL_CONE_SLOPE", 3.0, _REAL32),
    Param("RTL_SPEED", 0.0, _INT16),
    Param("RTL_ALT_FINAL", 0.0, _INT16),
    Param("RTL_CLIMB_MIN", 0.0, _INT16),
    Param("RTL_LOIT_TIME", 5000.0, _INT32, 0.0, 60_000.0, Setting.RETURN_WAIT_S, 0.001),
    Param("RTL_ALT_TYPE", 0.0, _INT8),
    Param("FS_GCS_ENABLE", 0.0, _INT8, 0.0, 7.0, Setting.LINK_LOSS_ACTION),
    Param("GPS_HDOP_GOOD", 140.0, _INT16),
    Param("WP_YAW_BEHAVIOR", 0.0, _INT8),
    Param("LAND_SPEED", 50.0, _INT16, 30.0, 200.0, Setting.LAND_MPS, 0.01),
    Param("LAND_ALT_LOW", 1000.0, _INT16, 100.0, 10_000.0, Setting.LAND_LOW_M, 0.01),
    Param("LAND_SPEED_HIGH", 0.0, _INT16),
    Param("PILOT_SPEED_UP", 250.0, _INT16),
    Param("PILOT_ACCEL_Z", 250.0, _INT16),
    Param("FS_THR_ENABLE", 1.0, _INT8),
    Param("ANGLE_MAX", 3000.0, _INT16),
    Param("AUTO_OPTIONS", 0.0, _INT32, 0.0, 255.0, Setting.AUTO_OPTIONS),
    Param("BATT_CAPACITY", 3300.0, _INT32),
    Param("BATT_CRT_MAH", 0.0, _REAL32, 0.0, 1e6, Setting.BATTERY_CRITICAL_Ah, 0.001),
    Param("BATT_CRT_VOLT", 0.0, _REAL32, 0.0, 120.0, Setting.BATTERY_CRITICAL_V),
    Param("BATT_FS_CRT_ACT", 0.0, _INT8, 0.0, 7.0, Setting.BATTERY_CRITICAL_ACTION),
    Param("BATT_FS_LOW_ACT", 0.0, _INT8, 0.0, 7.0, Setting.BATTERY_LOW_ACTION),
    Param("BATT_LOW_MAH", 0.0, _REAL32, 0.0, 1e6, Setting.BATTERY_LOW_Ah, 0.001),
    Param("BATT_LOW_VOLT", 10.5, _REAL32, 0.0, 120.0, Setting.BATTERY_LOW_V),
    Param("FENCE_ACTION", 1.0, _INT8, 0.0, 8.0, Setting.FENCE_ACTION),
    Param("FENCE_ALT_MAX", 100.0, _REAL32, 10.0, 1000.0, Setting.FENCE_HEIGHT_M),
    Param("FENCE_ENABLE", 0.0, _INT8, 0.0, 1.0, Setting.FENCE_ENABLED),
    Param("FENCE_RADIUS", 300.0, _REAL32, 30.0, 10_000.0, Setting.FENCE_RADIUS_M),
    Param("FENCE_TOTAL", 0.0, _INT8),
    Param("FENCE_TYPE", 7.0, _INT8, 0.0, 15.0, Setting.FENCE_KINDS),
    Param("FRAME_CLASS", 1.0, _INT8),
    Param("FRAME_TYPE", 1.0, _INT8),
    Param("FS_EKF_ACTION", 1.0, _INT8, 1.0, 3.0, Setting.ESTIMATE_ACTION),
    Param("FS_GCS_TIMEOUT", 5.0, _REAL32, 2.0, 120.0, Setting.LINK_TIMEOUT_S),
    Param("FS_OPTIONS", 16.0, _INT32),
    Param("GUID_TIMEOUT", 3.0, _REAL32, 0.1, 5.0, Setting.STREAM_TIMEOUT_S),
    Param("MIS_TOTAL", 0.0, _INT16),
    Param("RALLY_TOTAL", 0.0, _INT8),
    Param("WPNAV_ACCEL", 250.0, _REAL32),
    Param("WPNAV_ACCEL_Z", 100.0, _REAL32),
    Param("WPNAV_JERK", 1.0, _REAL32),
    Param("WPNAV_RADIUS", 200.0, _REAL32),
    Param("WPNAV_SPEED", 500.0, _REAL32, 20.0, 2000.0, Setting.CRUISE_MPS, 0.01),
    Param("WPNAV_SPEED_DN", 150.0, _REAL32, 10.0, 500.0, Setting.DESCEND_MPS, 0.01),
    Param("WPNAV_SPEED_UP", 250.0, _REAL32, 10.0, 1000.0, Setting.CLIMB_MPS, 0.01),
)
