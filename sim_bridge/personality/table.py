"""The columns of a personality: everything in which one make of autopilot differs from another.

Knows: what can differ, and in which unit. Does not know: any autopilot's values, nor how they are used.
What differs is a value here, never an `if` elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from typing import NamedTuple

from gcs.link.dialect import Autopilot, ModeFlag
from gcs.link.mission import Timers


class Intent(Enum):
    """What a mode is for, whatever its number."""

    MANUAL = auto()  # a pilot's sticks, which no emulated vehicle has
    HOLD = auto()  # stand in the air
    GUIDED = auto()  # follow what a ground station sends
    MISSION = auto()
    TAKEOFF = auto()
    RETURN = auto()
    LAND = auto()


@dataclass(frozen=True)
class Mode:
    """One flight mode."""

    number: int  # HEARTBEAT.custom_mode
    name: str
    intent: Intent
    flags: ModeFlag  # HEARTBEAT.base_mode, ARMED apart
    armable: bool = True


@dataclass(frozen=True)
class Modes:
    """The modes that can be set. Where several serve one intent, the first is what commands mean by it."""

    known: tuple[Mode, ...]
    at_boot: int

    @cached_property
    def _by_number(self) -> dict[int, Mode]:
        return {mode.number: mode for mode in self.known}

    def numbered(self, number: int) -> Mode | None:
        """The mode of a HEARTBEAT.custom_mode."""
        return self._by_number.get(number)

    def of(self, intent: Intent) -> Mode | None:
        """The mode for `intent`, where the autopilot has one."""
        return next((mode for mode in self.known if mode.intent is intent), None)


class Setting(Enum):
    """What parameters decide; the unit stands in the name, whatever unit the parameter itself has."""

    STREAM_TIMEOUT_S = auto()
    CRUISE_MPS = auto()
    CLIMB_MPS = auto()
    DESCEND_MPS = auto()
    LAND_MPS = auto()
    RETURN_HEIGHT_M = auto()


class Param(NamedTuple):
    """One parameter; outside `low` to `high` it is stored as it is and used as the nearer bound."""

    name: str
    value: float
    kind: int  # MAV_PARAM_TYPE
    low: float = -math.inf
    high: float = math.inf
    sets: Setting | None = None
    unit: float = 1.0  # of the parameter, in the setting's unit


@dataclass(frozen=True)
class Identity:
    """Who it says it is."""

    autopilot: Autopilot
    version: int  # AUTOPILOT_VERSION.flight_sw_version: major, minor, patch, type
    capabilities: int


@dataclass(frozen=True)
class Arming:
    """From power-on to turning motors, and back."""

    prearm_after_s: float  # when SYS_STATUS calls the vehicle ready ...
    ready_after_s: float  # ... and when it can arm in fact
    idle_disarm_s: float


@dataclass(frozen=True)
class Flight:
    """In the air."""

    landed_after_s: float  # contact with the ground before it counts as landed


@dataclass(frozen=True)
class Missions:
    """Transfers of missions, fences and rally points."""

    capacity: int
    timers: Timers
    int_requests: bool  # asks for items with MISSION_REQUEST_INT
    tells_file_frames: bool  # reads items back in frames 0, 3, 10 rather than 5, 6, 11
    home_is_item_0: bool


@dataclass(frozen=True)
class Personality:
    """Habits of one autopilot."""

    name: str
    identity: Identity
    modes: Modes
    arming: Arming
    flight: Flight
    missions: Missions
    params: tuple[Param, ...]
