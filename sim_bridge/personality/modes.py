"""Flight modes: their numbers, and what they are for.

Knows: that a mode has a number and an intent. Does not know: any autopilot's numbers, nor flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property

from gcs.mavlink import ModeFlag


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
    needs_position: bool = True  # cannot be armed in before the position is known


@dataclass(frozen=True)
class Modes:
    """The modes that can be set. Where several serve one intent, the first is what commands mean by it."""

    known: tuple[Mode, ...]
    at_boot: int
    two_part: bool = False  # DO_SET_MODE names main and sub mode, each in a parameter of its own
    returns_after_disarming: bool = False  # to the last mode that could be armed in
    streamed: int = 0  # ModeFlag, shown too in a guided mode, once setpoints came
    act_on_ground: bool = False  # an armed vehicle takes off when it is put into a mode that flies

    @cached_property
    def _by_number(self) -> dict[int, Mode]:
        return {mode.number: mode for mode in self.known}

    def numbered(self, number: int) -> Mode | None:
        """The mode of a HEARTBEAT.custom_mode."""
        return self._by_number.get(number)

    def of(self, intent: Intent) -> Mode | None:
        """The mode for `intent`, where the autopilot has one."""
        return next((mode for mode in self.known if mode.intent is intent), None)
