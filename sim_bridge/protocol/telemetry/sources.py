"""What every message is built from.

Knows: the parts. Does not know: messages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs.link.wire.message import Message
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.failsafe import Failsafe
from sim_bridge.personality import Milestone, Personality
from sim_bridge.protocol.telemetry.instruments import Instruments


@dataclass(frozen=True)
class Sources:
    """One vehicle's parts that tell anything."""

    instruments: Instruments
    autopilot: EmulatedAutopilot
    failsafe: Failsafe
    personality: Personality

    def reached(self, milestone: Milestone) -> bool:
        """Whether the vehicle has come so far on the way to being ready."""
        return self.autopilot.readiness.reached(milestone)


Builder = Callable[[Sources], Message | None]  # None: nothing to tell yet
