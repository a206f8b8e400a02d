"""The PX4 1.17 row of the emulator: modes, texts, arming and streams, taken from recordings.

Texts that are also sent as an event end in a tab.
"""

from gcs.autopilots.traits import Autopilot
from gcs.mavlink import (
    PX4_HOLD,
    PX4_LAND,
    PX4_MISSION,
    PX4_OFFBOARD,
    PX4_RTL,
    Capability,
    MavCommand,
    MavResult,
    MavState,
    MessageId,
    ModeFlag,
    ParameterType,
    Severity,
    px4_mode,
)
from sim_bridge.personality.modes import Boot, Intent, Milestone, Mode, Modes, Note, Stage
from sim_bridge.personality.px4_missions import MISSIONS
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
        Mode(px4_mode(3), "Position", Intent.MANUAL, _ON_STICKS),
        Mode(px4_mode(1), "Manual", Intent.MANUAL, _ON_STICKS, needs_position=False),
        Mode(px4_mode(2), "Altitude", Intent.MANUAL, _ON_STICKS, needs_position=False),
        Mode(px4_mode(7), "Stabilized", Intent.MANUAL, _ON_STICKS, needs_position=False),
    ),
    at_boot=PX4_HOLD,
    two_part=True,
    returns_after_disarming=True,
    streamed=ModeFlag.STABILIZE,
    act_on_ground=True,
)

_BOOT = Boot(
    stages=(
        Stage(0.0, frozenset({Milestone.RUNNING}), faults=("health",)),
        Stage(0.1, frozenset({Milestone.FIXED})),
        Stage(0.9, frozenset({Milestone.PLACED})),
        Stage(2.4, frozenset({Milestone.SPEAKING})),
        Stage(2.5, frozenset({Milestone.LOCATED})),
        Stage(3.99, frozenset({Milestone.CHECKED, Milestone.READY}), faults=()),
    ),
    starting=MavState.UNINIT,
    restarts_mode=False,
)

_WORDS = {
    Note.ARMED: (Severity.INFO, "Armed by external command\t"),
    Note.ARMED_FOR_MISSION: (Severity.INFO, "Armed by mission start\t"),
    Note.DISARMED: (Severity.INFO, "Disarmed by external command\t"),
    Note.DISARMED_IDLE: (Severity.INFO, "Disarmed by auto preflight disarming\t"),
    Note.DISARMED_LANDED: (Severity.INFO, "Disarmed by landing\t"),
    Note.ARM_REFUSED: (Severity.CRITICAL, "Arming denied: Resolve system health failures first\t"),
    Note.SENSOR_FAILS: (Severity.CRITICAL, "Preflight Fail: Accel 0 uncalibrated"),
    Note.DISARM_REFUSED: (Severity.CRITICAL, "Disarming denied: not landed\t"),
    Note.MODE_REFUSED: (Severity.CRITICAL, "Switching to mode '{mode}' is currently not possible\t"),
    Note.LIFTED_OFF: (Severity.INFO, "Takeoff detected\t"),
    Note.LANDED: (Severity.INFO, "Landing detected\t"),
    Note.MISSION_BEGINS: (Severity.INFO, "Executing Mission\t"),
    Note.MISSION_CLIMBS: (Severity.INFO, "Climb to {height_m:.1f} meters above home\t"),
    Note.MISSION_ENDS: (Severity.INFO, "Mission finished, landed\t"),
    Note.RETURN_BEGINS: (Severity.INFO, "RTL: start return at {alt_m:.0f} m ({height_m:.0f} m above destination)\t"),
    Note.RETURN_LANDS: (Severity.INFO, "RTL: land at destination\t"),
    Note.FAILSAFE: (Severity.CRITICAL, "Failsafe activated\t"),
    Note.LINK_LOST: (Severity.INFO, "Connection to ground station lost\t"),
    Note.LINK_FOUND: (Severity.INFO, "Connection to ground station regained\t"),
    Note.BATTERY_LOW: (Severity.WARNING, "Low battery level\t"),
    Note.BATTERY_CRITICAL: (Severity.CRITICAL, "Critical battery level\t"),
    Note.BATTERY_EMERGENCY: (Severity.EMERGENCY, "Emergency battery level\t"),
    Note.FENCE_BREACHED: (Severity.CRITICAL, "Geofence: approaching or outside geofence"),
}

_FAILSAFES = FailsafeSettings(
    link={1: Intent.HOLD, 2: Intent.RETURN, 3: Intent.LAND},
    battery=(
        BatteryFailsafe(Note.BATTERY_LOW, {}, share=Setting.BATTERY_LOW_SHARE),
        BatteryFailsafe(
            Note.BATTERY_CRITICAL,
            {2: Intent.LAND, 3: Intent.RETURN},
            Setting.BATTERY_CRITICAL_ACTION,
            share=Setting.BATTERY_CRITICAL_SHARE,
        ),
        BatteryFailsafe(
            Note.BATTERY_EMERGENCY,
            {2: Intent.LAND, 3: Intent.LAND},
            Setting.BATTERY_CRITICAL_ACTION,
            share=Setting.BATTERY_EMERGENCY_SHARE,
        ),
    ),
    fence={2: Intent.HOLD, 3: Intent.RETURN, 5: Intent.LAND},
    one_area_suffices=True,
    fence_off=0,
    fence_repeats_s=2.1,
    estimate=Intent.LAND,
    stream=dict.fromkeys((0, 1, 2), Intent.MANUAL) | {3: Intent.RETURN, 4: Intent.LAND, 5: Intent.HOLD},
)

# Recorded at 50 Hz, over a link without rate limit. Over a radio the original also sends less, and at ten times real
# time so many messages overload a ground station.
_FAST = (
    *(MessageId.ATTITUDE, MessageId.ATTITUDE_QUATERNION, MessageId.ATTITUDE_TARGET),
    *(MessageId.LOCAL_POSITION_NED, MessageId.GLOBAL_POSITION_INT),
    *(MessageId.POSITION_TARGET_LOCAL_NED, MessageId.SERVO_OUTPUT_RAW),
)
_STREAMS = StreamTraits(
    unasked_hz={
        MessageId.HEARTBEAT: 1.0,
        **dict.fromkeys(_FAST, 10.0),
        MessageId.GPS_RAW_INT: 5.0,
        MessageId.VFR_HUD: 4.0,
        MessageId.ALTITUDE: 1.0,
        MessageId.EXTENDED_SYS_STATE: 1.0,
        MessageId.MISSION_CURRENT: 1.0,
        MessageId.POSITION_TARGET_GLOBAL_INT: 1.0,
        MessageId.SYS_STATUS: 1.0,
        MessageId.BATTERY_STATUS: 0.5,
        MessageId.ESTIMATOR_STATUS: 0.5,
        MessageId.HOME_POSITION: 0.5,
    },
    default_hz=1.0,
    fixed=frozenset({MessageId.MISSION_CURRENT}),
    mute=frozenset({MessageId.NAV_CONTROLLER_OUTPUT}),
    unsent=frozenset({MessageId.EKF_STATUS_REPORT, MessageId.FENCE_STATUS}),
    # Of ten requests in a row ESTIMATOR_STATUS and SYS_STATUS answered five, GLOBAL_POSITION_INT four, GPS_RAW_INT and
    # LOCAL_POSITION_NED one: the others found what had just been streamed or answered.
    contents_s={
        MessageId.SYS_STATUS: 0.3,
        MessageId.ESTIMATOR_STATUS: 0.3,
        MessageId.GLOBAL_POSITION_INT: 0.3,
        MessageId.GPS_RAW_INT: 0.125,
        MessageId.LOCAL_POSITION_NED: 0.02,
    },
    fast_share=1.0,
    local_from=Milestone.RUNNING,
    global_from=Milestone.LOCATED,
    home_has_attitude=True,
)

# The original has some 900 parameters, in alphabetical order.
_INT32, _REAL32 = map(int, (ParameterType.INT32, ParameterType.REAL32))

_PARAM_TRAITS = ParamTraits(
    sysid="MAV_SYS_ID",
    sends_index=True,
    bytes_in_float=True,
    takes_nan=True,
    capacity="BAT1_CAPACITY",
    hash_name="_HASH_CHECK",
)

_PARAMS = (
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
    Param("MPC_XY_ERR_MAX", 2.0, _REAL32),
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

PX4 = Personality(
    autopilot=Autopilot.PX4,
    version=(1 << 24) | (17 << 16) | (0 << 8) | 64,
    capabilities=COMMON_CAPABILITIES | Capability.PARAM_BYTEWISE,
    sends_uid=True,
    boot=_BOOT,
    modes=_MODES,
    flight=FlightTraits(
        spool_up_s=1.5,
        status_shows_armable=True,
        crawl_below_m=1.0,
        landed_after_s=3.3,
        disarm_after_s=2.0,
        liftoff_pause_s=2.3,
        takeoff_above_sea=True,
        mission_start_arms=True,
        return_cone=True,
        reposition_in=Intent.HOLD,
        sinks_without_sticks=True,
        stream_lifts=True,
        stream_proof_s=1.0,
        stream_extrapolates_s=0.2,
    ),
    reports=ReportTraits(
        repeats=10, reports_landing=True, empty_total=0xFFFF, counts_home=True, mode_elsewhere=2, counts_manoeuvres=True
    ),
    replies=ReplyTraits(
        refused=MavResult.TEMPORARILY_REJECTED,
        unknown_mode=MavResult.ACCEPTED,
        unknown_stream=MavResult.FAILED,
        unknown_message=MavResult.DENIED,
        nothing_newer=MavResult.DENIED,
        unsupported=frozenset({MavCommand.DO_SET_MISSION_CURRENT}),
        mode_acks=2,
        message_first=True,
        set_mode_command=MavCommand.DO_SET_MODE,
        numbered_texts=True,
        clock_step_ns=4_000_000,
    ),
    streams=_STREAMS,
    health=HealthTraits(present=0x300402F, enabled=0x301402F, healthy=0x320C83F, before_ready=229, ready=1023),
    failsafes=_FAILSAFES,
    words=_WORDS,
    missions=MISSIONS,
    params=_PARAMS,
    param_traits=_PARAM_TRAITS,
)
