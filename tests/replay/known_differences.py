"""Intended differences from the recorded autopilots, each with its reason.

An entry matches the words in which `tests.replay.compare` tells a difference. A test names what explains nothing.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

# Entry that an autopilot repeats on a clock of its own: compared by rate, like telemetry.
STREAMS = {
    "arducopter-*": frozenset[str](),
    "px4-*": frozenset({"HOME_POSITION", "GPS_GLOBAL_ORIGIN", "UNKNOWN_410"}),
}


@dataclass(frozen=True)
class KnownDifference:
    """A difference that may be: where (shell patterns), which (a regular expression for the whole line), and why."""

    autopilot: str
    scene: str
    line: str
    why: str

    def covers(self, autopilot: str, scene: str, line: str) -> bool:
        """Whether this entry explains the difference."""
        here = fnmatch(autopilot, self.autopilot) and fnmatch(scene, self.scene)
        return here and re.fullmatch(self.line, line) is not None


_NO_SUCH_PARTS = (
    "ANGLE|BARO|CAL|EK3|EKF2|FILT|INS|MOT|PILOT|SENS|SERIAL|SUPER|GCS_PID|VT|WV|ATC|STAT|LAND_SPEED_HIGH|SIM|COMPASS"
)
KNOWN: Sequence[KnownDifference] = (
    KnownDifference(
        "arducopter-*",
        "read_back",
        r"missing (STATUSTEXT (EKF3 IMU|AHRS: EKF3|GPS 1: detected|Field Elevation).*|GPS_GLOBAL_ORIGIN|HOME_POSITION)",
        "the recording begins while the vehicle starts; how it starts is compared in `connect`",
    ),
    # Parameters
    KnownDifference(
        "*",
        "*",
        r"PARAM_VALUE \S+ param_(count|index): \d+ -> \d+",
        "the emulated vehicles have the parameters that do something, not all 900 or 1390",
    ),
    KnownDifference(
        "*",
        "*",
        rf"missing PARAM_VALUE ({_NO_SUCH_PARTS})\S*",
        "parameters of parts that the emulated vehicles do not have, or that are found out and counted as they live",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "params",
        r"(missing )?PARAM_VALUE (FRAME_TYPE param_value: 0 -> 1|\S+)",
        "names, and their order, are those of 4.5.6",
    ),
    KnownDifference("*", "params", r"extra PARAM_VALUE \S+", "the file keeps the first 50 and the last 5 of a list"),
    KnownDifference(
        "arducopter-*",
        "params",
        r"PARAM_VALUE WP_YAW_BEHAVIOR param_value: 2 -> 0",
        "their yaw does not turn towards the next waypoint, and the parameter says so",
    ),
    KnownDifference(
        "px4-*",
        "params",
        r"PARAM_VALUE _HASH_CHECK param_value: .*",
        "it is reckoned over other parameters",
    ),
    KnownDifference(
        "px4-*",
        "params",
        r"missing PARAM_VALUE COM_OF_LOSS_T",
        "a value that was set is reported once; the original tells some of them again when it comes to store them",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "*",
        r"extra PARAM_VALUE MIS_TOTAL",
        "4.5.6 tells every step of the count, as here; this version leaves out those that came too quickly",
    ),
    KnownDifference(
        "px4-*",
        "*",
        r"missing PARAM_VALUE (COM_RC_LOSS_T|SYS_AUTO\w+)",
        "nothing is set up anew at boot, so nothing of it is reported",
    ),
    KnownDifference(
        "arducopter-*",
        "auto_flight",
        r"extra PARAM_VALUE MIS_TOTAL",
        "the recorded vehicle still held as many items, of an earlier scene: nothing to tell",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "*",
        r"missing PARAM_VALUE MIS_TOTAL",
        "this version tells the count at boot, and when a clear of nothing leaves it as it was",
    ),
    # Identity
    KnownDifference(
        "*",
        "*",
        r"AUTOPILOT_VERSION capabilities: \d+ -> \d+",
        "they claim what they can do, which is less",
    ),
    KnownDifference("arducopter-4.7dev", "*", r"AUTOPILOT_VERSION flight_sw_version: .*", "they are 4.5.6"),
    # What was there before the scene
    KnownDifference(
        "px4-*",
        "*",
        r"MISSION_CURRENT (total: 4 -> 65535|mission_state: [35] -> 1)",
        "the recorded vehicle still held the mission of an earlier scene",
    ),
    KnownDifference(
        "px4-*",
        "*",
        r"HEARTBEAT base_mode: 17 -> 1",
        "in OFFBOARD the flags tell what was controlled last, in an earlier scene",
    ),
    # Words
    KnownDifference(
        "arducopter-*",
        "params",
        r"(missing )?STATUSTEXT (ArduCopter V|[0-9a-f]{32}|Frame: QUAD).*",
        "a version, a build and a frame of their own",
    ),
    KnownDifference("arducopter-*", "*", r"missing STATUSTEXT RC7: SaveWaypoint LOW", "there is no remote control"),
    KnownDifference(
        "*",
        "*",
        r"missing STATUSTEXT (SIM Hit ground|EKF3 IMU\d MAG0 in-flight yaw|\[logger\]).*",
        "words of a simulator, a filter and a logger that are not theirs",
    ),
    KnownDifference("arducopter-*", "*", r"missing BAD_DATA", "no console text is written into the link"),
    # What they do not speak
    KnownDifference(
        "px4-*",
        "*",
        r"missing COMMAND_LONG \d+",
        "to cameras and gimbals, and to itself: there is nothing else on board",
    ),
    KnownDifference(
        "*",
        "timesync",
        r"missing (UNKNOWN_300|AVAILABLE_MODES)",
        "PROTOCOL_VERSION and AVAILABLE_MODES are not in the project's MAVLink dialect",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "timesync",
        r"missing MESSAGE_INTERVAL 0",
        "4.5.6 refuses to be asked for it that way, as they do",
    ),
    KnownDifference(
        "*",
        "timesync",
        r"COMMAND_ACK 512 result: 0 -> [24]",
        "as after any request of a message that it does not have",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "arm_refusals",
        r"extra COMMAND_ACK 11",
        "4.5.6 acknowledges SET_MODE, as they do; this version does not",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "*",
        r"HEARTBEAT (base_mode: \d+ -> \d+|system_status: 1 -> [34])|missing HEARTBEAT",
        "4.5.6 tells of a position in base_mode by mode alone and has no BOOT state; this version corrects base_mode a "
        "second after a change of mode, one HEARTBEAT more",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "arm_refusals",
        r"HEARTBEAT custom_mode: (0 -> 3|3 -> 6)",
        "of its two HEARTBEATs for each mode (see above) one has nothing to answer to",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "arm_refusals",
        r"(STATUSTEXT Arm: System not initialised -> |extra )STATUSTEXT Arm: .*",
        "4.5.6 names every part that is not ready, as they do; this version says one sentence for all",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "*",
        r"(missing )?STATUSTEXT GPS 1: (probing for|detected) u-blox.*",
        "4.5.6's words for a receiver it has found",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "arm_refusals",
        r"(missing|extra) STATUSTEXT PreArm: Mode requires mission",
        "checks look once a second, counted from the boot, which takes this version a third of a second longer",
    ),
    # How they fly
    KnownDifference(
        "arducopter-*",
        "arm_refusals",
        r"missing (HEARTBEAT|STATUSTEXT Disarming motors)",
        "the recorded vehicle's throttle stick stood at its bottom: in LOITER it sank at 2.4 m/s and was on the ground "
        "when LAND came. Here sticks stand in the middle, and a landing from 4 m outlasts the scene",
    ),
    KnownDifference(
        "arducopter-4.5.6",
        "guided_flight",
        r"extra HEARTBEAT",
        "its return and its landing take 2 s longer here, so one HEARTBEAT more comes before it is disarmed",
    ),
    KnownDifference(
        "px4-*",
        "guided_flight",
        r"(missing|extra) STATUSTEXT RTL: start return at 49\d m \(4 m above destination\)",
        "metres above the sea as its barometer has them, half a metre off",
    ),
    # Telemetry
    KnownDifference(
        "px4-*",
        "*",
        r"rate of (ATTITUDE\w*|LOCAL_POSITION_NED|GLOBAL_POSITION_INT|POSITION_TARGET_LOCAL_NED|SERVO_OUTPUT_RAW): "
        r"[\d.]+ -> [\d.]+ Hz",
        "50 Hz over a link without limits there, 10 Hz here for stations that request no rate: at ten times real time "
        "that many messages of many vehicles drown a ground station. A station that requests 50 Hz gets it",
    ),
    KnownDifference(
        "px4-*",
        "*",
        r"no (UNKNOWN_(8|380|410|411)|CURRENT_MODE)",
        "messages that the project's MAVLink dialect does not have",
    ),
    KnownDifference(
        "px4-*",
        "*",
        r"no (DISTANCE_SENSOR|OPEN_DRONE_ID_\w+|SCALED_PRESSURE|VIBRATION|PING|HIGHRES_IMU|LINK_NODE_STATUS)",
        "told of parts that the emulated vehicles do not have",
    ),
    KnownDifference(
        "arducopter-4.7dev",
        "*",
        r"no (AVAILABLE_MODES_MONITOR|CURRENT_MODE)",
        "messages that the project's MAVLink dialect does not have",
    ),
    KnownDifference(
        "arducopter-*",
        "mission_upload_bad",
        r"rate of GLOBAL_POSITION_INT: 1\.4\d -> 2\.\d+ Hz",
        "telemetry is not held back while items are transferred",
    ),
    # Requests
    KnownDifference(
        "px4-*",
        "params",
        r"PARAM_VALUE BAT1_CAPACITY param_value: -1 -> \d+",
        "an emulated vehicle is set to the battery of its scenario",
    ),
    KnownDifference(
        "px4-*",
        "requests",
        r"COMMAND_ACK 512 result: (0 -> 2|2 -> 0)|(missing|extra) (SYS_STATUS|ESTIMATOR_STATUS)",
        "which of ten requests finds something newer depends on the instant; how many do is compared by a test",
    ),
    KnownDifference(
        "*",
        "requests",
        r"order: \w+( \d+)? after \w+( \d+)?|extra (AUTOPILOT_VERSION|HOME_POSITION|GPS_GLOBAL_ORIGIN)",
        "messages that are streamed at 2 Hz begin at another instant",
    ),
    KnownDifference(
        "px4-*",
        "requests",
        r"rate of (ESTIMATOR_STATUS|EXTENDED_SYS_STATE|SYSTEM_TIME|GPS_GLOBAL_ORIGIN|GPS_RAW_INT): [\d.]+ -> [\d.]+ Hz",
        "requested messages count as well, and the file leaves out what came faster than 5 Hz",
    ),
    KnownDifference(
        "arducopter-*",
        "requests",
        r"missing (GPS_GLOBAL_ORIGIN|HOME_POSITION|STATUSTEXT (EKF3 IMU|Field Elevation|GPS 1: detected as).*)",
        "the recorded vehicle was switched on 7 s before the scene; the emulated one is ready when it begins",
    ),
)


def streams_of(autopilot: str) -> frozenset[str]:
    """Entry that counts as telemetry with this autopilot."""
    return next(names for pattern, names in STREAMS.items() if fnmatch(autopilot, pattern))


def explained_by(autopilot: str, scene: str, line: str) -> KnownDifference | None:
    """The entry that explains a difference, or None."""
    return next((entry for entry in KNOWN if entry.covers(autopilot, scene, line)), None)
