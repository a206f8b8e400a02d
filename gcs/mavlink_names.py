"""Words for MAVLink results, commands, mission types, sensors and severities. An unknown value keeps its number."""

from __future__ import annotations

from gcs.mavlink import MavCommand, MavResult, MissionResult, MissionType, Severity

_MISSION_RESULT_WORDS = {
    MissionResult.ACCEPTED: "accepted",
    MissionResult.ERROR: "not accepting missions right now",
    MissionResult.UNSUPPORTED_FRAME: "altitude frame not supported",
    MissionResult.UNSUPPORTED: "command not supported",
    MissionResult.NO_SPACE: "too many items for its memory",
    MissionResult.INVALID: "invalid value",
    MissionResult.INVALID_PARAM1: "invalid parameter 1",
    MissionResult.INVALID_PARAM2: "invalid parameter 2",
    MissionResult.INVALID_PARAM3: "invalid parameter 3",
    MissionResult.INVALID_PARAM4: "invalid parameter 4",
    MissionResult.INVALID_PARAM5_X: "invalid latitude",
    MissionResult.INVALID_PARAM6_Y: "invalid longitude",
    MissionResult.INVALID_PARAM7: "invalid altitude",
    MissionResult.INVALID_SEQUENCE: "item out of sequence",
    MissionResult.DENIED: "busy with another station or operation",
    MissionResult.OPERATION_CANCELLED: "transfer cancelled",
}

_RESULT_WORDS = {
    MavResult.ACCEPTED: "accepted",
    MavResult.TEMPORARILY_REJECTED: "not possible at this time",
    MavResult.DENIED: "invalid parameters",
    MavResult.UNSUPPORTED: "command not known",
    MavResult.FAILED: "execution failed",
    MavResult.IN_PROGRESS: "in progress",
    MavResult.CANCELLED: "cancelled",
    MavResult.COMMAND_LONG_ONLY: "only accepted as COMMAND_LONG",
    MavResult.COMMAND_INT_ONLY: "only accepted as COMMAND_INT",
}


_MISSION_TYPE_WORDS = {
    MissionType.MISSION: "mission",
    MissionType.FENCE: "fence",
    MissionType.RALLY: "rally points",
    MissionType.ALL: "mission, fence and rally points",
}


# MAV_SYS_STATUS_SENSOR: one word or two for every bit of SYS_STATUS, from bit 0 on
SENSORS = (
    "gyro",
    "accelerometer",
    "compass",
    "barometer",
    "airspeed",
    "GNSS",
    "optical flow",
    "vision position",
    "laser position",
    "external position",
    "rate control",
    "attitude control",
    "yaw control",
    "altitude control",
    "position control",
    "motors",
    "radio control",
    "second gyro",
    "second accelerometer",
    "second compass",
    "geofence",
    "attitude estimate",
    "terrain",
    "reversed motors",
    "logging",
    "battery",
    "proximity",
    "satellite link",
    "arming checks",
    "obstacle avoidance",
    "propulsion",
    "extension",
)


def sensor_names(bits: int) -> tuple[str, ...]:
    """Return the names of the sensors whose bits of SYS_STATUS are set."""
    return tuple(name for bit, name in enumerate(SENSORS) if bits >> bit & 1)


def severity_name(value: int) -> str:
    """Return a MAV_SEVERITY in capitals: CRITICAL. An unknown value keeps its number."""
    return Severity(value).name if value in Severity.__members__.values() else f"severity {value}"


def mission_type_words(value: int) -> str:
    """Return a MAV_MISSION_TYPE in words. An unknown value keeps its number."""
    return _MISSION_TYPE_WORDS[MissionType(value)] if value in _MISSION_TYPE_WORDS else f"items of type {value}"


def mission_result_words(value: int) -> str:
    """Return a MAV_MISSION_RESULT in words, with its MAVLink name in brackets. An unknown value keeps its number."""
    if value in _MISSION_RESULT_WORDS:
        result = MissionResult(value)
        return f"{_MISSION_RESULT_WORDS[result]} (MAV_MISSION_{result.name})"
    return f"MAV_MISSION_RESULT {value}"


def result_words(value: int) -> str:
    """Return a MAV_RESULT in words, with its MAVLink name in brackets. An unknown value keeps its number."""
    if value in _RESULT_WORDS:
        result = MavResult(value)
        return f"{_RESULT_WORDS[result]} (MAV_RESULT_{result.name})"
    return f"MAV_RESULT {value}"


def command_name(command: int) -> str:
    """Return `MAV_CMD_...` if the command is known here, else `MAV_CMD n`."""
    try:
        return f"MAV_CMD_{MavCommand(command).name}"
    except ValueError:
        return f"MAV_CMD {command}"
