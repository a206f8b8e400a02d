"""How autopilots behave between the messages: arming, flying, following, answering, telling.

Knows: what can differ, and in which unit. Does not know: any autopilot's values, nor how they are used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.mavlink import MavResult
from sim_bridge.personality.boot import Milestone
from sim_bridge.personality.modes import Intent


@dataclass(frozen=True)
class ArmingTraits:
    """To turning motors, and back."""

    idle_disarm_s: float
    spool_up_s: float  # from arming until motors can lift
    has_sticks: bool  # a pilot's sticks are there, at rest: modes that need them can be armed in
    status_tells: bool  # system_status and the PREARM bit tell whether it can be armed in this very mode


@dataclass(frozen=True)
class FlightTraits:
    """In the air."""

    slow_below_m: float  # above home: there it descends at LAND_MPS ...
    crawl_below_m: float  # ... and there at CRAWL_MPS
    landed_after_s: float  # contact with the ground before it counts as landed
    disarm_after_s: float  # landed before the motors stop
    takeoff_share: float  # of the speed for climbing that a take-off makes use of
    floats_s: float  # just off the ground, before a take-off climbs
    takeoff_above_sea: bool  # NAV_TAKEOFF's height is AMSL, not above home
    takeoff_in_guided: bool  # NAV_TAKEOFF wants an armed vehicle in a guided mode; else it is a mode of its own
    mission_start_arms: bool  # MISSION_START arms, too
    return_cone: bool  # close to home it returns no higher than it is far
    reposition_in: Intent  # the mode for DO_REPOSITION
    sinks_without_sticks: bool  # in modes for a pilot's sticks it comes down where it is


@dataclass(frozen=True)
class StreamingTraits:
    """Setpoints that come one after the other."""

    from_ground: bool  # a setpoint in the air lifts a vehicle that stands armed
    proof_s: float  # a stream runs for so long before it is believed; 0 where none is asked for
    coasts_s: float | None  # the last setpoint is flown on for so long; None: as STREAM_TIMEOUT_S says
    comes_back: bool  # ... and then it stands where it was when that time was over, which it first overshoots


@dataclass(frozen=True)
class ReportTraits:
    """MISSION_CURRENT and MISSION_ITEM_REACHED."""

    repeats: int  # MISSION_ITEM_REACHED is said again so often ...
    repeat_s: float  # ... in this interval
    tells_landing: bool  # NAV_LAND counts as reached when the descent begins
    starts_over: bool  # after landing the current item is the first again
    empty_total: int  # MISSION_CURRENT.total without a mission
    counts_home: bool
    mode_elsewhere: int  # MISSION_CURRENT.mission_mode outside missions
    counts_manoeuvres: bool  # a take-off, a landing counts as a mission that is flown to its end
    item_names: Mapping[int, str]


@dataclass(frozen=True)
class ReplyTraits:
    """COMMAND_ACK, and the messages around it."""

    refused: MavResult  # arming, disarming, take-off
    unknown_mode: MavResult  # ACCEPTED means: and nothing happens
    unknown_stream: MavResult
    unknown_message: MavResult
    unsupported: frozenset[int]  # commands it does not know although others do
    formats: bool  # STORAGE_FORMAT, which takes its time
    mode_acks: int  # times a change of mode is acknowledged
    message_first: bool  # the message asked for comes before the acknowledgement
    set_mode_command: int  # the command that SET_MODE's acknowledgement names
    heartbeat_on_change: bool  # HEARTBEAT follows a change of mode at once
    announces_home: bool  # origin and home are told when they change
    any_component: bool  # answers messages for components that are not there
    waits_to_be_heard: bool  # says nothing but telemetry until a ground station has said something
    numbered_texts: bool  # every STATUSTEXT has an id, not only those in chunks


@dataclass(frozen=True)
class StreamTraits:
    """What is told without being asked, and what can be asked for."""

    unasked_hz: Mapping[int, float]  # by message number
    default_hz: float  # what an interval of 0 asks for; 0: nothing
    fixed: frozenset[int]  # whose rate cannot be changed
    unsent: frozenset[int]  # not of this autopilot
    mute: frozenset[int]  # ... although it takes a rate for them
    groups: Mapping[int, frozenset[int]]  # REQUEST_DATA_STREAM's groups
    fast_share: float  # of a rate above 5 Hz that is asked for and really given
    local_from: Milestone  # when LOCAL_POSITION_NED begins
    global_from: Milestone  # when GLOBAL_POSITION_INT begins; without a place before PLACED
    targets_in_guided_only: bool  # POSITION_TARGET_LOCAL_NED
    home_has_attitude: bool  # HOME_POSITION.q is more than NaN
    tells_rtk: bool  # GPS_RAW_INT's fix type tells a receiver that fixes to centimetres
    tells_airspeed: bool  # VFR_HUD, although nobody measures it


@dataclass(frozen=True)
class HealthTraits:
    """SYS_STATUS's three bit fields when all is well, and EKF flags on the way there."""

    present: int
    enabled: int
    healthy: int
    gnss: int  # the bit of the receiver
    before_ready: int  # EKF_STATUS_REPORT's or ESTIMATOR_STATUS's flags
    ready: int
