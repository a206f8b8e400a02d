"""From power-on to ready: what a vehicle can do already, and what it has to say on the way.

Knows: the stages of its personality. Does not know: filters and receivers (whether the estimate is healthy is an
argument), modes.

The last stage waits for the filter however long it takes; all others come by the clock.
"""

from __future__ import annotations

import math

from gcs.mavlink import Severity
from sim_bridge.autopilot.events import Placed, Said, Voice
from sim_bridge.personality import Boot, Milestone

_NOTHING: frozenset[Milestone] = frozenset()


class Readiness:
    """`faults` are what arming is refused for at this stage."""

    def __init__(self, boot: Boot, voice: Voice) -> None:
        self._voice = voice
        self._pace = boot.pace
        self._ahead = list(reversed(boot.stages))
        self._reached: set[Milestone] = set()
        self._on_s = math.nan  # when it was switched on
        self.faults: tuple[str, ...] = ()

    def reached(self, milestone: Milestone) -> bool:
        """Whether the vehicle has come so far."""
        return milestone in self._reached

    @property
    def ready(self) -> bool:
        """Whether the position can be flown on."""
        return Milestone.READY in self._reached

    def step(self, t_s: float, healthy: bool, ground_alt_m: float) -> frozenset[Milestone]:
        """Go on to `t_s`; the milestones that were reached now."""
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
                self._voice.tell(Placed())
            self._voice.tell(*(Said(Severity.INFO, text.format(alt_m=ground_alt_m)) for text in stage.texts))
        return new
