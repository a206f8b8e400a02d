"""The columns of a personality: all that differs between autopilots is a value here, never an `if` elsewhere."""

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
    """One parameter. A value outside `low` to `high` is stored unchanged, and used as the nearer bound."""

    name: str
    value: float
    kind: int  # MAV_PARAM_TYPE
    low: float = -math.inf
    high: float = math.inf
    sets: Setting | None = None
    unit: float = 1.0  # of the parameter, in the unit of the setting


@dataclass(frozen=True)
class Identity:
    """What the vehicle reports about its autopilot."""

    autopilot: Autopilot
    version: int  # AUTOPILOT_VERSION.flight_sw_version: major, minor, patch, type
    capabilities: int
    sends_uid: bool  # AUTOPILOT_VERSION.uid is not 0; uid2 is always sent
    vtol_state: int  # of EXTENDED_SYS_STATE, for a vehicle that is not a VTOL


@dataclass(frozen=True)
class Personality:
    """The traits of one autopilot."""

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
    failsafes: FailsafeSettings
    words: Words
    missions: MissionTraits
    params: tuple[Param, ...]
    param_traits: ParamTraits
    link: LinkTraits
    edition: str = ""  # the end of its name, where an autopilot is emulated in several versions

    @property
    def name(self) -> str:
        """The name in scenarios and on the command line."""
        return self.identity.autopilot.key + self.edition

    def booting_for_real(self) -> Personality:
        """Return the same personality, with the start-up time of the original."""
        return replace(self, boot=replace(self.boot, pace=1.0))
