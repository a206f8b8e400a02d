"""Failsafes as tables: which parameter sets each failsafe, and the action for each of its values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

from sim_bridge.personality.modes import Intent
from sim_bridge.personality.wording import Note


class Setting(Enum):
    """What parameters set; the unit is in the name, whatever unit the parameter has."""

    STREAM_TIMEOUT_S = auto()
    STREAM_LOSS_ACTION = auto()
    CRUISE_MPS = auto()
    CLIMB_MPS = auto()
    DESCEND_MPS = auto()
    TAKEOFF_MPS = auto()  # where take-off has a speed of its own
    LAND_MPS = auto()
    LAND_HIGH_M = auto()  # height above home from which it slows down to LAND_MPS ...
    LAND_LOW_M = auto()  # ... which it has reached at this height
    CRAWL_MPS = auto()  # just above the ground
    RETURN_HEIGHT_M = auto()
    ARRIVE_M = auto()  # within this distance the vehicle counts as above its landing point
    RETURN_WAIT_S = auto()
    TAKEOFF_HEIGHT_M = auto()
    AUTO_OPTIONS = auto()  # bits: 1 can be armed in a mission mode, 2 then takes off at once
    GROUND_STATION = auto()  # system id of the ground station that the failsafe watches
    LINK_LOSS_ACTION = auto()
    LINK_TIMEOUT_S = auto()
    BATTERY_LOW_V = auto()
    BATTERY_LOW_Ah = auto()
    BATTERY_LOW_SHARE = auto()
    BATTERY_LOW_ACTION = auto()
    BATTERY_CRITICAL_V = auto()
    BATTERY_CRITICAL_Ah = auto()
    BATTERY_CRITICAL_SHARE = auto()
    BATTERY_CRITICAL_ACTION = auto()
    BATTERY_EMERGENCY_SHARE = auto()
    FENCE_ENABLED = auto()
    FENCE_KINDS = auto()  # bits: 1 height, 2 distance from home, 4 stored polygons and circles
    FENCE_HEIGHT_M = auto()  # above home; 0 for none
    FENCE_RADIUS_M = auto()  # around home; 0 for none
    FENCE_ACTION = auto()
    ESTIMATE_ACTION = auto()


Actions = Mapping[int, Intent]  # parameter value -> action of the vehicle; other values: report only


@dataclass(frozen=True)
class LinkFailsafe:
    """The heartbeat of the ground station is missing."""

    actions: Actions
    only_ours: bool  # only the ground station with the set system id counts
    off: int = 0  # the action value that switches the failsafe off


@dataclass(frozen=True)
class BatteryFailsafe:
    """One battery level. A setting that the autopilot does not have is never reached."""

    note: Note
    actions: Actions
    action: Setting | None = None
    volt: Setting | None = None
    left: Setting | None = None
    share: Setting | None = None


@dataclass(frozen=True)
class FenceFailsafe:
    """The vehicle crosses the fence."""

    actions: Actions
    one_area_suffices: bool  # being inside one of several inclusion areas is enough
    off: int | None = None  # the action value that switches the fence off; None: FENCE_ENABLED does
    repeats_s: float = math.inf  # between its texts, as long as the vehicle is outside


@dataclass(frozen=True)
class EstimateFailsafe:
    """The filter has lost the position. Without a setting the action is `always`."""

    timeout_s: float  # longer than a filter needs to accept a shifted receiver
    actions: Actions
    action: Setting | None = None
    always: Intent | None = None


@dataclass(frozen=True)
class FailsafeSettings:
    """All failsafes of one autopilot."""

    link: LinkFailsafe
    battery: tuple[BatteryFailsafe, ...]  # from the mildest to the most severe
    battery_timeout_s: float  # duration below a level before the failsafe acts
    fence: FenceFailsafe
    stream: Actions  # the setpoint stream is lost
    estimate: EstimateFailsafe
