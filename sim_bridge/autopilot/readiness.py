"""The start-up of a vehicle, from power-on to ready for flight, stage by stage.

The last stage also waits until the filter is healthy; all others follow the clock.
"""

from __future__ import annotations

import math

from gcs.mavlink import Severity
from sim_bridge.autopilot.events import EventQueue, Placed, Said
from sim_bridge.personality import Boot, Milestone

_NOTHING: frozenset[Milestone] = frozenset()


class Readiness:
    """`faults` are the reasons why arming is refused at this stage."""

    def __init__(self, boot: Boot, event_queue: EventQueue) -> None:
        self._event_queue = event_queue
        self._pace = boot.pace
        self._ahead = list(reversed(boot.stages))
        self._reached: set[Milestone] = set()
        self._on_s = math.nan  # time of power-on
        self.faults: tuple[str, ...] = ()

    def reached(self, milestone: Milestone) -> bool:
        """Whether this milestone has been reached."""
        return milestone in self._reached

    @property
    def ready(self) -> bool:
        """Whether the position estimate is good enough to fly on."""
        return Milestone.READY in self._reached

    def step(self, t_s: float, healthy: bool, ground_alt_m: float) -> frozenset[Milestone]:
        """Advance to `t_s`; return the milestones reached in this step."""
        if not self._ahead:
            return _NOTHING
        if math.isnan(self._on_s):
            self._on_s = t_s
        new: frozenset[Milestone] = _NOTHING
        while self._ahead and t_s - self._on_s >= self._pace * self._ahead[-1].after_s:
            if Milestone.READY in self._ahead[-1].milestones and not healthy:
                break
            stage = self._ahead.pop()
            new |= stage.milestones
            self._reached |= stage.milestones
            self.faults = self.faults if stage.faults is None else stage.faults
            if Milestone.PLACED in stage.milestones:
                self._event_queue.add(Placed())
            self._event_queue.add(*(Said(Severity.INFO, text.format(alt_m=ground_alt_m)) for text in stage.texts))
        return new
