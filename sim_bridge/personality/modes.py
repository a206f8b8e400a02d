"""The parts of a personality: flight modes, start-up stages, occasions for texts."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property

from gcs.mavlink import MavState, ModeFlag, Severity


class Intent(Enum):
    """The purpose of a mode, whatever its number."""

    MANUAL = auto()  # flown by RC, which no emulated vehicle has
    HOLD = auto()  # hold position in the air
    GUIDED = auto()  # follow setpoints of a ground station
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
    needs_position: bool = True  # cannot be armed in before the position is known


@dataclass(frozen=True)
class Modes:
    """The modes that can be set. Where several have one intent, commands use the first."""

    known: tuple[Mode, ...]
    at_boot: int
    two_part: bool = False  # DO_SET_MODE has the main and the sub mode in separate parameters
    returns_after_disarming: bool = False  # to the last mode in which it can be armed
    streamed: int = 0  # ModeFlag, added in a guided mode once setpoints have arrived
    act_on_ground: bool = False  # an armed vehicle takes off when it enters a mode that flies

    @cached_property
    def _by_number(self) -> dict[int, Mode]:
        return {mode.number: mode for mode in self.known}

    def numbered(self, number: int) -> Mode | None:
        """Return the mode of a HEARTBEAT.custom_mode, or None."""
        return self._by_number.get(number)

    def of(self, intent: Intent) -> Mode | None:
        """Return the mode that commands use for `intent`, or None."""
        return next((mode for mode in self.known if mode.intent is intent), None)


class Milestone(Enum):
    """What a vehicle can do once it has reached a stage of its start-up or flight."""

    RUNNING = auto()  # set up, as HEARTBEAT shows
    SPEAKING = auto()  # sends STATUSTEXTs; until then they are queued
    FIXED = auto()  # its receiver has a fix: it sends positions
    PLACED = auto()  # origin and home are known
    LOCATED = auto()  # its filter knows the position
    CHECKED = auto()  # SYS_STATUS shows all checks as passed
    READY = auto()  # its position estimate is good enough to fly on


@dataclass(frozen=True)
class Stage:
    """A stage of the start-up, timed in seconds after power-on.

    `texts` are sent then, with {alt_m} for the altitude of the ground. `faults` are the reasons why arming is refused
    from then on.
    """

    after_s: float
    milestones: frozenset[Milestone] = frozenset()
    texts: tuple[str, ...] = ()
    faults: tuple[str, ...] | None = None  # None: as before


@dataclass(frozen=True)
class Boot:
    """All stages in order. `pace` shortens them: the slow start of a receiver is of no use to a ground station."""

    stages: tuple[Stage, ...]
    starting: MavState  # HEARTBEAT.system_status before RUNNING
    restarts_mode: bool  # a mode set before RUNNING is forgotten
    pace: float = 1.0

    def at_s(self, milestone: Milestone) -> float:
        """Return when a milestone is reached, in seconds after power-on."""
        return self.pace * next(stage.after_s for stage in self.stages if milestone in stage.milestones)


class Note(Enum):
    """An occasion for a STATUSTEXT; the comment has the values its text may quote."""

    ARMED = auto()
    ARMED_FOR_MISSION = auto()
    DISARMED = auto()
    DISARMED_IDLE = auto()
    DISARMED_LANDED = auto()
    ARM_REFUSED = auto()  # {reason}
    CHECKS_FAIL = auto()  # {reason}: of a periodic check, without an attempt to arm
    SENSOR_FAILS = auto()  # {reason}: the same, of a sensor
    DISARM_REFUSED = auto()
    MODE_UNKNOWN = auto()  # {mode}: number
    MODE_REFUSED = auto()  # {mode}: name
    MISSION_REFUSED = auto()
    STREAM_UNKNOWN = auto()  # {number}
    LIFTED_OFF = auto()
    LANDED = auto()
    MISSION_BEGINS = auto()
    MISSION_CLIMBS = auto()  # {height_m}
    MISSION_ENDS = auto()  # landed
    ITEM_BEGINS = auto()  # {seq}, {name}
    DELAY_BEGINS = auto()  # {seconds}
    WAYPOINT_REACHED = auto()  # {seq}
    RETURN_BEGINS = auto()  # {alt_m}, {height_m}
    RETURN_LANDS = auto()
    FAILSAFE = auto()
    LINK_LOST = auto()  # {action}
    LINK_FOUND = auto()
    BATTERY_LOW = auto()  # {volt}, {mAh}
    BATTERY_CRITICAL = auto()
    BATTERY_EMERGENCY = auto()
    PLACE_LOST = auto()  # {action}
    FENCE_BREACHED = auto()  # {fence}


Words = Mapping[Note, tuple[Severity, str]]
