"""The row of PX4: 1.17.

Sources: PX4's manual (the page "Mission Mode (Multicopter)" among others) and uploads to PX4 1.17-dev that were
recorded frame by frame.

Items without a position come back as they were sent, all seven numbers. Of items with a position it keeps what the
command uses; headings are stored as radians in single precision. Frames come back as 5 for 0 and 6 for 3.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

from gcs.autopilots import columns
from gcs.autopilots.alarms import PX4_ALARMS
from gcs.autopilots.protocol_timers import STANDARD
from gcs.autopilots.stored_fields import ItemStorage, StoredAs, StoredItem, published, recorded
from gcs.autopilots.waypoint_models import calibration
from gcs.mavlink import (
    PX4_HOLD,
    PX4_LAND,
    PX4_MISSION,
    PX4_OFFBOARD,
    PX4_RTL,
    EkfFlag,
    FenceCommand,
    MavCommand,
    MessageId,
    px4_mode,
)

_TAKEOFF_M = 2.5  # MIS_TAKEOFF_ALT: it climbs so far before anything else
_CRAWL_M = 1.0  # MPC_LAND_ALT3
_SINKS = 0.95  # recorded speed of descent over the one asked for
_DESCEND_M = 30.0  # RTL_DESCEND_ALT: from there on it lands slowly
# Once it is ready it sets all ten flags, CONST_POS_MODE among them: on PX4 that one means nothing.
_ESTIMATOR = columns.EstimatorReport(MessageId.ESTIMATOR_STATUS, columns.POSITION_FLAGS | EkfFlag.PRED_POS_HORIZ_ABS, 0)
_ABSENT = published(StoredAs.ZERO)
_EXACT = published(StoredAs.EXACT)
_KEPT = recorded(StoredAs.EXACT)
_HEADING = published(StoredAs.HEADING)
_FLAG = published(StoredAs.FLAG)

_AT_PLACE = StoredItem(*[_ABSENT] * 4, *[_KEPT] * 5)
_AS_SENT = StoredItem(*[_EXACT] * 9)
_RECORDED_AS_SENT = StoredItem(*[_KEPT] * 7, *[_EXACT] * 2)
_FENCE = replace(_AT_PLACE, param1=_KEPT)

PX4_ITEMS = ItemStorage(
    {
        MavCommand.NAV_TAKEOFF: replace(_AT_PLACE, param4=_HEADING),
        MavCommand.NAV_WAYPOINT: replace(_AT_PLACE, param1=_KEPT, param2=_EXACT, param4=recorded(StoredAs.HEADING)),
        MavCommand.NAV_LAND: replace(_AT_PLACE, param2=published(StoredAs.WHOLE), param4=recorded(StoredAs.HEADING)),
        MavCommand.NAV_LOITER_UNLIM: replace(_AT_PLACE, param3=_EXACT, param4=_HEADING),
        MavCommand.NAV_LOITER_TIME: replace(_AT_PLACE, param1=_EXACT, param2=_FLAG, param3=_EXACT, param4=_FLAG),
        MavCommand.NAV_LOITER_TO_ALT: replace(_AT_PLACE, param1=_FLAG, param2=_EXACT, param4=_FLAG),
        MavCommand.NAV_VTOL_TAKEOFF: replace(_AT_PLACE, param4=_HEADING),
        MavCommand.NAV_RETURN_TO_LAUNCH: _AS_SENT,
        MavCommand.NAV_DELAY: _RECORDED_AS_SENT,
        MavCommand.CONDITION_DELAY: _AS_SENT,
        MavCommand.CONDITION_DISTANCE: _AS_SENT,
        MavCommand.DO_JUMP: replace(_AS_SENT, param1=published(StoredAs.WHOLE), param2=published(StoredAs.WHOLE)),
        MavCommand.DO_CHANGE_SPEED: _RECORDED_AS_SENT,
        MavCommand.DO_SET_HOME: _AS_SENT,
        FenceCommand.RETURN_POINT: replace(_FENCE, param1=_ABSENT),
        FenceCommand.POLYGON_INCLUSION: _FENCE,
        FenceCommand.POLYGON_EXCLUSION: _FENCE,
        FenceCommand.CIRCLE_INCLUSION: _FENCE,
        FenceCommand.CIRCLE_EXCLUSION: _FENCE,
        FenceCommand.RALLY_POINT: _AT_PLACE,
    }
)

_RETURN: columns.ReturnTable = {
    "RTL_TYPE": ("return to home or a rally point", lambda _: 0),
    "RTL_RETURN_ALT": ("a return height for each vehicle", lambda wanted: wanted.altitude_m),
    "RTL_DESCEND_ALT": ("from here on, descend slowly", lambda wanted: min(_DESCEND_M, wanted.altitude_m)),
    "RTL_CONE_ANG": ("near home too, climb to that height", lambda _: 0),
    "RTL_LAND_DELAY": ("verified returns wait so long", lambda wanted: wanted.wait_s),
    "MPC_XY_CRUISE": ("speed of verified returns", lambda wanted: wanted.cruise_mps),
    "MPC_Z_V_AUTO_UP": ("climb of verified returns", lambda wanted: wanted.climb_mps),
    "MPC_Z_V_AUTO_DN": ("descent of verified returns", lambda wanted: wanted.sink_mps),
    "MIS_TAKEOFF_ALT": (
        "end of climb, not above the hover",
        lambda wanted: min(_TAKEOFF_M, math.floor(wanted.takeoff_m * 10) / 10),
    ),
    "GF_MAX_VER_DIST": ("10 m above the highest return", lambda wanted: wanted.fence_top_m),
}


def _landing_profile(values: Mapping[str, float]) -> columns.LandingProfile:
    """Linear from MPC_Z_V_AUTO_DN at MPC_LAND_ALT1 to MPC_LAND_SPEED at MPC_LAND_ALT2; it crawls just above the ground.

    Recorded speeds were 5 % lower than these. Heights count from home unless it measures the distance to the ground.
    """
    slow_mps, fast_mps = values["MPC_LAND_SPEED"], values["MPC_Z_V_AUTO_DN"]
    crawl_mps = min(values["MPC_LAND_CRWL"], slow_mps)
    low_m = max(values["MPC_LAND_ALT2"], _CRAWL_M + 0.2)
    high_m = max(values["MPC_LAND_ALT1"], low_m + 0.1)
    speeds = (crawl_mps, slow_mps, slow_mps, fast_mps)
    heights = (_CRAWL_M - 0.1, _CRAWL_M + 0.1, low_m, high_m)
    return columns.LandingProfile(heights, tuple(_SINKS * speed for speed in speeds), 0.8)


_COMMANDS = columns.commands_of(
    {
        columns.CommandSource.MANUAL: """
            NAV_LOITER_UNLIM NAV_LOITER_TIME NAV_RETURN_TO_LAUNCH NAV_LOITER_TO_ALT NAV_ROI NAV_VTOL_TAKEOFF DO_JUMP
            DO_SET_HOME DO_SET_SERVO DO_LAND_START DO_SET_ROI_LOCATION DO_SET_ROI_WPNEXT_OFFSET DO_SET_ROI_NONE
            DO_CONTROL_VIDEO DO_SET_ROI DO_DIGICAM_CONTROL DO_MOUNT_CONFIGURE DO_MOUNT_CONTROL DO_SET_CAM_TRIGG_DIST
            DO_AUTOTUNE_ENABLE DO_SET_CAM_TRIGG_INTERVAL OBLIQUE_SURVEY SET_CAMERA_MODE SET_CAMERA_ZOOM SET_CAMERA_FOCUS
            DO_GIMBAL_MANAGER_PITCHYAW DO_GIMBAL_MANAGER_CONFIGURE IMAGE_START_CAPTURE IMAGE_STOP_CAPTURE
            DO_TRIGGER_CONTROL VIDEO_START_CAPTURE VIDEO_STOP_CAPTURE
        """,
        columns.CommandSource.RECORDED: "NAV_WAYPOINT NAV_LAND NAV_TAKEOFF NAV_DELAY DO_CHANGE_SPEED",
        columns.CommandSource.REFUSED: "NAV_SPLINE_WAYPOINT CONDITION_YAW",
    }
)

# PX4 1.14 to 1.17 (`px4_custom_mode.h`). Two numbers are no longer in use: 8, and 7 of AUTO.
_MAIN_MODES = {
    **{1: "MANUAL", 2: "ALTITUDE", 3: "POSITION", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"},
    **{8: "RATTITUDE", 9: "SIMPLE", 10: "TERMINATION", 11: "ALTITUDE_CRUISE"},
}
_LOST_STREAM = ("POSITION", "ALTITUDE", "MANUAL", "STABILIZED", "TERMINATION")  # a lost stream, or a worse failure
_SUB_MODES = {
    3: {1: "ORBIT", 2: "POSITION_SLOW"},
    4: {
        **{1: "READY", 2: "TAKEOFF", 3: "HOLD", 4: "MISSION", 5: "RTL", 6: "LAND", 7: "RTGS", 8: "FOLLOW_TARGET"},
        **{9: "PRECLAND", 10: "VTOL_TAKEOFF"},
        **{10 + number: f"EXTERNAL{number}" for number in range(1, 9)},  # modes of a companion computer
    },
}

# Recorded: "Failsafe activated" and, within a second, system_status 5 with the new mode; the cause is a text before it.
# The pilot's text and the fence's older one are in its published sources.
_FAILSAFE = columns.FailsafeSigns(
    texts=(
        ("geofence violation", columns.FailsafeCause.FENCE),
        ("approaching or outside geofence", columns.FailsafeCause.FENCE),
        ("critical battery", columns.FailsafeCause.BATTERY),
        ("emergency battery", columns.FailsafeCause.BATTERY),
        ("connection to ground station lost", columns.FailsafeCause.LINK),
        ("failsafe activated", columns.FailsafeCause.OTHER),
    ),
    modes=frozenset(
        {PX4_HOLD, PX4_RTL, PX4_LAND, *(px4_mode(main) for main, name in _MAIN_MODES.items() if name in _LOST_STREAM)}
    ),
    always_critical=True,
    pilot_texts=("pilot took over",),
)

PX4 = columns.AutopilotTraits(
    title="PX4",
    missions=columns.MissionSupport(
        frames=columns.AMSL | columns.ABOVE_HOME,  # MISSION_UNSUPPORTED_FRAME to altitudes above the ground
        items_max=500,  # on its smaller boards; more with more memory (NUM_MISSIONS_SUPPORTED)
        fence_items_max=63,  # 64 less one (DM_KEY_FENCE_POINTS)
        rally_points_max=7,  # its oldest versions store 8 less one
        jumps_max=None,
        inside_every_inclusion=False,
        altitude_decimals=None,
        speed_mps=(0.1, 12.0),  # MPC_XY_VEL_MAX unless changed
        default_speed_mps=5.0,  # MPC_XY_CRUISE
        climb_mps=(3.0, 1.5),  # MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN
        height_0_is_height_before=False,
        takeoff_goes_to_place=True,
        commands=_COMMANDS,
    ),
    returns=columns.ReturnBehaviour(
        altitude_above_home=False,
        rally_at_return_altitude=False,  # it adds RTL_RETURN_ALT to the rally point
        wait_s=0.0,
        rally_step_m=0.01,
        default_altitude_m=60.0,  # RTL_RETURN_ALT
        at_fence="stops and holds (GF_ACTION 2, Hold)",  # recorded: "Failsafe activated", and it hovers there
        table=_RETURN,
    ),
    flight=columns.FlightBehaviour(
        guided=PX4_OFFBOARD,
        mission=PX4_MISSION,
        hold=PX4_HOLD,
        land=PX4_LAND,
        returning=PX4_RTL,
        armed_in=PX4_HOLD,
        two_part_modes=True,
        mode_names={px4_mode(main): name for main, name in _MAIN_MODES.items()}
        | {px4_mode(main, sub): name for main, subs in _SUB_MODES.items() for sub, name in subs.items()},
        takeoff_above_sea=True,
        stream_first_s=1.5,
        lag_s=0.1,  # 0.13 s at 20 Hz, less half a period of waiting for the next setpoint
        waits_for_time_of_day=False,
        health_ids=columns.HEALTH_IDS,
        failsafe=_FAILSAFE,
        alarms=PX4_ALARMS,
        takeoff_modes=frozenset({px4_mode(4, 2)}),
    ),
    landing=columns.LandingBehaviour(
        {
            "MPC_LAND_SPEED": 0.7,
            "MPC_LAND_CRWL": 0.3,
            "MPC_LAND_ALT1": 10.0,
            "MPC_LAND_ALT2": 5.0,
            "MPC_Z_V_AUTO_DN": 1.5,
        },
        _landing_profile,
    ),
    link=columns.LinkBehaviour(
        home_is_item_0=False,
        mission_files=False,
        # It follows requests one by one, and ends the transfer at a request for the item before the last: a late copy
        # does harm.
        requests_in_flight=1,
        integers_in_bytes=True,
        item_storage=PX4_ITEMS,
        # It stores the frame that was sent, and returns to points of frames 0 and 3 alone. With 5 or 6 it ignores the
        # point and says "RTL: unsupported MAV_FRAME" every 2 s.
        rally_integer_frames=False,
        system_id="MAV_SYS_ID",
        estimator=_ESTIMATOR,
        startup_texts=("Preflight Fail: ", "Arming denied: "),
        capacity_parameter="BAT1_CAPACITY",
        timers=STANDARD,
    ),
    parameter_file=columns.ParameterFileStyle.QGROUNDCONTROL,
    navigator=calibration.PX4,
    # Where each brakes is in the model's reactions. Recorded arrivals lie outside of these by at most 0.205 s RMS. Two
    # vehicles may so differ by 0.6 s, twice the square root of two times that. The rest is for a start of their own.
    apart_s=2.2,
    earth_radius_m=6_371_000.0,
)
