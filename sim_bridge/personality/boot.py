"""From power-on to ready: what an autopilot goes through, and when.

Knows: stages, each a moment with what it says and what it makes possible. Does not know: which autopilot, filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from gcs.mavlink import MavState


class Milestone(Enum):
    """What a vehicle can do from some stage on."""

    RUNNING = auto()  # set up: HEARTBEAT says so
    SPEAKING = auto()  # what it has to say goes out; until then it is kept
    FIXED = auto()  # its receiver has a fix: it tells positions
    PLACED = auto()  # origin and home are known
    LOCATED = auto()  # it knows where it is
    CHECKED = auto()  # SYS_STATUS calls it ready
    READY = auto()  # its position can be flown on


@dataclass(frozen=True)
class Stage:
    """A moment on the way, in seconds after power-on.

    `texts` are said then, with {alt_m} for the height of the ground; `faults` are what arming is refused for from
    then on.
    """

    after_s: float
    milestones: frozenset[Milestone] = frozenset()
    texts: tuple[str, ...] = ()
    faults: tuple[str, ...] | None = None  # None: as before


@dataclass(frozen=True)
class Boot:
    """All stages in order. `pace` shortens the way; nobody learns anything from waiting for a receiver's start."""

    stages: tuple[Stage, ...]
    starting: MavState  # HEARTBEAT.system_status before RUNNING
    restarts_mode: bool  # a mode set before RUNNING is forgotten
    pace: float = 1.0

    def at_s(self, milestone: Milestone) -> float:
        """When a milestone is reached, in seconds after power-on."""
        return self.pace * next(stage.after_s for stage in self.stages if milestone in stage.milestones)
