"""What differs between autopilots in arming, flight, setpoint streams, replies and telemetry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.mavlink import MavResult
from sim_bridge.personality.boot import Milestone
from sim_bridge.personality.modes import Intent


@dataclass(frozen=True)
class ArmingTraits:
    """Arming and disarming."""

    idle_disarm_s: float
    spool_up_s: float  # from arming until motors can lift
    has_sticks: bool  # a centred RC is present: modes that need it can be armed in
    status_shows_armable: bool  # system_status and the PREARM bit depend on the present mode


@dataclass(frozen=True)
class FlightTraits:
    """Take-off, landing, missions and return."""

    brakes_mps2: float | None  # above LAND_LOW_M, until it descends at LAND_MPS; None: from LAND_HIGH_M to LAND_LOW_M
    crawl_below_m: float  # above home: below this height it descends at CRAWL_MPS
    landed_after_s: float  # duration of ground contact before it counts as landed
    disarm_after_s: float  # from the landing until it disarms
    takeoff_share: float  # take-off speed as a share of the climb speed
    liftoff_pause_s: float  # just above the ground, before a take-off climbs
    takeoff_above_sea: bool  # the altitude of NAV_TAKEOFF is AMSL, not above home
    takeoff_in_guided: bool  # NAV_TAKEOFF needs an armed vehicle in a guided mode; else take-off is a mode
    mission_start_arms: bool  # MISSION_START also arms
    return_cone: bool  # close to home the return altitude is limited to the distance from home
    reposition_in: Intent  # the mode for DO_REPOSITION
    sinks_without_sticks: bool  # in manual modes it descends where it is


@dataclass(frozen=True)
class StreamingTraits:
    """Setpoint streams."""

    from_ground: bool  # a setpoint above the ground starts the take-off of an armed vehicle
    proof_s: float  # duration of a stream before a guided mode accepts it; 0: none required
    extrapolates_s: float | None  # duration of extrapolation of the last setpoint; None: STREAM_TIMEOUT_S
    comes_back: bool  # ... then it overshoots, and comes back to where it was at the end of that time


@dataclass(frozen=True)
class ReportTraits:
    """MISSION_CURRENT and MISSION_ITEM_REACHED."""

    repeats: int  # how often MISSION_ITEM_REACHED is repeated ...
    repeat_s: float  # ... at this interval
    reports_landing: bool  # NAV_LAND is reported as reached when the descent begins
    starts_over: bool  # after landing the first item is current again
    empty_total: int  # MISSION_CURRENT.total without a mission
    counts_home: bool
    mode_elsewhere: int  # MISSION_CURRENT.mission_mode outside missions
    counts_manoeuvres: bool  # a take-off or landing by command counts as a completed mission
    item_names: Mapping[int, str]


@dataclass(frozen=True)
class ReplyTraits:
    """COMMAND_ACK, and the messages with it."""

    refused: MavResult  # arming, disarming, take-off
    unknown_mode: MavResult  # ACCEPTED: without any effect
    unknown_stream: MavResult
    unknown_message: MavResult
    nothing_newer: MavResult  # a request for a message whose contents were sent already
    unsupported: frozenset[int]  # commands that only the other autopilots support
    formats: bool  # supports STORAGE_FORMAT, which takes time
    mode_acks: int  # number of acknowledgements of a mode change
    message_first: bool  # a requested message comes before the acknowledgement
    set_mode_command: int  # the command in the acknowledgement of SET_MODE
    heartbeat_on_change: bool  # sends HEARTBEAT at once after a mode change
    announces_home: bool  # sends origin and home when they change
    any_component: bool  # answers messages for other components of the vehicle
    waits_for_contact: bool  # sends only HEARTBEAT and telemetry until a ground station has sent a message
    numbered_texts: bool  # every STATUSTEXT has an id, not only those in chunks


@dataclass(frozen=True)
class StreamTraits:
    """The default message rates, and the rates that can be set."""

    unasked_hz: Mapping[int, float]  # by message number
    default_hz: float  # the rate of interval 0; 0: none
    fixed: frozenset[int]  # messages whose rate cannot be changed
    unsent: frozenset[int]  # messages that this autopilot does not have
    mute: frozenset[int]  # messages it never sends although it accepts a rate for them
    groups: Mapping[int, frozenset[int]]  # the groups of REQUEST_DATA_STREAM
    # How often the contents of a message change, s: a request is denied while they are those of the last message.
    contents_s: Mapping[int, float]
    fast_share: float  # the real share of a requested rate above 5 Hz
    local_from: Milestone  # first milestone with LOCAL_POSITION_NED
    global_from: Milestone  # first milestone with GLOBAL_POSITION_INT; without a position before PLACED
    targets_in_guided_only: bool  # POSITION_TARGET_LOCAL_NED
    home_has_attitude: bool  # HOME_POSITION.q is not NaN
    reports_rtk: bool  # the fix type of GPS_RAW_INT shows an RTK receiver
    reports_airspeed: bool  # VFR_HUD.airspeed is the ground speed; else NaN


@dataclass(frozen=True)
class HealthTraits:
    """The three bit fields of SYS_STATUS when all is well, and the EKF flags before and after READY."""

    present: int
    enabled: int
    healthy: int
    gnss: int  # the bit of the GNSS receiver
    before_ready: int  # flags of EKF_STATUS_REPORT or ESTIMATOR_STATUS
    ready: int
