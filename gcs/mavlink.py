"""MAVLink numbers by name and in words: the values of the common and ardupilotmega dialects that this project uses.

Vehicles send plain ints: unknown values must survive.
"""

from enum import IntEnum, IntFlag
from typing import Self


class WordedEnum(IntEnum):
    """Values, each with its `words` for people."""

    words: str

    def __new__(cls, value: int, words: str = "") -> Self:
        """Make a member of `NAME = value, words`."""
        member = int.__new__(cls, value)
        member._value_, member.words = value, words
        return member


class MavType(IntEnum):
    """MAV_TYPE: the kind of system that sends a HEARTBEAT."""

    GENERIC = 0
    FIXED_WING = 1
    QUADROTOR = 2
    COAXIAL = 3
    HELICOPTER = 4
    GCS = 6
    GROUND_ROVER = 10
    HEXAROTOR = 13
    OCTOROTOR = 14
    TRICOPTER = 15
    ONBOARD_CONTROLLER = 18
    GIMBAL = 26
    ADSB = 27
    DODECAROTOR = 29
    CAMERA = 30
    FLARM = 32
    SERVO = 33
    ODID = 34
    DECAROTOR = 35
    BATTERY = 36
    PARACHUTE = 37
    LOG = 38
    OSD = 39
    IMU = 40
    GPS = 41
    WINCH = 42
    GENERIC_MULTIROTOR = 43


_T = MavType
# ArduCopter has no type before it knows its frame: a type that is not told is none of another vehicle.
ROTORCRAFT = frozenset({_T.GENERIC, _T.QUADROTOR, _T.COAXIAL, _T.HELICOPTER, _T.HEXAROTOR, _T.OCTOROTOR, _T.TRICOPTER})
ROTORCRAFT |= {_T.DODECAROTOR, _T.DECAROTOR, _T.GENERIC_MULTIROTOR}
# What sends HEARTBEATs under a vehicle's system id, some with an autopilot's number, and flies nothing.
PAYLOADS = frozenset({_T.ONBOARD_CONTROLLER, _T.GIMBAL, _T.ADSB, _T.CAMERA, _T.FLARM, _T.SERVO, _T.ODID, _T.BATTERY})
PAYLOADS |= {_T.PARACHUTE, _T.LOG, _T.OSD, _T.IMU, _T.GPS, _T.WINCH}

GENERIC_AUTOPILOT = 0  # MAV_AUTOPILOT values that name no firmware; `gcs.autopilots.traits` has those that do
NO_AUTOPILOT = 8


class MavState(IntEnum):
    """MAV_STATE."""

    UNINIT = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6
    POWEROFF = 7
    TERMINATION = 8


class ModeFlag(IntFlag):
    """MAV_MODE_FLAG: HEARTBEAT.base_mode."""

    CUSTOM = 1
    AUTO = 4
    GUIDED = 8
    STABILIZE = 16
    MANUAL_INPUT = 64
    ARMED = 128


class CopterMode(IntEnum):
    """ArduCopter's HEARTBEAT.custom_mode."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9
    DRIFT = 11
    SPORT = 13
    FLIP = 14
    AUTOTUNE = 15
    POSHOLD = 16
    BRAKE = 17
    THROW = 18
    AVOID_ADSB = 19
    GUIDED_NOGPS = 20
    SMART_RTL = 21
    FLOWHOLD = 22
    FOLLOW = 23
    ZIGZAG = 24
    SYSTEMID = 25
    AUTOROTATE = 26
    AUTO_RTL = 27
    TURTLE = 28
    RATE_ACRO = 29  # 4.6


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class EkfFlag(IntFlag):
    """EKF_STATUS_FLAGS."""

    ATTITUDE = 0x001
    VELOCITY_HORIZ = 0x002
    VELOCITY_VERT = 0x004
    POS_HORIZ_ABS = 0x010
    POS_VERT_ABS = 0x020
    CONST_POS_MODE = 0x080
    PRED_POS_HORIZ_ABS = 0x200
    UNINITIALIZED = 0x400


class Capability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY: AUTOPILOT_VERSION.capabilities."""

    MISSION_FLOAT = 1
    PARAM_FLOAT = 2
    MISSION_INT = 4
    COMMAND_INT = 8
    PARAM_BYTEWISE = 16
    FTP = 32
    SET_POSITION_TARGET_LOCAL_NED = 128
    SET_POSITION_TARGET_GLOBAL_INT = 256
    MAVLINK2 = 8192
    FENCE = 16384
    RALLY = 32768


class Severity(IntEnum):
    """MAV_SEVERITY: STATUSTEXT.severity."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class WireFrame(IntEnum):
    """MAV_FRAME values on links. Files use 0, 3 and 10 where links use 5, 6 and 11."""

    GLOBAL = 0
    LOCAL_NED = 1
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9
    GLOBAL_TERRAIN_ALT = 10
    GLOBAL_TERRAIN_ALT_INT = 11


class SetpointMask(IntFlag):
    """POSITION_TARGET_TYPEMASK: a set bit means "ignore this"."""

    IGNORE_POSITION = 0x007
    IGNORE_VELOCITY = 0x038
    IGNORE_ACCELERATION = 0x1C0
    FORCE = 0x200
    IGNORE_YAW = 0x400
    IGNORE_YAW_RATE = 0x800

    POSITION_VELOCITY_ACCELERATION_YAW = IGNORE_YAW_RATE


class MavCommand(IntEnum):
    """MAV_CMD values: items of missions, and commands sent on a link. Fence and rally items: `FenceCommand`."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_CONTINUE_AND_CHANGE_ALT = 30
    NAV_LOITER_TO_ALT = 31
    NAV_ROI = 80
    NAV_SPLINE_WAYPOINT = 82
    NAV_VTOL_TAKEOFF = 84
    NAV_VTOL_LAND = 85
    NAV_GUIDED_ENABLE = 92
    NAV_DELAY = 93
    NAV_PAYLOAD_PLACE = 94
    NAV_LAST = 95  # marks the end of the NAV commands
    CONDITION_DELAY = 112
    CONDITION_CHANGE_ALT = 113
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_SET_RELAY = 181
    DO_REPEAT_RELAY = 182
    DO_SET_SERVO = 183
    DO_REPEAT_SERVO = 184
    DO_LAND_START = 189
    DO_REPOSITION = 192
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI_WPNEXT_OFFSET = 196
    DO_SET_ROI_NONE = 197
    DO_CONTROL_VIDEO = 200
    DO_SET_ROI = 201
    DO_DIGICAM_CONFIGURE = 202
    DO_DIGICAM_CONTROL = 203
    DO_MOUNT_CONFIGURE = 204
    DO_MOUNT_CONTROL = 205
    DO_SET_CAM_TRIGG_DIST = 206
    DO_FENCE_ENABLE = 207
    DO_PARACHUTE = 208
    DO_GRIPPER = 211
    DO_AUTOTUNE_ENABLE = 212
    DO_SET_CAM_TRIGG_INTERVAL = 214
    DO_SET_RESUME_REPEAT_DIST = 215
    DO_AUX_FUNCTION = 218
    DO_GUIDED_LIMITS = 222
    DO_SET_MISSION_CURRENT = 224
    OBLIQUE_SURVEY = 260
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    STORAGE_FORMAT = 526
    SET_CAMERA_MODE = 530
    SET_CAMERA_ZOOM = 531
    SET_CAMERA_FOCUS = 532
    JUMP_TAG = 600
    DO_JUMP_TAG = 601
    DO_GIMBAL_MANAGER_PITCHYAW = 1000
    DO_GIMBAL_MANAGER_CONFIGURE = 1001
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    DO_TRIGGER_CONTROL = 2003
    VIDEO_START_CAPTURE = 2500
    VIDEO_STOP_CAPTURE = 2501
    DO_WINCH = 42600
    NAV_SCRIPT_TIME = 42702
    NAV_ATTITUDE_TIME = 42703


class MessageId(IntEnum):
    """The ids of messages that are requested by id."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    SYSTEM_TIME = 2
    GPS_RAW_INT = 24
    ATTITUDE = 30
    ATTITUDE_QUATERNION = 31
    LOCAL_POSITION_NED = 32
    GLOBAL_POSITION_INT = 33
    SERVO_OUTPUT_RAW = 36
    MISSION_CURRENT = 42
    GPS_GLOBAL_ORIGIN = 49
    NAV_CONTROLLER_OUTPUT = 62
    RC_CHANNELS = 65
    VFR_HUD = 74
    ATTITUDE_TARGET = 83
    POSITION_TARGET_LOCAL_NED = 85
    POSITION_TARGET_GLOBAL_INT = 87
    ALTITUDE = 141
    BATTERY_STATUS = 147
    AUTOPILOT_VERSION = 148
    FENCE_STATUS = 162
    EKF_STATUS_REPORT = 193
    ESTIMATOR_STATUS = 230
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245


PREARM_CHECK = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK, a bit of SYS_STATUS


class FenceCommand(IntEnum):
    """MAV_CMD values of fence and rally items."""

    RETURN_POINT = 5000
    POLYGON_INCLUSION = 5001  # parameter 1: number of vertices
    POLYGON_EXCLUSION = 5002
    CIRCLE_INCLUSION = 5003  # parameter 1: radius, m
    CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


FENCE_COMMANDS = frozenset(FenceCommand) - {FenceCommand.RALLY_POINT}  # of items of type FENCE


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE: the 64 bit types are not used by any autopilot."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    REAL32 = 9


class MissionType(WordedEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0, "mission"
    FENCE = 1, "fence"
    RALLY = 2, "rally points"
    ALL = 255, "mission, fence and rally points"


class MissionResult(WordedEnum):
    """MAV_MISSION_RESULT: MISSION_ACK.type."""

    ACCEPTED = 0, "accepted"
    ERROR = 1, "not accepting missions right now"
    UNSUPPORTED_FRAME = 2, "altitude frame not supported"
    UNSUPPORTED = 3, "command not supported"
    NO_SPACE = 4, "too many items for its memory"
    INVALID = 5, "invalid value"
    INVALID_PARAM1 = 6, "invalid parameter 1"
    INVALID_PARAM2 = 7, "invalid parameter 2"
    INVALID_PARAM3 = 8, "invalid parameter 3"
    INVALID_PARAM4 = 9, "invalid parameter 4"
    INVALID_PARAM5_X = 10, "invalid latitude"
    INVALID_PARAM6_Y = 11, "invalid longitude"
    INVALID_PARAM7 = 12, "invalid altitude"
    INVALID_SEQUENCE = 13, "item out of sequence"
    DENIED = 14, "busy with another station or operation"
    OPERATION_CANCELLED = 15, "transfer cancelled"


class MavResult(WordedEnum):
    """MAV_RESULT: COMMAND_ACK.result."""

    ACCEPTED = 0, "accepted"
    TEMPORARILY_REJECTED = 1, "not possible at this time"
    DENIED = 2, "invalid parameters"
    UNSUPPORTED = 3, "command not known"
    FAILED = 4, "execution failed"
    IN_PROGRESS = 5, "in progress"
    CANCELLED = 6, "cancelled"
    COMMAND_LONG_ONLY = 7, "only accepted as COMMAND_LONG"
    COMMAND_INT_ONLY = 8, "only accepted as COMMAND_INT"


def px4_mode(main: int, sub: int = 0) -> int:
    """PX4's HEARTBEAT.custom_mode: main << 16 | sub << 24."""
    return main << 16 | sub << 24


PX4_OFFBOARD = px4_mode(6)
PX4_MISSION = px4_mode(4, 4)
PX4_HOLD = px4_mode(4, 3)
PX4_RTL = px4_mode(4, 5)
PX4_LAND = px4_mode(4, 6)
