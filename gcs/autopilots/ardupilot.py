"""The row of ArduPilot: ArduCopter 4.5 and 4.7.

Sources: Copter's manual (the page "Mission Commands" among others), its published source code, and uploads to
ArduCopter 4.5.6 and 4.7-dev that were recorded frame by frame.

It stores an item of a mission in 15 bytes: the command, one whole number, and a position or numbers of the command's
own. `autocontinue` is not stored and reads back as true: false would be lost, so it counts as a difference. The item of
a waypoint or a landing does not turn the vehicle, WP_YAW_BEHAVIOR does.
"""

from collections.abc import Mapping
from dataclasses import replace

from gcs.autopilots import columns
from gcs.autopilots.alarms import ARDUPILOT_ALARMS
from gcs.autopilots.protocol_timers import STANDARD
from gcs.autopilots.stored_fields import ItemStorage, StoredAs, StoredItem, published, recorded
from gcs.autopilots.waypoint_models import calibration
from gcs.mavlink import CopterMode, EkfFlag, FenceCommand, MavCommand, MessageId

_CM = 100
_ALTITUDE_AND_AREAS = 5  # FENCE_TYPE: not the circle around home, which is on by default and ends 300 m away
# The PREARM bit of SYS_STATUS turns true before GUIDED can be armed, so readiness is read from these flags.
_ESTIMATOR = columns.EstimatorReport(
    MessageId.EKF_STATUS_REPORT, columns.POSITION_FLAGS, EkfFlag.CONST_POS_MODE | EkfFlag.UNINITIALIZED
)
_ABSENT = published(StoredAs.ZERO)
_EXACT = published(StoredAs.EXACT)
_KEPT = recorded(StoredAs.EXACT)
_WHOLE = published(StoredAs.WHOLE)

# In a position: x, y and the frame are kept (3 for 6, 0 for 5 and 2), the altitude is cut towards zero.
_AT_PLACE = StoredItem(_ABSENT, _ABSENT, _ABSENT, _ABSENT, _KEPT, _KEPT, recorded(StoredAs.CENTIMETRES), _KEPT, _EXACT)
_WITHOUT_PLACE = replace(_AT_PLACE, x=_ABSENT, y=_ABSENT, z=_ABSENT)
_WAYPOINT = replace(_AT_PLACE, param1=recorded(StoredAs.WHOLE), param4=recorded(StoredAs.ZERO))
# Fences are areas: no altitude, and frame 0 whatever was sent.
_FENCE = replace(_AT_PLACE, param1=_KEPT, z=_ABSENT, frame=_ABSENT)

ARDUPILOT_ITEMS = ItemStorage(
    {
        MavCommand.NAV_TAKEOFF: replace(_AT_PLACE, param1=_WHOLE, param4=recorded(StoredAs.ZERO)),  # pitch of planes
        MavCommand.NAV_WAYPOINT: _WAYPOINT,  # the hold in whole seconds
        MavCommand.NAV_SPLINE_WAYPOINT: replace(_AT_PLACE, param1=_WHOLE),
        MavCommand.NAV_LAND: replace(_AT_PLACE, param1=_WHOLE, param4=recorded(StoredAs.SIGN)),
        MavCommand.NAV_LOITER_UNLIM: replace(_AT_PLACE, param3=_WHOLE),
        MavCommand.NAV_LOITER_TIME: replace(
            _AT_PLACE, param1=_WHOLE, param3=published(StoredAs.SIGN), param4=published(StoredAs.FLAG)
        ),
        # Turns below 1 in steps of 1/256, radii above 255 m in steps of 10 m: others have to be whole.
        MavCommand.NAV_LOITER_TURNS: replace(_AT_PLACE, param1=_WHOLE, param3=_WHOLE, param4=published(StoredAs.FLAG)),
        MavCommand.NAV_LOITER_TO_ALT: replace(_AT_PLACE, param2=_WHOLE, param4=published(StoredAs.FLAG)),
        MavCommand.NAV_RETURN_TO_LAUNCH: _WITHOUT_PLACE,
        MavCommand.NAV_DELAY: replace(_WITHOUT_PLACE, param1=_KEPT, param2=_WHOLE, param3=_WHOLE, param4=_WHOLE),
        MavCommand.CONDITION_DELAY: replace(_WITHOUT_PLACE, param1=_EXACT),
        MavCommand.CONDITION_DISTANCE: replace(_WITHOUT_PLACE, param1=_EXACT),
        MavCommand.CONDITION_YAW: replace(_WITHOUT_PLACE, param1=_EXACT, param2=_EXACT, param3=_WHOLE, param4=_WHOLE),
        MavCommand.DO_JUMP: replace(_WITHOUT_PLACE, param1=_WHOLE, param2=_WHOLE),
        MavCommand.DO_CHANGE_SPEED: replace(_WITHOUT_PLACE, param1=_WHOLE, param2=_KEPT, param3=_KEPT),
        MavCommand.DO_SET_HOME: replace(_AT_PLACE, param1=_WHOLE),
        MavCommand.DO_SET_ROI: replace(_AT_PLACE, param1=_WHOLE),
        FenceCommand.RETURN_POINT: replace(_FENCE, param1=_ABSENT),
        FenceCommand.POLYGON_INCLUSION: replace(_FENCE, param1=_WHOLE),
        FenceCommand.POLYGON_EXCLUSION: replace(_FENCE, param1=_WHOLE),
        FenceCommand.CIRCLE_INCLUSION: _FENCE,
        FenceCommand.CIRCLE_EXCLUSION: _FENCE,
        FenceCommand.RALLY_POINT: replace(_AT_PLACE, z=recorded(StoredAs.WHOLE)),  # altitudes in whole metres
    }
)

# Under their names up to 4.6, in cm and cm/s; `_RENAMING` has those of 4.7.
_RETURN: columns.ReturnTable = {
    "RTL_ALT": ("a return height for each vehicle", lambda wanted: round(wanted.altitude_m * _CM)),
    "RTL_ALT_FINAL": ("land after the return", lambda _: 0),
    "RTL_CLIMB_MIN": ("climb to RTL_ALT, no higher", lambda _: 0),
    "RTL_CONE_SLOPE": ("near home too, climb to RTL_ALT", lambda _: 0.0),
    "RTL_SPEED": ("speed of verified returns", lambda wanted: round(wanted.cruise_mps * _CM)),
    "RTL_LOIT_TIME": ("verified returns wait so long", lambda wanted: round(wanted.wait_s * 1000)),
    "WPNAV_SPEED_UP": ("climb of verified returns", lambda wanted: float(round(wanted.climb_mps * _CM))),
    "WPNAV_SPEED_DN": ("descent of verified returns", lambda wanted: float(round(wanted.sink_mps * _CM))),
    "FENCE_ENABLE": ("the uploaded fence is in force", lambda _: 1),
    "FENCE_TYPE": ("ceiling and areas, no home circle", lambda _: _ALTITUDE_AND_AREAS),
    "FENCE_ALT_MAX": ("10 m above the highest return", lambda wanted: wanted.fence_top_m),
}


# Its published sources: every failsafe announces itself by a text. Only some set system_status, the fence does not.
_FAILSAFE = columns.FailsafeSigns(
    texts=(
        ("fence breached", columns.FailsafeCause.FENCE),
        ("ekf failsafe", columns.FailsafeCause.POSITION),
        ("dead reckoning", columns.FailsafeCause.POSITION),
        ("battery failsafe", columns.FailsafeCause.BATTERY),
        ("gcs failsafe", columns.FailsafeCause.LINK),
        ("radio failsafe", columns.FailsafeCause.LINK),
        ("failsafe", columns.FailsafeCause.OTHER),
    ),
    not_texts=("cleared", "resolved", "continuing"),
    modes=frozenset(CopterMode[name] for name in ["RTL", "LAND", "SMART_RTL", "BRAKE", "AUTO_RTL", "ALT_HOLD"]),
    always_critical=False,
)

# ArduPilot's page "Parameter Name Changes" (4.6 to 4.7). A source tree of 4.7.0-dev has MAV_SYSID, and the old names of
# all others; the recorded one has old names too.
_FROM_CM = """
    RTL_ALT RTL_ALT_M, RTL_ALT_FINAL RTL_ALT_FINAL_M, RTL_CLIMB_MIN RTL_CLIMB_MIN_M, RTL_SPEED RTL_SPEED_MS,
    LAND_SPEED LAND_SPD_MS, LAND_SPEED_HIGH LAND_SPD_HIGH_MS, LAND_ALT_LOW LAND_ALT_LOW_M, WPNAV_SPEED WP_SPD,
    WPNAV_SPEED_UP WP_SPD_UP, WPNAV_SPEED_DN WP_SPD_DN, WPNAV_ACCEL WP_ACC, WPNAV_ACCEL_C WP_ACC_CNR,
    WPNAV_ACCEL_Z WP_ACC_Z, WPNAV_RADIUS WP_RADIUS_M, LOIT_SPEED LOIT_SPEED_MS, PILOT_SPEED_UP PILOT_SPD_UP,
    PILOT_SPEED_DN PILOT_SPD_DN, PILOT_ACCEL_Z PILOT_ACC_Z, PILOT_TKOFF_ALT PILOT_TKO_ALT_M
"""
_RENAMING = columns.ParameterRenaming(
    since=(4, 7),
    names=(
        columns.RenamedParameter("SYSID_THISMAV", "MAV_SYSID"),
        columns.RenamedParameter("SYSID_MYGCS", "MAV_GCS_SYSID"),
        columns.RenamedParameter("WPNAV_JERK", "WP_JERK"),
        columns.RenamedParameter("ANGLE_MAX", "ATC_ANGLE_MAX", 100),  # centidegrees in a degree
        *(columns.RenamedParameter(old, new, _CM) for old, new in map(str.split, _FROM_CM.split(","))),
    ),
)


def _landing_profile(values: Mapping[str, float]) -> columns.LandingProfile:
    """Its law of braking leads from the speed above LAND_ALT_LOW to LAND_SPEED: gain 1/s, at most 1 m/s2.

    Both speeds are reached above LAND_ALT_LOW. Without a rangefinder heights count from home.
    """
    low_m, slow_mps = max(values["LAND_ALT_LOW"] / _CM, 1.0), values["LAND_SPEED"] / _CM
    fast_mps = (values["LAND_SPEED_HIGH"] or values["WPNAV_SPEED_DN"]) / _CM
    if fast_mps <= slow_mps:
        return columns.LandingProfile((0.0,), (slow_mps,), slow_mps / 2.0)
    speeds = [slow_mps + (fast_mps - slow_mps) * share for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    above_m = [speed if speed <= 1.0 else speed**2 / 2.0 + 0.5 for speed in speeds]
    return columns.LandingProfile(tuple(low_m + height for height in above_m), tuple(speeds), fast_mps / 2.0)


_COMMANDS = columns.commands_of(
    {
        columns.CommandSource.MANUAL: """
            NAV_LOITER_UNLIM NAV_LOITER_TURNS NAV_LOITER_TIME NAV_RETURN_TO_LAUNCH NAV_SPLINE_WAYPOINT NAV_GUIDED_ENABLE
            NAV_PAYLOAD_PLACE CONDITION_DELAY CONDITION_DISTANCE CONDITION_YAW DO_JUMP DO_SET_HOME DO_SET_RELAY
            DO_REPEAT_RELAY DO_SET_SERVO DO_REPEAT_SERVO DO_SET_ROI DO_DIGICAM_CONFIGURE DO_DIGICAM_CONTROL
            DO_MOUNT_CONTROL DO_SET_CAM_TRIGG_DIST DO_FENCE_ENABLE DO_PARACHUTE DO_GRIPPER DO_SET_RESUME_REPEAT_DIST
            DO_AUX_FUNCTION DO_GUIDED_LIMITS JUMP_TAG DO_JUMP_TAG DO_GIMBAL_MANAGER_PITCHYAW DO_WINCH NAV_SCRIPT_TIME
            NAV_ATTITUDE_TIME
        """,
        columns.CommandSource.RECORDED: "NAV_WAYPOINT NAV_LAND NAV_TAKEOFF NAV_DELAY DO_CHANGE_SPEED",
        columns.CommandSource.IGNORED: "DO_SET_MODE",
    }
)

ARDUPILOT = columns.AutopilotTraits(
    title="ArduCopter",
    missions=columns.MissionSupport(
        frames=columns.AMSL | columns.ABOVE_HOME | columns.ABOVE_GROUND,
        items_max=650,  # 4.5 and 4.7 answer NO_SPACE to the 651st
        fence_items_max=70,  # the manual's limit
        rally_points_max=10,  # or more
        jumps_max=15,  # boards with little memory ignore the others
        inside_every_inclusion=True,
        altitude_decimals=2,
        speed_mps=(0.2, 20.0),  # WPNAV_WP_SPEED_MIN: less is ignored; the upper limit of WPNAV_SPEED
        default_speed_mps=10.0,  # WPNAV_SPEED
        climb_mps=(2.5, 1.5),  # WPNAV_SPEED_UP, WPNAV_SPEED_DN
        height_0_is_height_before=True,
        takeoff_goes_to_place=False,
        commands=_COMMANDS,
    ),
    returns=columns.ReturnBehaviour(
        altitude_above_home=True,
        # It returns to a rally point at the point's altitude or at RTL_ALT, whichever is higher: here both are equal.
        rally_at_return_altitude=True,
        wait_s=5.0,
        rally_step_m=1.0,
        default_altitude_m=15.0,  # RTL_ALT
        # In RTL the action RTL changes nothing; LAND is for breaches of more than 100 m (AC_FENCE_GIVE_UP_DISTANCE).
        at_fence="flies on through the zone (FENCE_ACTION 1, RTL), or lands where it is 100 m inside",
        table=_RETURN,
    ),
    flight=columns.FlightBehaviour(
        guided=CopterMode.GUIDED,
        mission=CopterMode.AUTO,
        hold=CopterMode.LOITER,
        land=CopterMode.LAND,
        returning=CopterMode.RTL,
        armed_in=CopterMode.GUIDED,
        two_part_modes=False,
        mode_names={int(mode): mode.name for mode in CopterMode},
        takeoff_above_sea=False,
        stream_first_s=0.0,
        lag_s=0.0,  # setpoints that came 0.1 s early put it 0.43 m ahead
        waits_for_time_of_day=True,
        health_ids=(*columns.HEALTH_IDS, MessageId.FENCE_STATUS),
        failsafe=_FAILSAFE,
        alarms=ARDUPILOT_ALARMS,
    ),
    landing=columns.LandingBehaviour(
        {"LAND_SPEED": 50.0, "LAND_SPEED_HIGH": 0.0, "LAND_ALT_LOW": 1000.0, "WPNAV_SPEED_DN": 150.0}, _landing_profile
    ),
    link=columns.LinkBehaviour(
        prearm_bit=True,
        cured_text="PreArm: Mode requires mission",
        home_is_item_0=True,
        mission_files=True,  # 4.1 and newer
        requests_in_flight=8,  # it answers requests for items in any order
        integers_in_bytes=False,
        item_storage=ARDUPILOT_ITEMS,
        rally_integer_frames=True,  # it takes both, and reports 3 for 6
        renaming=_RENAMING,
        system_id="SYSID_THISMAV",
        estimator=_ESTIMATOR,
        startup_texts=("PreArm: ", "Arm: "),  # PreArm is repeated every 30 s while a condition is missing
        capacity_parameter="BATT_CAPACITY",
        fence_parameter="FENCE_ENABLE",
        timers=replace(STANDARD, mission=replace(STANDARD.mission, request_again_min_s=0.0)),  # copies do no harm
    ),
    parameter_file=columns.ParameterFileStyle.MISSION_PLANNER,
    navigator=calibration.ARDUPILOT,
    # Vehicles leave at a GNSS time of day, and the target moves by their clock alone. This is a tenth of the model's
    # error, for scheduling and clocks; no two vehicles were recorded side by side.
    apart_s=0.02,
    earth_radius_m=6_378_100.0,
)
