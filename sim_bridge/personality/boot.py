"""The start-up of an autopilot as a table: stages from power-on to ready."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from gcs.mavlink import MavState


class Milestone(Enum):
    """What a vehicle can do from a certain stage on."""

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
