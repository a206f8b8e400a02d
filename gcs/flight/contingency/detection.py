"""Detects incidents in one vehicle's messages: silence, no fix, low battery, fence, a mode that was not ordered.

A mode that was not ordered is a failsafe's if the vehicle shows the signs of one; else it is a pilot's.

Time is an argument, in the fleet's common time, so that it passes as fast as emulated vehicles fly.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from gcs.autopilots.columns import FailsafeCause, FlightBehaviour
from gcs.flight.contingency.alarm_watch import UNKNOWN_PLACE, AlarmWatch, Place
from gcs.flight.contingency.conflict_prediction import HORIZON_S
from gcs.flight.contingency.energy_choice import Outcome
from gcs.flight.contingency.mode_changes import ModeChanges, ModeOrigin
from gcs.flight.monitoring.predicted_tracks import BAND_S, CONFIRMED_S
from gcs.flight.monitoring.volume_watch import CONFIRMED_S as OUTSIDE_S
from gcs.link.wire.message import Message, local_motion


class IncidentKind(StrEnum):
    """The incidents of a flight."""

    LINK_LOST = "link lost"
    LINK_BACK = "link back"
    VEHICLE_LOST = "vehicle lost"
    GNSS_LOST = "GNSS lost"
    GNSS_BACK = "GNSS back"
    GNSS_GONE = "GNSS gone for too long"
    BATTERY_LOW = "battery low"
    BATTERY_CRITICAL = "battery critical"
    FENCE = "fence breached"
    FAILSAFE = "failsafe took over"
    MODE_LEFT = "pilot took over"
    CONFLICT = "separation in danger"
    OFF_TRACK = "off its predicted track"
    OUTSIDE_VOLUME = "outside its volumes"
    STRANDED = "no setpoints for some time"
    DOWN = "on the ground with its motors running"
    MOTORS_STOPPED = "disarmed in the air"
    ALARM = "raises an alarm"


@dataclass(frozen=True)
class Incident:
    """One incident of a vehicle at a time of the fleet."""

    kind: IncidentKind
    sysid: int
    unix_s: float
    detail: str = ""
    other: int | None = None  # of a conflict
    in_s: float = 0.0  # of a conflict
    usable: bool = True  # of a link that is back: in its place and mode; of stranded vehicles: there is a way back
    outcome: Outcome | None = None  # of a low battery: what its energy allows; None: not known
    takeable: bool = True  # of a failsafe: the vehicle can follow setpoints, and does not land already
    cause: FailsafeCause = FailsafeCause.OTHER  # of a failsafe
    ours: bool = False  # of a failsafe: this program stood still, so the vehicle had no setpoints
    higher: bool = True  # of a conflict: the vehicle is not below the other one


@dataclass(frozen=True)
class DetectionLimits:
    """When a condition becomes an incident, in seconds of the vehicles' time and percent of a full battery."""

    link_lost_s: float = 3.0
    vehicle_lost_s: float = 10.0
    gnss_gone_s: float = 8.0
    battery_low_pct: int = 20
    battery_critical_pct: int = 10
    battery_reserve_pct: float = 4.0  # left at touchdown after a choice at the critical level
    text_wait_s: float = 1.5  # a failsafe's text may come after the HEARTBEAT with its mode
    evidence_s: float = 3.0  # a sign of a failsafe, or of a pilot, holds for so long


LIMITS = DetectionLimits()
_FULL_PCT = 100
OBEYS_M, OBEYS_S = 5.0, 3.0  # so far from its setpoints for so long a vehicle does not follow them; a gust is shorter
DETECTED = {  # how each incident is detected, for the documents
    IncidentKind.LINK_LOST: f"no message for {LIMITS.link_lost_s:g} s",
    IncidentKind.LINK_BACK: "a position after a silence",
    IncidentKind.VEHICLE_LOST: f"no message for {LIMITS.vehicle_lost_s:g} s",
    IncidentKind.GNSS_LOST: "GPS_RAW_INT: a fix below 3D",
    IncidentKind.GNSS_BACK: "GPS_RAW_INT: a 3D fix again",
    IncidentKind.GNSS_GONE: f"no 3D fix for {LIMITS.gnss_gone_s:g} s",
    IncidentKind.BATTERY_LOW: f"SYS_STATUS: {LIMITS.battery_low_pct} % left, and with every percent less; an alarm of "
    "the vehicle (text, charge state, sensor bit) counts as that percentage",
    IncidentKind.BATTERY_CRITICAL: f"the same at {LIMITS.battery_critical_pct} %",
    IncidentKind.FENCE: "FENCE_STATUS, or a STATUSTEXT of the autopilot",
    IncidentKind.FAILSAFE: "HEARTBEAT: a mode that was not ordered, with a failsafe's STATUSTEXT or system_status",
    IncidentKind.MODE_LEFT: f"HEARTBEAT: a mode that was not ordered, no failsafe shown for {LIMITS.text_wait_s:g} s",
    IncidentKind.CONFLICT: f"separation below `[judge]` predicted within {HORIZON_S:g} s, three times in a row",
    IncidentKind.OFF_TRACK: f"mission mode: for {CONFIRMED_S:g} s more than {BAND_S:g} s late or early on its "
    f"predicted track, or farther from it than the navigation error; setpoints: for {OBEYS_S:g} s "
    f"more than {OBEYS_M:g} m from them",
    IncidentKind.OUTSIDE_VOLUME: f"with `--volumes`: reported for {OUTSIDE_S:g} s outside all volumes in force",
    IncidentKind.STRANDED: "this program itself stood still for more than 1 s in a flight by setpoints",
    IncidentKind.DOWN: "armed for 2 s at the ground and more than 5 m off its place, where the plan flies higher",
    IncidentKind.MOTORS_STOPPED: "HEARTBEAT: not armed above ground, twice or with a fall faster than 2 m/s",
    IncidentKind.ALARM: "SYS_STATUS: a sensor that is not healthy any more; HEARTBEAT: system status critical",
}


class VehicleWatch:
    """Watches one vehicle. `obeys` are the ordered modes; in any other one its failsafe or a pilot has taken over."""

    def __init__(
        self, sysid: int, behaviour: FlightBehaviour, limits: DetectionLimits, unix_s: float, obeys: frozenset[int]
    ) -> None:
        self.sysid = sysid
        self.obeys = obeys
        self.alarms = AlarmWatch(behaviour, limits.battery_low_pct, limits.battery_critical_pct)
        self._reported_pct: int | None = None  # as last reported
        self._behaviour = behaviour
        self._limits = limits
        self._heard_s = unix_s
        self._silent = self._lost = False
        self._placed_s = unix_s
        self._heard_since = self._placed_since = False
        self._no_fix_since_s = math.nan
        self._no_fix_reported = 0
        self._battery_reported_pct = _FULL_PCT
        self._fence, self._fence_reported = False, False
        self._signs = ModeChanges(behaviour, limits.text_wait_s, limits.evidence_s)
        self._tolerated: int | None = None  # the mode that an order is about to end

    @property
    def remaining_pct(self) -> int | None:
        """What is left of the battery: the lower of what it reports and what its alarms say; None: not known."""
        if self._reported_pct is None and self.alarms.most_pct == _FULL_PCT:
            return None
        return min(_FULL_PCT if self._reported_pct is None else self._reported_pct, self.alarms.most_pct)

    def begin(self, unix_s: float, mode: int | None = None) -> None:
        """Begin to watch: silence counts from now. `mode` is the mode shown last."""
        if not self._lost:
            self._heard_s = self._placed_s = unix_s
        self._signs.begin(mode)

    def never_heard(self) -> None:
        """The vehicle was lost before this watch began: its first position is that of a link that is back."""
        self._silent = self._lost = True
        self._heard_s = self._placed_s = -math.inf

    def excuse(self, seconds: float, unix_s: float) -> None:
        """Count these seconds of vehicle time before `unix_s` neither as silence nor as age of what was heard.

        This program did not listen.
        """
        self._heard_s += seconds
        self._placed_s += seconds
        self._signs.excuse(seconds, unix_s)

    def order(self, *modes: int) -> None:
        """Count these modes as ordered too. The mode shown now is no incident until the vehicle has left it."""
        self.obeys = self.obeys | frozenset(modes)
        self._tolerated = self._signs.mode
        self._signs.settle()

    def obey_only(self, modes: frozenset[int]) -> None:
        """From now on only these modes are ordered ones."""
        self.obeys = modes

    def receive(self, message: Message, unix_s: float) -> None:
        """Take in a message of the vehicle; any message ends a silence."""
        self._heard_s = max(self._heard_s, unix_s)
        self._heard_since = True
        fields = message.fields
        self._signs.receive(message, unix_s)
        self.alarms.receive(message, unix_s)
        match message.name:
            case "LOCAL_POSITION_NED" if local_motion(message) is not None:
                self._placed_s = unix_s
                self._placed_since = True
            case "GPS_RAW_INT":
                if fields["fix_type"] >= 3:
                    self._no_fix_since_s = math.nan
                elif math.isnan(self._no_fix_since_s):
                    self._no_fix_since_s = unix_s
            case "SYS_STATUS" if fields["battery_remaining"] >= 0:
                self._reported_pct = int(fields["battery_remaining"])
            case "FENCE_STATUS":
                self._fence = bool(fields["breach_status"])
            case "STATUSTEXT" if self._behaviour.failsafe.cause(str(fields["text"])) is FailsafeCause.FENCE:
                self._fence = True  # PX4 reports a breach in no other way

    def look(
        self, unix_s: float, *, usable: bool = True, ours: bool = False, place: Place = UNKNOWN_PLACE
    ) -> list[Incident]:
        """Return the new incidents at `unix_s`; each is reported once, a low battery with every percent.

        `usable`: the vehicle is near its planned position. `ours`: a failsafe of now comes from a standstill of this
        program.

        A message since the last check counts as received now: in a burst of messages, time on board passes faster than
        it is read.
        """
        if self._heard_since:
            self._heard_s = max(self._heard_s, unix_s)
        if self._placed_since:
            self._placed_s = max(self._placed_s, unix_s)
        self._heard_since = self._placed_since = False
        found = self._silence(unix_s, near=usable)
        obeys = self._signs.mode is None or self._signs.mode in self.obeys
        found += [Incident(IncidentKind.ALARM, self.sysid, unix_s, w) for w in self.alarms.news(unix_s, obeys=obeys)]
        if not math.isnan(self._no_fix_since_s):
            place = place._replace(sure_m=math.inf)  # its height is not known: one that lands and disarms has landed
        if self.alarms.falls(place):
            found.append(Incident(IncidentKind.MOTORS_STOPPED, self.sysid, unix_s))
        if self._silent or self._lost or self.alarms.stopped:
            return found
        found += self._fix(unix_s)
        found += self._battery(unix_s, obeys=obeys)
        left = self._mode_left(unix_s, ours=ours)
        if self._fence and not self._fence_reported and not any(one.kind is IncidentKind.FAILSAFE for one in left):
            found.append(Incident(IncidentKind.FENCE, self.sysid, unix_s))
        self._fence_reported = self._fence
        return found + left

    def _mode_left(self, unix_s: float, *, ours: bool) -> list[Incident]:
        mode = self._signs.mode
        if mode is None or mode in self.obeys:
            if mode is not None:
                self._tolerated = None
                self._signs.settle()
            return []
        if mode == self._tolerated:
            return []
        taken = self._signs.origin_of_change(unix_s)
        if taken is None:
            return []
        name = f"now in {self._behaviour.mode_name(mode)}"
        if taken is ModeOrigin.PILOT:
            return [Incident(IncidentKind.MODE_LEFT, self.sysid, unix_s, name)]
        cause = self._signs.cause
        able = cause is not FailsafeCause.POSITION and (ours or mode != self._behaviour.land)
        able = able and math.isnan(self._no_fix_since_s)
        ours = ours and cause is not FailsafeCause.BATTERY
        return [
            Incident(
                IncidentKind.FAILSAFE,
                self.sysid,
                unix_s,
                f"{name}, cause: {cause}",
                takeable=able,
                ours=ours,
                cause=cause,
            )
        ]

    def _battery(self, unix_s: float, *, obeys: bool) -> list[Incident]:
        left_pct, limits = self.remaining_pct, self._limits
        if left_pct is None or left_pct > limits.battery_low_pct or left_pct >= self._battery_reported_pct:
            return []
        alarmed = left_pct == self.alarms.most_pct
        if alarmed and self.alarms.awaits_failsafe(unix_s):
            return []
        self._battery_reported_pct = left_pct
        if alarmed and not obeys:
            return []  # the failsafe that took over is the incident
        critical = left_pct <= limits.battery_critical_pct
        kind = IncidentKind.BATTERY_CRITICAL if critical else IncidentKind.BATTERY_LOW
        said = f"the vehicle says: {self.alarms.battery_text}" if alarmed else f"{left_pct} % left"
        return [Incident(kind, self.sysid, unix_s, said)]

    def _silence(self, unix_s: float, *, near: bool) -> list[Incident]:
        silent_s = unix_s - self._heard_s
        if silent_s <= self._limits.link_lost_s:
            if not (self._silent or self._lost) or unix_s - self._placed_s > self._limits.link_lost_s:
                return []  # a link is back with the first position
            self._silent = self._lost = False
            usable = near and (self._signs.mode is None or self._signs.mode in self.obeys)
            return [Incident(IncidentKind.LINK_BACK, self.sysid, unix_s, usable=usable)]
        if silent_s > self._limits.vehicle_lost_s and not self._lost:
            self._silent = self._lost = True
            return [Incident(IncidentKind.VEHICLE_LOST, self.sysid, unix_s, f"silent for {silent_s:.1f} s")]
        if not self._silent:
            self._silent = True
            return [Incident(IncidentKind.LINK_LOST, self.sysid, unix_s, f"silent for {silent_s:.1f} s")]
        return []

    def _fix(self, unix_s: float) -> list[Incident]:
        if math.isnan(self._no_fix_since_s):
            reported, self._no_fix_reported = self._no_fix_reported, 0
            return [Incident(IncidentKind.GNSS_BACK, self.sysid, unix_s)] if reported else []
        if not self._no_fix_reported:
            self._no_fix_reported = 1
            return [Incident(IncidentKind.GNSS_LOST, self.sysid, unix_s)]
        gone_s = unix_s - self._no_fix_since_s
        if self._no_fix_reported == 1 and gone_s > self._limits.gnss_gone_s:
            self._no_fix_reported = 2
            return [Incident(IncidentKind.GNSS_GONE, self.sysid, unix_s, f"no fix for {gone_s:.1f} s")]
        return []
