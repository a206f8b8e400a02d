"""The columns of a personality: everything that differs between emulated autopilots is a value here.

The row of an autopilot leaves out what it does not do: that is False, 0 or nothing here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from typing import NamedTuple

from gcs.autopilots.traits import Autopilot
from gcs.mavlink import Capability, MavResult
from sim_bridge.missions.transfer_traits import MissionTraits
from sim_bridge.personality.modes import Boot, Intent, Milestone, Modes, Note, Words

COMMON_CAPABILITIES = (
    Capability.MISSION_FLOAT
    | Capability.PARAM_FLOAT
    | Capability.MISSION_INT
    | Capability.COMMAND_INT
    | Capability.SET_POSITION_TARGET_LOCAL_NED
    | Capability.SET_POSITION_TARGET_GLOBAL_INT
    | Capability.MAVLINK2
    | Capability.FENCE
    | Capability.RALLY
)


class Setting(Enum):
    """What parameters set; the unit is in the name, whatever unit the parameter has."""

    STREAM_TIMEOUT_S = auto()
    STREAM_LOSS_ACTION = auto()
    CRUISE_MPS = auto()
    CLIMB_MPS = auto()
    DESCEND_MPS = auto()
    TAKEOFF_MPS = auto()  # where take-off has a speed of its own
    LAND_MPS = auto()
    LAND_HIGH_M = auto()  # height above home from which it slows down to LAND_MPS ...
    LAND_LOW_M = auto()  # ... which it has reached at this height
    CRAWL_MPS = auto()  # just above the ground
    RETURN_HEIGHT_M = auto()
    ARRIVE_M = auto()  # within this distance the vehicle counts as above its landing point
    RETURN_WAIT_S = auto()
    TAKEOFF_HEIGHT_M = auto()
    AUTO_OPTIONS = auto()  # bits: 1 can be armed in a mission mode, 2 then takes off at once
    GROUND_STATION = auto()  # system id of the ground station that the failsafe watches
    LINK_LOSS_ACTION = auto()
    LINK_TIMEOUT_S = auto()
    BATTERY_LOW_V = auto()
    BATTERY_LOW_Ah = auto()
    BATTERY_LOW_SHARE = auto()
    BATTERY_LOW_ACTION = auto()
    BATTERY_CRITICAL_V = auto()
    BATTERY_CRITICAL_Ah = auto()
    BATTERY_CRITICAL_SHARE = auto()
    BATTERY_CRITICAL_ACTION = auto()
    BATTERY_EMERGENCY_SHARE = auto()
    FENCE_ENABLED = auto()
    FENCE_KINDS = auto()  # bits: 1 height, 2 distance from home, 4 stored polygons and circles
    FENCE_HEIGHT_M = auto()  # above home; 0 for none
    FENCE_RADIUS_M = auto()  # around home; 0 for none
    FENCE_ACTION = auto()
    ESTIMATE_ACTION = auto()


Actions = Mapping[int, Intent]  # parameter value -> action of the vehicle; other values: report only


@dataclass(frozen=True)
class BatteryFailsafe:
    """One battery level. A setting that the autopilot does not have is never reached."""

    note: Note
    actions: Actions
    action: Setting | None = None
    volt: Setting | None = None
    left: Setting | None = None
    share: Setting | None = None


@dataclass(frozen=True, kw_only=True)
class FailsafeSettings:
    """All failsafes of one autopilot."""

    link: Actions  # the heartbeat of the ground station is missing
    link_only_ours: bool = False  # only the ground station with the set system id counts
    battery: tuple[BatteryFailsafe, ...]  # from the mildest to the most severe
    battery_timeout_s: float = 0.0  # duration below a level before the failsafe acts
    low_is_critical: bool = False  # system_status is critical at a low battery, whatever is done about it
    fence: Actions
    one_area_suffices: bool = False  # being inside one of several inclusion areas is enough
    fence_off: int | None = None  # the action value that switches the fence off; None: FENCE_ENABLED does
    fence_repeats_s: float = math.inf  # between its texts, as long as the vehicle is outside
    stream: Actions = field(default_factory=dict)  # the setpoint stream is lost
    estimate: Actions | Intent  # the filter has lost the position: by ESTIMATE_ACTION, or always the same
    estimate_timeout_s: float = 6.0  # longer than a filter needs to accept a shifted receiver


class Param(NamedTuple):
    """One parameter. A value outside `low` to `high` is stored unchanged, and used as the nearer bound."""

    name: str
    value: float
    kind: int  # MAV_PARAM_TYPE
    low: float = -math.inf
    high: float = math.inf
    sets: Setting | None = None
    unit: float = 1.0  # of the parameter, in the unit of the setting


@dataclass(frozen=True, kw_only=True)
class Personality:
    """The traits of one autopilot."""

    autopilot: Autopilot
    edition: str = ""  # the end of its name, where an autopilot is emulated in several versions
    version: int  # AUTOPILOT_VERSION.flight_sw_version: major, minor, patch, type
    capabilities: int
    sends_uid: bool = False  # AUTOPILOT_VERSION.uid is not 0; uid2 is always sent
    vtol_state: int = 0  # of EXTENDED_SYS_STATE, for a vehicle that is not a VTOL
    boot: Boot
    modes: Modes
    flight: FlightTraits
    reports: ReportTraits
    replies: ReplyTraits
    streams: StreamTraits
    health: HealthTraits
    failsafes: FailsafeSettings
    words: Words
    missions: MissionTraits
    params: tuple[Param, ...]
    param_traits: ParamTraits

    @property
    def name(self) -> str:
        """The name in scenarios and on the command line."""
        return self.autopilot.key + self.edition

    def booting_for_real(self) -> Personality:
        """Return the same personality, with the start-up time of the original."""
        return replace(self, boot=replace(self.boot, pace=1.0))


@dataclass(frozen=True, kw_only=True)
class FlightTraits:
    """Arming, take-off, landing, missions, return and setpoint streams."""

    idle_disarm_s: float = 10.0
    spool_up_s: float  # from arming until motors can lift
    has_sticks: bool = False  # a centred RC is present: modes that need it can be armed in
    status_shows_armable: bool = False  # system_status and the PREARM bit depend on the present mode
    # Braking from LAND_LOW_M up, until it descends at LAND_MPS; None: it slows down from LAND_HIGH_M to LAND_LOW_M.
    brakes_mps2: float | None = None
    crawl_below_m: float = 0.0  # above home: below this height it descends at CRAWL_MPS
    landed_after_s: float  # duration of ground contact before it counts as landed
    disarm_after_s: float  # from the landing until it disarms
    takeoff_share: float = 0.8  # take-off speed as a share of the climb speed
    liftoff_pause_s: float = 0.0  # just above the ground, before a take-off climbs
    takeoff_above_sea: bool = False  # the altitude of NAV_TAKEOFF is AMSL, not above home
    takeoff_in_guided: bool = False  # NAV_TAKEOFF needs an armed vehicle in a guided mode; else take-off is a mode
    mission_start_arms: bool = False  # MISSION_START also arms
    return_cone: bool = False  # close to home the return altitude is limited to the distance from home
    reposition_in: Intent  # the mode for DO_REPOSITION
    sinks_without_sticks: bool = False  # in manual modes it descends where it is
    stream_lifts: bool = False  # a setpoint above the ground starts the take-off of an armed vehicle
    stream_proof_s: float = 0.0  # duration of a stream before a guided mode accepts it; 0: none required
    stream_extrapolates_s: float | None = None  # how long the last setpoint is extrapolated; None: STREAM_TIMEOUT_S
    stream_comes_back: bool = False  # ... then it overshoots, and comes back to where it was at the end of that time


@dataclass(frozen=True, kw_only=True)
class ReportTraits:
    """MISSION_CURRENT and MISSION_ITEM_REACHED."""

    repeats: int = 0  # how often MISSION_ITEM_REACHED is repeated ...
    repeat_s: float = 1.0  # ... at this interval
    reports_landing: bool = False  # NAV_LAND is reported as reached when the descent begins
    starts_over: bool = False  # after landing the first item is current again
    empty_total: int = 0  # MISSION_CURRENT.total without a mission
    counts_home: bool = False
    mode_elsewhere: int = 0  # MISSION_CURRENT.mission_mode outside missions
    counts_manoeuvres: bool = False  # a take-off or landing by command counts as a completed mission
    item_names: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class ReplyTraits:
    """COMMAND_ACK and the messages with it, TIMESYNC and signing."""

    refused: MavResult  # arming, disarming, take-off
    unknown_mode: MavResult  # ACCEPTED: without any effect
    unknown_stream: MavResult
    unknown_message: MavResult
    nothing_newer: MavResult  # a request for a message whose contents were sent already
    unsupported: frozenset[int] = frozenset()  # commands that only the other autopilots support
    formats: bool = False  # supports STORAGE_FORMAT, which takes time
    mode_acks: int  # number of acknowledgements of a mode change
    message_first: bool = False  # a requested message comes before the acknowledgement
    set_mode_command: int  # the command in the acknowledgement of SET_MODE
    heartbeat_on_change: bool = False  # sends HEARTBEAT at once after a mode change
    announces_home: bool = False  # sends origin and home when they change
    any_component: bool = False  # answers messages for other components of the vehicle
    waits_for_contact: bool = False  # sends only HEARTBEAT and telemetry until a ground station has sent a message
    numbered_texts: bool = False  # every STATUSTEXT has an id, not only those in chunks
    clock_step_ns: int  # resolution of its clock
    timesync_period_s: float = math.inf  # of its own TIMESYNC requests
    signs: bool = False  # obeys SETUP_SIGNING


@dataclass(frozen=True, kw_only=True)
class StreamTraits:
    """The default message rates, and the rates that can be set."""

    unasked_hz: Mapping[int, float]  # by message number
    default_hz: float = 0.0  # the rate of interval 0; 0: none
    fixed: frozenset[int] = frozenset()  # messages whose rate cannot be changed
    unsent: frozenset[int]  # messages that this autopilot does not have
    mute: frozenset[int] = frozenset()  # messages it never sends although it accepts a rate for them
    groups: Mapping[int, frozenset[int]] = field(default_factory=dict)  # the groups of REQUEST_DATA_STREAM
    # How often the contents of a message change, s: a request is denied while they are those last sent; else it is not.
    contents_s: Mapping[int, float] = field(default_factory=dict)
    fast_share: float  # the real share of a requested rate above 5 Hz
    local_from: Milestone  # first milestone with LOCAL_POSITION_NED
    global_from: Milestone  # first milestone with GLOBAL_POSITION_INT; without a position before PLACED
    targets_in_guided_only: bool = False  # POSITION_TARGET_LOCAL_NED
    home_has_attitude: bool = False  # HOME_POSITION.q is not NaN
    reports_rtk: bool = False  # the fix type of GPS_RAW_INT shows an RTK receiver
    reports_airspeed: bool = False  # VFR_HUD.airspeed is the ground speed; else NaN


@dataclass(frozen=True, kw_only=True)
class HealthTraits:
    """The three bit fields of SYS_STATUS when all is well, and the EKF flags before and after READY."""

    present: int
    enabled: int
    healthy: int
    gnss: int = 0x20  # the bit of the GNSS receiver
    before_ready: int  # flags of EKF_STATUS_REPORT or ESTIMATOR_STATUS
    ready: int


@dataclass(frozen=True, kw_only=True)
class ParamTraits:
    """The parameter protocol."""

    sysid: str  # the parameter that holds the system id
    any_case: bool = False  # names match in any case, and are returned as requested
    sends_index: bool = False  # the reply to a request by name, or to a set, has the index; else 65535
    bytes_in_float: bool = False  # integers are sent as the bytes of the float; else as numbers
    converts: bool = False  # a value set with another type is converted; else it has no effect
    takes_nan: bool = False
    capacity: str  # the parameter that holds the capacity of the battery, mAh
    hash_name: str = ""  # sent before a list, to check a cached copy; "" if there is none
    banner: tuple[str, ...] = ()  # STATUSTEXTs sent with a list
