"""The parts of a vehicle from which telemetry messages are built."""

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
    """The parts of one vehicle that telemetry reads."""

    instruments: Instruments
    autopilot: EmulatedAutopilot
    failsafe: Failsafe
    personality: Personality

    def reached(self, milestone: Milestone) -> bool:
        """Whether the vehicle has reached this milestone of its start-up."""
        return self.autopilot.readiness.reached(milestone)


Builder = Callable[[Sources], Message | None]  # None: no data yet
