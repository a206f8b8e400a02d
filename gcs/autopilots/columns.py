"""The columns of the autopilot table: everything in which autopilots may differ, with its unit.

The values are rows: `gcs.autopilots.ardupilot`, `gcs.autopilots.px4`. Code elsewhere reads a column; it never asks
which autopilot it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from gcs.autopilots.alarms import NO_ALARMS, AlarmTexts
from gcs.autopilots.protocol_timers import STANDARD, ProtocolTimers
from gcs.autopilots.stored_fields import UNKNOWN_STORAGE, ItemStorage
from gcs.autopilots.waypoint_models.navigator import Navigator
from gcs.mavlink import EkfFlag, MavCommand, MessageId, ModeFlag

# MAV_FRAME of items that name a position, as files and as links write it: altitude above mean sea level, above home,
# above the ground
AMSL, ABOVE_HOME, ABOVE_GROUND = frozenset({0, 5}), frozenset({3, 6}), frozenset({10, 11})


# Of an estimate that a formation flies on. The PREARM bit of SYS_STATUS is a check of its own (`prearm_bit`).
POSITION_FLAGS = EkfFlag.ATTITUDE | EkfFlag.VELOCITY_HORIZ | EkfFlag.POS_HORIZ_ABS | EkfFlag.POS_VERT_ABS


HEALTH_IDS = (MessageId.SYS_STATUS, MessageId.GPS_RAW_INT, MessageId.RC_CHANNELS, MessageId.BATTERY_STATUS)

if TYPE_CHECKING:
    from gcs.types import Array

_BENT_M = 0.01  # heights between two knots differ by less from the straight line


@dataclass(frozen=True)
class LandingProfile:
    """Speed of descent by height above home, linear between these heights and constant beyond them."""

    heights_m: tuple[float, ...]  # rising
    speeds_mps: tuple[float, ...]  # of the descent, positive
    delay_s: float = 0.0  # from the order until it would begin at full speed: half of the time that it speeds up

    def __post_init__(self) -> None:
        rises = all(low < high < math.inf for low, high in pairwise(self.heights_m))
        moves = all(0.0 < speed < math.inf for speed in self.speeds_mps)
        if len(self.heights_m) != len(self.speeds_mps) or not rises or not moves:
            raise ValueError(f"a landing profile needs rising heights and positive speeds: {self}")

    def speed_mps(self, height_m: Array) -> Array:
        """Return the speed of descent at these heights above home."""
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        return np.asarray(np.interp(height_m, self.heights_m, self.speeds_mps))

    def height_m(self, from_m: float, ground_m: float, since_s: Array) -> Array:
        """Return the heights at times after the order; `from_m` is the height then. All heights are above home."""
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        passed_s, height_m = self.knots(from_m, ground_m)
        return np.asarray(np.interp(since_s, passed_s, height_m))

    def duration_s(self, from_m: float, ground_m: float) -> float:
        """Return the time from the order to the ground."""
        return float(self.knots(from_m, ground_m)[0][-1])

    def knots(self, from_m: float, ground_m: float) -> tuple[Array, Array]:
        """Return times (N,) after the order and the heights (N,) then; between two of them the speed is constant.

        The last one is on the ground. A vehicle that is not above the ground stays where it is.
        """
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        if from_m <= ground_m:
            return np.zeros(1), np.array([from_m])
        inner_m = [height for height in self.heights_m if ground_m < height < from_m]
        times, heights = [0.0, self.delay_s], [from_m, from_m]
        for high_m, low_m in pairwise([from_m, *reversed(inner_m), ground_m]):
            passed_s, height_m = self._piece(high_m, low_m)
            times += (times[-1] + passed_s).tolist()
            heights += height_m.tolist()
        skipped = 0 if self.delay_s > 0.0 else 1
        return np.array(times[skipped:]), np.array(heights[skipped:])

    def _piece(self, high_m: float, low_m: float) -> tuple[Array, Array]:
        """Knots of a descent in which the speed is linear in height; its begin is left out."""
        import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)

        fast_mps, slow_mps = self.speed_mps(np.array([high_m, low_m])).tolist()
        per_s = (fast_mps - slow_mps) / (high_m - low_m)
        if abs(per_s) * (high_m - low_m) < 1e-6 * slow_mps:
            return np.array([2.0 * (high_m - low_m) / (fast_mps + slow_mps)]), np.array([low_m])
        whole_s = float(np.log(fast_mps / slow_mps)) / per_s
        # A parabola through two knots that are dt apart is a dt^2 / 8 off their straight line.
        step_s = float(np.sqrt(8.0 * _BENT_M / (abs(per_s) * max(fast_mps, slow_mps))))
        count = int(np.ceil(whole_s / step_s))
        passed_s = whole_s * np.arange(1, count + 1) / count
        height_m = high_m - (fast_mps / per_s) * -np.expm1(-per_s * passed_s)
        height_m[-1] = low_m
        return passed_s, height_m


@dataclass(frozen=True)
class LandingBehaviour:
    """An autopilot's own landing: the parameters of its descent, with defaults, and the resulting profile."""

    parameters: Mapping[str, float]
    profile_of: Callable[[Mapping[str, float]], LandingProfile]

    def profile(self, known: Mapping[str, float] | None = None) -> LandingProfile:
        """Return the profile of a vehicle with these parameters; those that are not known have their defaults.

        So have all, if nothing could land by those that are known: a speed of zero, infinite heights.
        """
        with suppress(ValueError):
            return self.profile_of({**self.parameters, **(known or {})})
        return self.profile_of(self.parameters)


class CommandSource(StrEnum):
    """The source of what is known about a mission command on an autopilot."""

    MANUAL = "its manual lists it"
    RECORDED = "a recorded vehicle accepted it"
    ABSENT = "its manual does not list it"
    REFUSED = "a recorded vehicle refused it"
    IGNORED = "it is accepted and never executed"


def commands_of(names: Mapping[CommandSource, str]) -> dict[int, CommandSource]:
    """Return the source of each command, from their names (without MAV_CMD, between blanks) by source."""
    return {MavCommand[name]: source for source, listed in names.items() for name in listed.split()}


@dataclass(frozen=True)
class MissionSupport:
    """What an autopilot stores, accepts and flies of a mission."""

    frames: frozenset[int]  # MAV_FRAME of items that name a position
    items_max: int  # home included where it is item 0
    fence_items_max: int  # vertices and circles
    rally_points_max: int
    jumps_max: int | None  # DO_JUMP items that small boards execute; None: no limit is known
    inside_every_inclusion: bool  # a vehicle must be inside all inclusion areas; else inside one of them
    altitude_decimals: int | None  # of a stored altitude in m, others are cut off; None: single precision
    speed_mps: tuple[float, float]  # slowest and fastest ground speed accepted from DO_CHANGE_SPEED
    default_speed_mps: float  # ground speed of a mission without DO_CHANGE_SPEED
    climb_mps: tuple[float, float]  # default speeds up and down
    height_0_is_height_before: bool  # an item at height 0 is flown at the height of the item before it
    takeoff_goes_to_place: bool  # after the climb NAV_TAKEOFF flies to the position of its item
    commands: Mapping[int, CommandSource]  # MAV_CMD; commands that are not listed: ABSENT


@dataclass(frozen=True)
class ReturnSettings:
    """One vehicle's return (RTL), from which an autopilot's parameters follow. Altitudes are above its home, m."""

    altitude_m: float
    cruise_mps: float
    climb_mps: float
    sink_mps: float
    wait_s: float  # above the landing point
    fence_top_m: float
    takeoff_m: float  # height of its hover


ReturnParameters = tuple[tuple[str, int | float], ...]
# By name of a parameter: why an upload sets it, for the operator, and its value; ints for whole-number parameters.
ReturnTable = Mapping[str, tuple[str, Callable[[ReturnSettings], int | float]]]


@dataclass(frozen=True)
class ReturnBehaviour:
    """How an autopilot returns (RTL)."""

    altitude_above_home: bool  # the return altitude counts from home; else from the landing point it flies to
    rally_at_return_altitude: bool  # a rally point holds the return altitude; else the ground, and RTL adds to it
    wait_s: float  # above the landing point before the descent
    rally_step_m: float  # altitudes of rally points are multiples of it, others are cut off
    default_altitude_m: float
    at_fence: str  # what it does where its return meets an exclusion of its fence, in words: "it ..."
    table: ReturnTable

    def parameters(self, wanted: ReturnSettings, *, returns: bool = True) -> ReturnParameters:
        """Return the parameters with which a vehicle returns in this way.

        Without `returns` they are those of its speeds and its fence alone: what only a return uses is `RTL_...`.
        """
        names = [name for name in self.table if returns or not name.startswith("RTL_")]
        return tuple((name, self.table[name][1](wanted)) for name in names)


@dataclass(frozen=True)
class EstimatorReport:
    """The message, and its flags, that show that the position estimate is ready."""

    message: MessageId
    required: int
    forbidden: int

    def is_ready(self, name: str, fields: Mapping[str, Any]) -> bool:
        """Return whether this message reports a position estimate that is ready for flight.

        This is the one definition of ready: waiting before a flight, pre-flight and `gcs vehicles` all call it.
        """
        if name != self.message.name:
            return False
        flags = fields["flags"]
        return flags & self.required == self.required and not flags & self.forbidden


class FailsafeCause(StrEnum):
    """Why an autopilot's own failsafe took over."""

    FENCE = "fence"
    BATTERY = "battery"
    LINK = "data link"
    POSITION = "position estimate"
    OTHER = "not told"


@dataclass(frozen=True)
class FailsafeSigns:
    """How an autopilot shows that its failsafe, not a pilot, changed the mode.

    Its texts are parts of STATUSTEXTs in lower case.
    """

    texts: tuple[tuple[str, FailsafeCause], ...] = ()  # parts of STATUSTEXT; the first that is found counts
    not_texts: tuple[str, ...] = ()  # a text with one of these parts says that a failsafe ended
    modes: frozenset[int] = frozenset()  # modes that a failsafe chooses
    always_critical: bool = False  # HEARTBEAT.system_status is CRITICAL or EMERGENCY in every failsafe
    pilot_texts: tuple[str, ...] = ()  # parts of a STATUSTEXT that says that a pilot took over

    def cause(self, text: str) -> FailsafeCause | None:
        """Return the cause that a STATUSTEXT names; None for a text of something else."""
        lower = text.lower()
        if any(part in lower for part in self.not_texts):
            return None
        return next((cause for part, cause in self.texts if part in lower), None)

    def pilot(self, text: str) -> bool:
        """Return whether a STATUSTEXT says that a pilot took over."""
        return any(part in text.lower() for part in self.pilot_texts)


@dataclass(frozen=True)
class FlightBehaviour:
    """How an autopilot is flown. Modes are values of HEARTBEAT.custom_mode."""

    guided: int  # follows setpoints
    mission: int
    hold: int
    land: int
    returning: int
    armed_in: int  # the mode in which it arms and takes off
    two_part_modes: bool  # DO_SET_MODE takes main mode and sub mode apart
    mode_names: Mapping[int, str]
    takeoff_above_sea: bool  # NAV_TAKEOFF's altitude is above mean sea level; else above home
    stream_first_s: float  # a setpoint stream of this length must precede guided mode, and must not stop in it
    lag_s: float  # delay with which it follows setpoints that arrive on time
    waits_for_time_of_day: bool  # NAV_DELAY until an hour, minute and second
    health_ids: tuple[int, ...]  # messages that report failures, and a pilot's input, in flight
    failsafe: FailsafeSigns = FailsafeSigns()
    alarms: AlarmTexts = NO_ALARMS
    takeoff_modes: frozenset[int] = frozenset()  # shown between arming and the hover, besides `armed_in`

    def mode_parameters(self, mode: int) -> tuple[float, ...]:
        """Return the parameters of DO_SET_MODE."""
        if self.two_part_modes:
            return float(ModeFlag.CUSTOM), *map(float, _parts(mode))
        return float(ModeFlag.CUSTOM), float(mode)

    def mode_name(self, mode: int) -> str:
        """Return the name of a mode; a mode that is not known keeps its number.

        A mode in two parts with an unknown sub mode has the name of its main mode.
        """
        if not self.two_part_modes:
            return self.mode_names.get(mode, f"mode {mode}")
        main, sub = _parts(mode)
        of_main = self.mode_names.get(main << 16, f"mode {main}.{sub}")
        return self.mode_names.get(main << 16 | sub << 24, of_main)

    def takeoff_parameters(self, height_m: float, home_amsl_m: float) -> tuple[float, ...]:
        """Return the parameters of NAV_TAKEOFF for a vertical climb of `height_m`."""
        top_m = home_amsl_m + height_m if self.takeoff_above_sea else height_m
        place = math.nan if self.takeoff_above_sea else 0.0
        return 0.0, 0.0, 0.0, math.nan, place, place, top_m


@dataclass(frozen=True)
class RenamedParameter:
    """A parameter that a newer version has under another name, and perhaps in another unit."""

    old: str
    new: str
    per_new: float = 1.0  # units of the old name in one unit of the new name: 100 cm in a metre


@dataclass(frozen=True)
class ParameterRenaming:
    """The parameters that a version renamed. Development builds of that version may have old or new names."""

    since: tuple[int, int]  # major and minor version
    names: tuple[RenamedParameter, ...]


@dataclass(frozen=True)
class LinkBehaviour:
    """How an autopilot communicates. The defaults are for a vehicle whose autopilot is not in the table."""

    home_is_item_0: bool = False  # a mission on the wire, and in a .waypoints file, begins with home
    mission_files: bool = False  # it takes a mission as a file (MAVLink FTP, @MISSION)
    requests_in_flight: int = 1  # at a download; more only where items may be requested in any order
    integers_in_bytes: bool = False  # PARAM_VALUE holds the bytes of an integer; else its value as a float
    item_storage: ItemStorage = UNKNOWN_STORAGE  # what of each item survives on board
    rally_integer_frames: bool = False  # rally points go in frames 5 and 6, as other positions do; else in 0 and 3
    renaming: ParameterRenaming | None = None
    system_id: str = ""  # the parameter with the vehicle's system id
    estimator: EstimatorReport = EstimatorReport(
        MessageId.EKF_STATUS_REPORT, POSITION_FLAGS, EkfFlag.CONST_POS_MODE | EkfFlag.UNINITIALIZED
    )
    # Sensors that may be enabled and not healthy: pre-flight mentions them. `[preflight]` of a scenario may say else.
    mentioned_sensors: frozenset[str] = frozenset({"radio control"})
    # How critical STATUSTEXTs begin that belong to the start-up: they count only once the vehicle is ready.
    startup_texts: tuple[str, ...] = ()
    # The PREARM bit of SYS_STATUS says whether it can be armed, whatever its present mode.
    prearm_bit: bool = False
    cured_text: str = ""  # a reason against arming that the flight's own mission and mode remove
    capacity_parameter: str | None = None  # of its battery, mAh; 0 or less: unknown
    fence_parameter: str = ""  # switches the fence on; without one, a fence on board is in force
    timers: ProtocolTimers = STANDARD


class ParameterFileStyle(StrEnum):
    """The format of a parameter file, by its suffix."""

    MISSION_PLANNER = ".param"
    QGROUNDCONTROL = ".params"


@dataclass(frozen=True)
class AutopilotTraits:
    """One autopilot: a row of the table."""

    title: str
    missions: MissionSupport
    returns: ReturnBehaviour
    flight: FlightBehaviour
    landing: LandingBehaviour
    link: LinkBehaviour
    parameter_file: ParameterFileStyle
    navigator: Navigator  # the model that predicts its flight of waypoints
    apart_s: float  # two vehicles with the same mission may differ by so much in time
    earth_radius_m: float  # of the sphere on which it counts the metres of its local frame


def _parts(mode: int) -> tuple[int, int]:
    return mode >> 16 & 0xFF, mode >> 24 & 0xFF
