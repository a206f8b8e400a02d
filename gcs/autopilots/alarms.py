"""The alarms that an autopilot raises: from its texts, and from bits that all autopilots share.

A row matches a STATUSTEXT that contains its text, in lower case; the first row that matches counts. The texts are from
recordings and from the autopilots' published sources. A STATUSTEXT that no row matches is shown as the vehicle sent it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class Alarm(StrEnum):
    """What an alarm is about."""

    BATTERY_LOW = "battery low"
    BATTERY_CRITICAL = "battery critical"
    CRASH = "crash"
    MOTOR = "motor or ESC"
    ESTIMATOR = "position estimate"
    COMPASS = "compass"
    GNSS = "GNSS"
    VIBRATION = "vibration"
    TERRAIN = "terrain"
    FENCE = "fence"
    SENSOR = "sensor"


# Alarms however low the severity of their text; a text of severity WARNING or worse is one in any case.
GRAVE = frozenset({Alarm.BATTERY_LOW, Alarm.BATTERY_CRITICAL, Alarm.CRASH, Alarm.MOTOR, Alarm.FENCE})


@dataclass(frozen=True)
class AlarmTexts:
    """The texts of one autopilot."""

    rows: tuple[tuple[str, Alarm], ...] = ()
    over: tuple[str, ...] = ()  # a text with one of these parts says that an alarm has ended

    def alarm(self, text: str) -> Alarm | None:
        """Return the alarm that a text raises; None for a text of something else."""
        lower = text.lower()
        if any(part in lower for part in self.over):
            return None
        return next((alarm for part, alarm in self.rows if all(word in lower for word in part.split(" .. "))), None)


NO_ALARMS = AlarmTexts()
ARDUPILOT_ALARMS = AlarmTexts(
    rows=(
        ("battery .. is critical", Alarm.BATTERY_CRITICAL),
        ("battery .. is low", Alarm.BATTERY_LOW),
        ("battery failsafe", Alarm.BATTERY_LOW),
        ("crash: ", Alarm.CRASH),
        ("thrust loss", Alarm.MOTOR),
        ("yaw imbalance", Alarm.MOTOR),
        ("esc ", Alarm.MOTOR),
        ("compass variance", Alarm.COMPASS),
        ("mag anomaly", Alarm.COMPASS),
        ("gps glitch", Alarm.GNSS),
        ("gps .. not healthy", Alarm.GNSS),
        ("ekf variance", Alarm.ESTIMATOR),
        ("ekf failsafe", Alarm.ESTIMATOR),
        ("dead reckoning", Alarm.ESTIMATOR),
        ("stopped aiding", Alarm.ESTIMATOR),
        ("lane switch", Alarm.ESTIMATOR),
        ("ekf primary changed", Alarm.ESTIMATOR),
        ("compass", Alarm.COMPASS),
        ("vibration compensation on", Alarm.VIBRATION),
        ("terrain", Alarm.TERRAIN),
        ("fence breached", Alarm.FENCE),
        ("bad gyro health", Alarm.SENSOR),
        ("bad baro health", Alarm.SENSOR),
        ("bad accel health", Alarm.SENSOR),
    ),
    over=("cleared", "resolved", "prearm", "arm:", "indexed ok"),
)
PX4_ALARMS = AlarmTexts(
    rows=(
        ("critical battery", Alarm.BATTERY_CRITICAL),
        ("emergency battery", Alarm.BATTERY_CRITICAL),
        ("dangerously low battery", Alarm.BATTERY_CRITICAL),
        ("low battery", Alarm.BATTERY_LOW),
        ("battery .. low", Alarm.BATTERY_LOW),
        ("attitude failure", Alarm.CRASH),
        ("flight termination", Alarm.CRASH),
        ("motor failure", Alarm.MOTOR),
        ("motor .. fail", Alarm.MOTOR),
        ("esc ", Alarm.MOTOR),
        ("geofence", Alarm.FENCE),
        ("vibration", Alarm.VIBRATION),
        ("compass", Alarm.COMPASS),
        ("magnet", Alarm.COMPASS),
        ("gps", Alarm.GNSS),
        ("gnss", Alarm.GNSS),
        ("position estimate", Alarm.ESTIMATOR),
        ("estimate .. stable", Alarm.ESTIMATOR),
        ("navigation failure", Alarm.ESTIMATOR),
        ("position lost", Alarm.ESTIMATOR),
        ("terrain", Alarm.TERRAIN),
    ),
    over=("regained", "preflight fail", "arming denied"),
)
CHARGE_STATES: Mapping[int, Alarm] = {  # MAV_BATTERY_CHARGE_STATE
    2: Alarm.BATTERY_LOW,
    3: Alarm.BATTERY_CRITICAL,
    4: Alarm.BATTERY_CRITICAL,
    5: Alarm.BATTERY_CRITICAL,
    6: Alarm.BATTERY_CRITICAL,
}
