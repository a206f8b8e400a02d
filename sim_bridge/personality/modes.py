"""Flight modes: number, name and intent."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property

from gcs.mavlink import ModeFlag


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
