"""The columns of a personality: everything in which one make of autopilot differs from another.

Knows: what can differ, and in which unit. Does not know: any autopilot's values, nor how they are used.
What differs is a value here, never an `if` elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from gcs.autopilots.traits import Autopilot
from sim_bridge.personality.boot import Boot
from sim_bridge.personality.failsafe_settings import FailsafeSettings, Setting
from sim_bridge.personality.flight_traits import (
    ArmingTraits,
    FlightTraits,
    HealthTraits,
    ReplyTraits,
    ReportTraits,
    StreamingTraits,
    StreamTraits,
)
from sim_bridge.personality.link_traits import LinkTraits, ParamTraits
from sim_bridge.personality.modes import Modes
from sim_bridge.personality.wording import Words
from sim_bridge.protocol.missions.transfer_traits import MissionTraits


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
    tells_uid: bool  # AUTOPILOT_VERSION.uid is not 0; uid2 is always told
    vtol_state: int  # EXTENDED_SYS_STATE's, of a vehicle that is no VTOL


@dataclass(frozen=True)
class Personality:
    """Habits of one autopilot."""

    identity: Identity
    boot: Boot
    modes: Modes
    arming: ArmingTraits
    flight: FlightTraits
    streaming: StreamingTraits
    reports: ReportTraits
    replies: ReplyTraits
    streams: StreamTraits
    health: HealthTraits
    guards: FailsafeSettings
    words: Words
    missions: MissionTraits
    params: tuple[Param, ...]
    param_habits: ParamTraits
    link: LinkTraits

    @property
    def name(self) -> str:
        """As scenarios and the command line name it."""
        return self.identity.autopilot.key

    def booting_for_real(self) -> Personality:
        """The same, as long on the way to being ready as the original."""
        return replace(self, boot=replace(self.boot, pace=1.0))
