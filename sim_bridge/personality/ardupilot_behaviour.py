"""Behaviour of ArduCopter 4.5.6, as recorded.

It is ready after 4 s, not 40: the real one waits for the slow start of its GNSS receiver, which is of no use to a
ground station.
"""

from dataclasses import replace

from gcs.autopilots.ardupilot import ARDUPILOT as ROW
from gcs.autopilots.traits import Autopilot
from gcs.mavlink import (
    Capability,
    CopterMode,
    EkfFlag,
    MavCommand,
    MavResult,
    MavState,
    MessageId,
    ModeFlag,
    ParameterType,
    Severity,
)
from sim_bridge.personality.ardupilot_missions import MISSIONS
from sim_bridge.personality.modes import Boot, Intent, Milestone, Mode, Modes, Note, Stage
from sim_bridge.personality.table import (
    COMMON_CAPABILITIES,
    BatteryFailsafe,
    FailsafeSettings,
    FlightTraits,
    HealthTraits,
    Param,
    ParamTraits,
    Personality,
    ReplyTraits,
    ReportTraits,
    Setting,
    StreamTraits,
)

_ON_STICKS = ModeFlag.CUSTOM | ModeFlag.STABILIZE | ModeFlag.MANUAL_INPUT
_BY_ITSELF = _ON_STICKS | ModeFlag.GUIDED

_MODES = Modes(
    known=(
        Mode(CopterMode.STABILIZE, "STABILIZE", Intent.MANUAL, _ON_STICKS, needs_position=False),
        Mode(CopterMode.ACRO, "ACRO", Intent.MANUAL, _ON_STICKS, needs_position=False),
        Mode(CopterMode.ALT_HOLD, "ALT_HOLD", Intent.MANUAL, _ON_STICKS, needs_position=False),
        Mode(CopterMode.LOITER, "LOITER", Intent.HOLD, _BY_ITSELF),
        Mode(CopterMode.POSHOLD, "POSHOLD", Intent.HOLD, _BY_ITSELF),
        Mode(CopterMode.BRAKE, "BRAKE", Intent.HOLD, _BY_ITSELF, armable=False),
        Mode(CopterMode.GUIDED, "GUIDED", Intent.GUIDED, _BY_ITSELF),
        Mode(CopterMode.AUTO, "AUTO", Intent.MISSION, _BY_ITSELF, armable=False),
        Mode(CopterMode.RTL, "RTL", Intent.RETURN, _BY_ITSELF, armable=False),
        Mode(CopterMode.SMART_RTL, "SMART_RTL", Intent.RETURN, _BY_ITSELF, armable=False),
        Mode(CopterMode.LAND, "LAND", Intent.LAND, _ON_STICKS, armable=False, needs_position=False),
    ),
    at_boot=CopterMode.STABILIZE,
)

_BOOT = Boot(
    stages=(
        Stage(
            0.0,
            frozenset({Milestone.SPEAKING}),
            faults=(
                "Gyros not healthy",
                "EKF attitude is bad",
                "Compass not healthy",
                "AHRS: EKF3 not started",
                "Battery 1 unhealthy",
            ),
        ),
        Stage(
            1.73,
            texts=("Barometer 1 calibration complete", "Barometer 2 calibration complete"),
            faults=(
                "Need Alt Estimate",
                "Accels inconsistent",
                "EKF attitude is bad",
                "Compass not healthy",
                "AHRS: waiting for home",
                "Battery 1 unhealthy",
            ),
        ),
        Stage(2.26, frozenset({Milestone.RUNNING}), ("ArduPilot Ready", "AHRS: DCM active")),
        Stage(
            4.26,
            texts=("EKF3 IMU0 initialised", "EKF3 IMU1 initialised", "AHRS: EKF3 active"),
            faults=("EKF attitude is bad", "AHRS: waiting for home"),
        ),
        Stage(
            5.61,
            texts=("EKF3 IMU0 tilt alignment complete", "EKF3 IMU1 tilt alignment complete"),
            faults=("AHRS: waiting for home",),
        ),
        Stage(
            5.71,
            texts=("EKF3 IMU0 MAG0 initial yaw alignment complete", "EKF3 IMU1 MAG0 initial yaw alignment complete"),
        ),
        Stage(9.6, frozenset({Milestone.FIXED}), ("GPS 1: detected as u-blox at 230400 baud",)),
        Stage(19.83, frozenset({Milestone.PLACED}), ("EKF3 IMU0 origin set", "Field Elevation Set: {alt_m:.0f}m")),
        Stage(20.02, texts=("EKF3 IMU1 origin set",)),
        Stage(23.4, frozenset({Milestone.CHECKED}), faults=()),
        Stage(
            41.43, frozenset({Milestone.LOCATED, Milestone.READY}), ("EKF3 IMU0 is using GPS", "EKF3 IMU1 is using GPS")
        ),
    ),
    starting=MavState.ACTIVE,
    restarts_mode=True,
    pace=0.1,
)

_WORDS = {
    Note.ARMED: (Severity.INFO, "Arming motors"),
    Note.ARMED_FOR_MISSION: (Severity.INFO, "Arming motors"),
    Note.DISARMED: (Severity.INFO, "Disarming motors"),
    Note.DISARMED_IDLE: (Severity.INFO, "Disarming motors"),
    Note.DISARMED_LANDED: (Severity.INFO, "Disarming motors"),
    Note.ARM_REFUSED: (Severity.CRITICAL, "Arm: {reason}"),
    **dict.fromkeys((Note.CHECKS_FAIL, Note.SENSOR_FAILS), (Severity.CRITICAL, "PreArm: {reason}")),
    Note.MODE_UNKNOWN: (Severity.WARNING, "No such mode {mode}"),
    Note.MODE_REFUSED: (Severity.WARNING, "Mode change to {mode} failed: init failed"),
    Note.MISSION_REFUSED: (Severity.CRITICAL, "Auto: Missing Takeoff Cmd"),
    Note.STREAM_UNKNOWN: (Severity.INFO, "No ap_message for mavlink id ({number})"),
    Note.ITEM_BEGINS: (Severity.INFO, "Mission: {seq} {name}"),
    Note.DELAY_BEGINS: (Severity.INFO, "Delaying {seconds:.0f} sec"),
    Note.WAYPOINT_REACHED: (Severity.INFO, "Reached command #{seq}"),
    Note.LINK_LOST: (Severity.WARNING, "GCS Failsafe - {action}"),
    Note.LINK_FOUND: (Severity.WARNING, "GCS Failsafe Cleared"),
    Note.BATTERY_LOW: (Severity.WARNING, "Battery 1 is low {volt:.2f}V used {mAh:.0f} mAh"),
    Note.BATTERY_CRITICAL: (Severity.CRITICAL, "Battery 1 is critical {volt:.2f}V used {mAh:.0f} mAh"),
    Note.PLACE_LOST: (Severity.CRITICAL, "EKF Failsafe: changed to {action} Mode"),
    Note.FENCE_BREACHED: (Severity.WARNING, "{fence} fence breached"),
}

_BATTERY_ACTIONS = {1: Intent.LAND, 2: Intent.RETURN, 3: Intent.RETURN, 4: Intent.LAND, 6: Intent.LAND}
_FAILSAFES = FailsafeSettings(
    link=dict.fromkeys((1, 2, 3, 6), Intent.RETURN) | {4: Intent.LAND, 5: Intent.LAND, 7: Intent.HOLD},
    link_only_ours=True,
    battery=(
        BatteryFailsafe(
            Note.BATTERY_LOW,
            _BATTERY_ACTIONS,
            Setting.BATTERY_LOW_ACTION,
            Setting.BATTERY_LOW_V,
            Setting.BATTERY_LOW_Ah,
        ),
        BatteryFailsafe(
            Note.BATTERY_CRITICAL,
            _BATTERY_ACTIONS,
            Setting.BATTERY_CRITICAL_ACTION,
            Setting.BATTERY_CRITICAL_V,
            Setting.BATTERY_CRITICAL_Ah,
        ),
    ),
    battery_timeout_s=10.0,
    fence={1: Intent.RETURN, 2: Intent.LAND, 3: Intent.RETURN, 4: Intent.HOLD, 5: Intent.LAND},
    estimate={1: Intent.LAND, 2: Intent.HOLD, 3: Intent.LAND},
    low_is_critical=True,
)

_STREAMS = StreamTraits(
    unasked_hz={MessageId.HEARTBEAT: 1.0},
    unsent=frozenset({MessageId.ATTITUDE_TARGET, MessageId.ALTITUDE, MessageId.ESTIMATOR_STATUS}),
    groups={
        2: frozenset(
            {
                MessageId.SYS_STATUS,
                MessageId.MISSION_CURRENT,
                MessageId.GPS_RAW_INT,
                MessageId.FENCE_STATUS,
                MessageId.NAV_CONTROLLER_OUTPUT,
                MessageId.POSITION_TARGET_GLOBAL_INT,
            }
        ),
        3: frozenset({MessageId.SERVO_OUTPUT_RAW}),
        6: frozenset({MessageId.GLOBAL_POSITION_INT, MessageId.LOCAL_POSITION_NED}),
        10: frozenset({MessageId.ATTITUDE}),
        11: frozenset({MessageId.VFR_HUD}),
        12: frozenset({MessageId.SYSTEM_TIME, MessageId.BATTERY_STATUS, MessageId.EKF_STATUS_REPORT}),
    },
    fast_share=0.87,
    local_from=Milestone.LOCATED,
    global_from=Milestone.RUNNING,
    targets_in_guided_only=True,
    reports_rtk=True,
    reports_airspeed=True,
)

_BEFORE_READY = (
    EkfFlag.ATTITUDE | EkfFlag.VELOCITY_HORIZ | EkfFlag.VELOCITY_VERT | EkfFlag.POS_VERT_ABS | EkfFlag.CONST_POS_MODE
)

# The original has 1390 parameters. Here are those that act, those that ground stations read, and the first of its list.
_INT8, _INT16, _INT32, _REAL32 = map(
    int, (ParameterType.INT8, ParameterType.INT16, ParameterType.INT32, ParameterType.REAL32)
)

_PARAM_TRAITS = ParamTraits(
    sysid="SYSID_THISMAV",
    any_case=True,
    converts=True,
    capacity="BATT_CAPACITY",
    banner=("ArduCopter V4.5.6", "Frame: QUAD/X"),
)

_PARAMS = (
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
    Param("ATC_INPUT_TC", 0.15, _REAL32),
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
    Param("WPNAV_ACCEL_C", 0.0, _REAL32),
    Param("WPNAV_ACCEL_Z", 100.0, _REAL32),
    Param("WPNAV_JERK", 1.0, _REAL32),
    Param("WPNAV_RADIUS", 200.0, _REAL32),
    Param("WPNAV_SPEED", 500.0, _REAL32, 20.0, 2000.0, Setting.CRUISE_MPS, 0.01),
    Param("WPNAV_SPEED_DN", 150.0, _REAL32, 10.0, 500.0, Setting.DESCEND_MPS, 0.01),
    Param("WPNAV_SPEED_UP", 250.0, _REAL32, 10.0, 1000.0, Setting.CLIMB_MPS, 0.01),
)

ARDUPILOT = Personality(
    autopilot=Autopilot.ARDUPILOT,
    version=(4 << 24) | (5 << 16) | (6 << 8) | 255,
    capabilities=COMMON_CAPABILITIES | Capability.FTP,
    vtol_state=3,
    boot=_BOOT,
    modes=_MODES,
    flight=FlightTraits(
        spool_up_s=2.9,
        has_sticks=True,
        brakes_mps2=1.0,
        landed_after_s=1.75,
        disarm_after_s=0.3,
        takeoff_in_guided=True,
        reposition_in=Intent.GUIDED,
        stream_comes_back=True,
    ),
    reports=ReportTraits(
        starts_over=True,
        item_names={
            MavCommand.NAV_WAYPOINT: "WP",
            MavCommand.NAV_RETURN_TO_LAUNCH: "RTL",
            MavCommand.NAV_LAND: "Land",
            MavCommand.NAV_TAKEOFF: "Takeoff",
            MavCommand.NAV_DELAY: "Delay",
            MavCommand.DO_CHANGE_SPEED: "ChangeSpeed",
        },
    ),
    replies=ReplyTraits(
        refused=MavResult.FAILED,
        unknown_mode=MavResult.FAILED,
        unknown_stream=MavResult.DENIED,
        unknown_message=MavResult.FAILED,
        nothing_newer=MavResult.ACCEPTED,
        formats=True,
        mode_acks=1,
        set_mode_command=11,  # the message number of SET_MODE
        heartbeat_on_change=True,
        announces_home=True,
        any_component=True,
        waits_for_contact=True,
        clock_step_ns=1_000,
        timesync_period_s=10.0,
        signs=True,
    ),
    streams=_STREAMS,
    health=HealthTraits(
        present=0x5371FC2F, enabled=0x5361FC2F, healthy=0x4771FC2F, before_ready=_BEFORE_READY, ready=0x33F
    ),
    failsafes=_FAILSAFES,
    words=_WORDS,
    missions=MISSIONS,
    params=_PARAMS,
    param_traits=_PARAM_TRAITS,
)
_VERSION = (4 << 24) | (7 << 16) | (0 << 8) | 255
_NAMES = {} if ROW.link.renaming is None else {row.old: row for row in ROW.link.renaming.names}


# ArduCopter 4.7: the recorded 4.5.6 with the parameter names and units of 4.7, and its version.


def _renamed(param: Param) -> Param:
    row = _NAMES.get(param.name)
    if row is None:
        return param
    if row.per_new == 1.0:
        return param._replace(name=row.new)
    return Param(
        row.new,
        param.value / row.per_new,
        int(ParameterType.REAL32),
        param.low / row.per_new,
        param.high / row.per_new,
        param.sets,
        param.unit * row.per_new,
    )


def _newer(older: Personality) -> Personality:
    traits = older.param_traits
    own = _NAMES[traits.sysid].new if traits.sysid in _NAMES else traits.sysid
    banner = tuple(line.replace("V4.5.6", "V4.7.0") for line in traits.banner)
    return replace(
        older,
        edition="-4.7",
        version=_VERSION,
        params=tuple(_renamed(param) for param in older.params),
        param_traits=replace(traits, sysid=own, banner=banner),
        missions=replace(older.missions, file_leftovers=False),
    )


ARDUPILOT_4_7 = _newer(ARDUPILOT)
