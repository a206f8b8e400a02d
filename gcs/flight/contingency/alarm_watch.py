"""What one vehicle says about its own failures: battery, sensors, system status, and motors that stop in the air.

Its texts are events of `gcs.flight.execution.text_watch`; here they only lower what counts as left of the battery.
"""

import math
from typing import NamedTuple

from gcs.autopilots.alarms import CHARGE_STATES, Alarm
from gcs.autopilots.columns import FlightBehaviour
from gcs.link.wire.message import Message, local_motion
from gcs.mavlink import PREARM_CHECK, MavState, ModeFlag
from gcs.mavlink_names import sensor_names

_FALLS_MPS = 2.0  # faster than any landing
_BATTERY_BIT = 0x2000000  # MAV_SYS_STATUS_SENSOR_BATTERY
_OTHERWISE_TOLD = PREARM_CHECK | 0x20 | 0x100000  # about arming, and GNSS and fence, which are incidents of their own
_SURE = 2  # reports in a row
_UNEXPLAINED_S = 2.0  # a failsafe's mode may come after the status


class Place(NamedTuple):
    """Where a vehicle is, as far as its motors matter. `flies`: it has not begun to land."""

    above_ground_m: float = math.nan
    flies: bool = False
    sure_m: float = 2.0  # higher above ground a vehicle that lands is in the air


UNKNOWN_PLACE = Place()


class AlarmWatch:
    """The alarms of one vehicle; each is reported once."""

    def __init__(self, behaviour: FlightBehaviour, low_pct: int, critical_pct: int) -> None:
        self.most_pct = 100  # what may count as left of the battery, whatever percentage it reports
        self.battery_text = ""  # what lowered it
        self._lowered_s = -math.inf
        self._texts = behaviour.alarms
        self._caps = {Alarm.BATTERY_LOW: low_pct, Alarm.BATTERY_CRITICAL: critical_pct}
        self._known: int | None = None  # sensors that were not healthy before the flight, or were reported
        self._ailing = 0
        self._critical_s = math.nan  # since when its system status is critical, and not reported
        self._critical = False
        self._news: list[str] = []
        self._armed = self._was_armed = False
        self._disarmed_beats = 0
        self._highest_m = 0.0
        self._down_mps = 0.0

    @property
    def stopped(self) -> bool:
        """Whether its motors stopped after they had run, and nobody was told."""
        return self._was_armed and not self._armed

    def receive(self, message: Message, unix_s: float) -> None:
        """Take in a message of the vehicle."""
        fields = message.fields
        match message.name:
            case "HEARTBEAT":
                self._beat(
                    bool(int(fields.get("base_mode", 0)) & ModeFlag.ARMED), int(fields.get("system_status", 0)), unix_s
                )
            case "LOCAL_POSITION_NED" if (motion := local_motion(message)) is not None:
                self._down_mps = motion[5]
            case "STATUSTEXT" if (alarm := self._texts.alarm(str(fields["text"]))) is not None:
                self._lower(alarm, str(fields["text"]).strip(), unix_s)
            case "BATTERY_STATUS":
                self._lower(CHARGE_STATES.get(int(fields.get("charge_state", 0))), "charge state", unix_s)
            case "SYS_STATUS" if "onboard_control_sensors_health" in fields:
                bad = fields["onboard_control_sensors_enabled"] & ~fields["onboard_control_sensors_health"]
                self._sense(bad, unix_s)

    def news(self, unix_s: float, *, obeys: bool) -> list[str]:
        """Return the alarms since the last call, in words. `obeys`: its mode is an ordered one, not a failsafe's."""
        news, self._news = self._news, []
        if not obeys:
            self._critical_s = math.nan
        if unix_s - self._critical_s > _UNEXPLAINED_S:
            self._critical_s = math.nan
            news.append("system status critical")
        return news

    def awaits_failsafe(self, unix_s: float) -> bool:
        """Whether the autopilot's own failsafe may still answer what lowered the battery."""
        return unix_s - self._lowered_s < _UNEXPLAINED_S

    def falls(self, place: Place) -> bool:
        """Return whether its motors stopped in the air: it falls, or says so in two HEARTBEATs. Reported once."""
        if not self.stopped:
            return False
        self._highest_m = max(self._highest_m, place.above_ground_m)
        in_air = place.flies or self._highest_m > place.sure_m
        if not in_air or (self._disarmed_beats < _SURE and self._down_mps < _FALLS_MPS):
            return False
        self._was_armed = False
        return True

    def _beat(self, armed: bool, status: int, unix_s: float) -> None:
        self._disarmed_beats = 0 if armed else self._disarmed_beats + 1
        if armed:
            self._was_armed, self._highest_m = True, 0.0
        self._armed = armed
        critical = status in (MavState.CRITICAL, MavState.EMERGENCY)
        if critical != self._critical:
            self._critical_s = unix_s if critical and armed else math.nan
        self._critical = critical

    def _lower(self, alarm: Alarm | None, said: str, unix_s: float) -> None:
        cap_pct = self._caps.get(alarm, 100) if alarm is not None else 100
        if cap_pct < self.most_pct:
            self.most_pct, self.battery_text, self._lowered_s = cap_pct, said, unix_s

    def _sense(self, unhealthy: int, unix_s: float) -> None:
        unhealthy &= ~_OTHERWISE_TOLD
        if self._known is None:
            self._known = unhealthy
        found = unhealthy & self._ailing & ~self._known
        self._ailing = unhealthy
        if found:
            self._known |= found
            names = ", ".join(sensor_names(found))
            self._news.append(f"not healthy any more: {names}")
            if found & _BATTERY_BIT:
                self._lower(Alarm.BATTERY_LOW, "battery not healthy", unix_s)
