"""Failsafes as tables: which parameter says what happens, and how an autopilot reads its values.

Knows: kinds of failsafe. Does not know: any autopilot's parameters, nor how a vehicle notices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

from sim_bridge.personality.modes import Intent
from sim_bridge.personality.wording import Note


class Setting(Enum):
    """What parameters decide; the unit stands in the name, whatever unit the parameter itself has."""

    STREAM_TIMEOUT_S = auto()
    STREAM_LOSS_ACTION = auto()
    CRUISE_MPS = auto()
    CLIMB_MPS = auto()
    DESCEND_MPS = auto()
    TAKEOFF_MPS = auto()  # where it has a speed of its own
    LAND_MPS = auto()
    CRAWL_MPS = auto()  # right above the ground
    RETURN_HEIGHT_M = auto()
    ARRIVE_M = auto()  # nearer than that counts as over the place where it lands
    RETURN_WAIT_S = auto()
    TAKEOFF_HEIGHT_M = auto()
    AUTO_OPTIONS = auto()  # bits: 1 can be armed in a mission mode, 2 takes off then without more ado
    GROUND_STATION = auto()  # system id of the one that counts
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


Actions = Mapping[int, Intent]  # a parameter's value -> what the vehicle then does; others: it only says so


@dataclass(frozen=True)
class LinkFailsafe:
    """The ground station's heartbeat stays away."""

    actions: Actions
    only_ours: bool  # one ground station counts, by its system id
    off: int = 0  # the action value that switches the failsafe off


@dataclass(frozen=True)
class BatteryFailsafe:
    """One level of the battery; a setting that the autopilot does not have counts as never reached."""

    note: Note
    actions: Actions
    action: Setting | None = None
    volt: Setting | None = None
    left: Setting | None = None
    share: Setting | None = None


@dataclass(frozen=True)
class FenceFailsafe:
    """The vehicle leaves where it may be."""

    actions: Actions
    one_area_suffices: bool  # inside one of several areas is inside
    off: int | None = None  # the action value that switches the fence off; None: FENCE_ENABLED does


@dataclass(frozen=True)
class EstimateFailsafe:
    """The filter does not know where the vehicle is; without a setting it does `always` the same."""

    patience_s: float  # longer than a filter needs to believe a receiver that was moved
    actions: Actions
    action: Setting | None = None
    always: Intent | None = None


@dataclass(frozen=True)
class FailsafeSettings:
    """All failsafes of one autopilot."""

    link: LinkFailsafe
    battery: tuple[BatteryFailsafe, ...]  # from the mildest to the worst
    battery_patience_s: float  # below a level for so long before it counts
    fence: FenceFailsafe
    stream: Actions  # setpoints stop coming
    estimate: EstimateFailsafe
