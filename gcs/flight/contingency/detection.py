"""Detects incidents in one vehicle's messages: silence, no fix, low battery, fence, a mode that was not ordered.

Time is an argument, in the fleet's common time, so that it passes as fast as emulated vehicles fly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from gcs.autopilots.columns import FlightBehaviour
from gcs.link.wire.message import Message


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
    MODE_LEFT = "mode left"
    CONFLICT = "separation in danger"


@dataclass(frozen=True)
class Incident:
    """One incident of a vehicle at a time of the fleet."""

    kind: IncidentKind
    sysid: int
    unix_s: float
    detail: str = ""
    other: int | None = None  # of a conflict
    in_s: float = 0.0  # of a conflict
    usable: bool = True  # of a link that is back: the vehicle is in its place, in the ordered mode


@dataclass(frozen=True)
class DetectionLimits:
    """When a condition becomes an incident, in seconds of the vehicles' time and percent of a full battery."""

    link_lost_s: float = 3.0
    vehicle_lost_s: float = 10.0
    gnss_gone_s: float = 8.0
    battery_low_pct: int = 20
    battery_critical_pct: int = 10


LIMITS = DetectionLimits()
DETECTED = {  # how each incident is detected, for the documents
    IncidentKind.LINK_LOST: f"no message for {LIMITS.link_lost_s:g} s",
    IncidentKind.LINK_BACK: "a position after a silence",
    IncidentKind.VEHICLE_LOST: f"no message for {LIMITS.vehicle_lost_s:g} s",
    IncidentKind.GNSS_LOST: "GPS_RAW_INT: a fix below 3D",
    IncidentKind.GNSS_BACK: "GPS_RAW_INT: a 3D fix again",
    IncidentKind.GNSS_GONE: f"no 3D fix for {LIMITS.gnss_gone_s:g} s",
    IncidentKind.BATTERY_LOW: f"SYS_STATUS: {LIMITS.battery_low_pct} % or less left",
    IncidentKind.BATTERY_CRITICAL: f"SYS_STATUS: {LIMITS.battery_critical_pct} % or less left",
    IncidentKind.FENCE: "FENCE_STATUS, or PX4's STATUSTEXT",
    IncidentKind.MODE_LEFT: "HEARTBEAT: a mode that was not ordered",
    IncidentKind.CONFLICT: "separation below `[judge]` predicted within 3 s, three times in a row",
}


class VehicleWatch:
    """Watches one vehicle. `obeys` are the ordered modes; in any other one its autopilot or a pilot has taken over."""

    def __init__(
        self, sysid: int, behaviour: FlightBehaviour, limits: DetectionLimits, unix_s: float, obeys: frozenset[int]
    ) -> None:
        self.sysid = sysid
        self.obeys = obeys
        self.usable = True  # set from outside: whether it is near its planned position
        self._behaviour = behaviour
        self._limits = limits
        self._heard_s = unix_s
        self._silent = self._lost = False
        self._placed_s = unix_s
        self._heard_since = self._placed_since = False
        self._no_fix_since_s = math.nan
        self._no_fix_reported = 0
        self._battery_pct = 100
        self._battery_reported = 0
        self._fence, self._fence_reported = False, False
        self._mode: int | None = None
        self._mode_reported = False

    def begin(self, unix_s: float) -> None:
        """Begin to watch: silence counts from now."""
        self._heard_s = self._placed_s = unix_s

    def receive(self, message: Message, unix_s: float) -> None:
        """Take in a message of the vehicle; any message ends a silence."""
        self._heard_s = max(self._heard_s, unix_s)
        self._heard_since = True
        fields = message.fields
        match message.name:
            case "LOCAL_POSITION_NED":
                self._placed_s = unix_s
                self._placed_since = True
            case "HEARTBEAT":
                self._mode = int(fields["custom_mode"])
            case "GPS_RAW_INT":
                if fields["fix_type"] >= 3:
                    self._no_fix_since_s = math.nan
                elif math.isnan(self._no_fix_since_s):
                    self._no_fix_since_s = unix_s
            case "SYS_STATUS" if fields["battery_remaining"] >= 0:
                self._battery_pct = int(fields["battery_remaining"])
            case "FENCE_STATUS":
                self._fence = bool(fields["breach_status"])
            case "STATUSTEXT" if "geofence violation" in str(fields["text"]).lower():
                self._fence = True  # PX4 reports a breach in no other way

    def look(self, unix_s: float) -> list[Incident]:
        """Return the new incidents at `unix_s`; each is reported once.

        A message since the last check counts as received now: in a burst of messages, time on board passes faster than
        it is read.
        """
        if self._heard_since:
            self._heard_s = max(self._heard_s, unix_s)
        if self._placed_since:
            self._placed_s = max(self._placed_s, unix_s)
        self._heard_since = self._placed_since = False
        found = self._silence(unix_s)
        if self._silent or self._lost:
            return found
        found += self._fix(unix_s)
        for level, (kind, limit) in enumerate(
            (
                (IncidentKind.BATTERY_LOW, self._limits.battery_low_pct),
                (IncidentKind.BATTERY_CRITICAL, self._limits.battery_critical_pct),
            ),
            start=1,
        ):
            if self._battery_pct <= limit and self._battery_reported < level:
                self._battery_reported = level
                found.append(Incident(kind, self.sysid, unix_s, f"{self._battery_pct} % left"))
        if self._fence and not self._fence_reported:
            found.append(Incident(IncidentKind.FENCE, self.sysid, unix_s))
        self._fence_reported = self._fence
        if self._mode is not None and self._mode not in self.obeys:
            if not self._mode_reported:
                name = self._behaviour.mode_name(self._mode)
                found.append(Incident(IncidentKind.MODE_LEFT, self.sysid, unix_s, f"now in {name}"))
            self._mode_reported = True
        else:
            self._mode_reported = False
        return found

    def _silence(self, unix_s: float) -> list[Incident]:
        silent_s = unix_s - self._heard_s
        if silent_s <= self._limits.link_lost_s:
            if not (self._silent or self._lost) or unix_s - self._placed_s > self._limits.link_lost_s:
                return []  # a link is back with the first position
            self._silent = self._lost = False
            usable = self.usable and (self._mode is None or self._mode in self.obeys)
            return [Incident(IncidentKind.LINK_BACK, self.sysid, unix_s, usable=usable)]
        if silent_s > self._limits.vehicle_lost_s and not self._lost:
            self._lost = True
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
