"""Words for MAVLink results, commands, mission types, sensors and severities. An unknown value keeps its number."""

from gcs.mavlink import MavCommand, MavResult, MissionResult, MissionType, Severity, WordedEnum

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
    return MissionType(value).words if value in tuple(MissionType) else f"items of type {value}"


def mission_result_words(value: int) -> str:
    """Return a MAV_MISSION_RESULT in words, with its MAVLink name in brackets. An unknown value keeps its number."""
    return named_words(MissionResult, value, "MAV_MISSION", f"MAV_MISSION_RESULT {value}")


def result_words(value: int) -> str:
    """Return a MAV_RESULT in words, with its MAVLink name in brackets. An unknown value keeps its number."""
    return named_words(MavResult, value, "MAV_RESULT", f"MAV_RESULT {value}")


def named_words(kind: type[WordedEnum], value: int, prefix: str, unknown: str) -> str:
    """Return the words of a value, with its MAVLink name in brackets: "accepted (MAV_RESULT_ACCEPTED)"."""
    return f"{kind(value).words} ({prefix}_{kind(value).name})" if value in tuple(kind) else unknown


def command_name(command: int) -> str:
    """Return `MAV_CMD_...` if the command is known here, else `MAV_CMD n`."""
    try:
        return f"MAV_CMD_{MavCommand(command).name}"
    except ValueError:
        return f"MAV_CMD {command}"
